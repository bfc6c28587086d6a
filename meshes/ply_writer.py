"""PLY as `meshes.ply` describes it: binary, doubles."""

import json
import re

import numpy as np

from meshes.patch import Patch
from meshes.ply import TYPES


def ply_bytes(mesh, scale=1.0, point_data=None):
    """Binary PLY of a TriMesh, coordinates and planes times `scale`; the same bytes each time.

    Parameters
    ----------
    mesh : TriMesh
    scale : float
    point_data : mapping of str to (n,) or (n, k) array, optional
        Values at the points.
    """
    points = np.ascontiguousarray(mesh.points * scale, dtype="<f8")
    labelled = len(mesh.labels) > 1 or mesh.labels[:1] != (Patch("surface"),)
    lines = ["ply", "format binary_little_endian 1.0", "comment phasemesh surface"]
    if labelled:
        lines += [_label_line(k, patch, scale) for k, patch in enumerate(mesh.labels)]
    columns = _columns(point_data or {})
    lines += [f"element vertex {len(points)}", *(f"property double {axis}" for axis in "xyz")]
    lines += [f"property {_NAMES[values.dtype]} {name}" for name, values in columns.items()]
    lines += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"]
    fields = [("size", "u1"), ("corners", "<i4", 3)]
    if labelled:
        lines.append("property int label")
        fields.append(("label", "<i4"))
    records = np.zeros(len(mesh.faces), np.dtype(fields))
    records["size"], records["corners"] = 3, mesh.faces
    if labelled:
        records["label"] = mesh.face_labels
    vertices = points
    if columns:
        kinds = [("points", "<f8", 3), *((name, values.dtype) for name, values in columns.items())]
        vertices = np.zeros(len(points), np.dtype(kinds))
        vertices["points"] = points
        for name, values in columns.items():
            vertices[name] = values
    body = vertices.tobytes() + records.tobytes()
    if len(mesh.feature_edges):
        lines.append(f"element edge {len(mesh.feature_edges)}")
        lines += ["property int vertex1", "property int vertex2"]
        body += mesh.feature_edges.astype("<i4").tobytes()
    return ("\n".join([*lines, "end_header"]) + "\n").encode("ascii") + body


_NAMES = {
    np.dtype("<" + code): name
    for name, code in TYPES.items()
    if name in ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
}


def _columns(point_data):
    """Single columns by their PLY names, of types that every reader of PLY knows."""
    found = {}
    for name, values in point_data.items():
        values = np.asarray(values)
        name = re.sub(r"[^!-~]+", "_", name.strip()) or "values"
        if values.ndim == 1:
            columns = {name: values}
        elif name == "Normals" and values.shape[1:] == (3,):
            columns = dict(zip(("nx", "ny", "nz"), values.T))
        else:
            flat = values.reshape(len(values), -1)
            columns = {f"{name}_{k}": flat[:, k] for k in range(flat.shape[1])}
        for key, column in columns.items():
            while key in found or key in ("x", "y", "z"):
                key += "_"
            found[key] = _plain(column)
    return found


def _plain(values):
    """Values as one of the types that have a PLY name."""
    kind = values.dtype.newbyteorder("<")
    if kind in _NAMES:
        return values.astype(kind)
    if values.dtype.kind == "b":
        return values.astype("<u1")
    small = np.iinfo(np.int32)
    if values.dtype.kind in "iu" and np.all((values >= small.min) & (values <= small.max)):
        return values.astype("<i4")
    return values.astype("<f8")


def _label_line(number, patch, scale):
    """The comment that explains a label."""
    name = json.dumps(patch.name)
    if patch.plane is None:
        return f"comment label {number} smooth {name}"
    x, y, z = (float(c) for c in patch.plane.normal)
    offset = float(patch.plane.offset) * scale
    return f"comment label {number} plane {x!r} {y!r} {z!r} {offset!r} {name}"
