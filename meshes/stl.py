"""STL: triangles without connectivity, in binary and in words.

The solids of a file in words are the labels of its faces, if there are several.
"""

import re

import numpy as np

from meshes.errors import InvalidMesh
from meshes.face_labels import named_labels
from meshes.tri_mesh import TriMesh

_SOLID = re.compile(rb"^[ \t]*solid\b([^\r\n]*)", re.IGNORECASE | re.MULTILINE)
_VERTEX = re.compile(rb"(?<!\S)vertex(?!\S)", re.IGNORECASE)

HEADER = b"phasemesh binary STL".ljust(80)
RECORD = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")], align=False
)


def read_stl(data):
    """The TriMesh in STL bytes; equal corners become one vertex.

    Faces whose corners coincide have no area and are left out.

    Raises
    ------
    InvalidMesh
        If the bytes are cut off or no STL.
    """
    binary = len(data) >= 84
    count = int.from_bytes(data[80:84], "little") if binary else 0
    if (
        binary
        and len(data) >= 84 + 50 * count
        and (count or not data.lstrip().startswith(b"solid"))
    ):
        corners = np.frombuffer(data, RECORD, count, offset=84)["corners"].astype(float)
    elif data.lstrip().lower().startswith(b"solid"):
        return _ascii_mesh(data)
    elif binary:
        raise InvalidMesh(
            f"it is cut off: its header announces {count} triangles, "
            f"but it holds {(len(data) - 84) // 50}"
        )
    else:
        raise InvalidMesh(f"it is no STL file ({len(data)} bytes)")
    return TriMesh(*weld_exactly(corners)[:2])


def _ascii_mesh(data):
    """The TriMesh of an STL in words, one label per solid."""
    corners, solids, names = _ascii_corners(data)
    points, faces, kept = weld_exactly(corners)
    found = named_labels(names, solids[kept]) if len(names) > 1 else None
    return TriMesh(points, faces) if found is None else TriMesh(points, faces, found[1], found[0])


def _ascii_corners(data):
    """Corners (m, 3, 3), the solid of each triangle, and the solids' names."""
    words = data.lower().split()
    places = [i for i, word in enumerate(words) if word == b"vertex"]
    try:
        numbers = [words[i + k] for i in places for k in (1, 2, 3)]
        corners = np.array(numbers, dtype=float)
    except (IndexError, ValueError) as error:
        raise InvalidMesh("a vertex has no three numbers (is the file cut off?)") from error
    if len(places) % 3 or b"endsolid" not in words:
        raise InvalidMesh(f"it is cut off after {len(places)} vertices: 'endsolid' is missing")
    begins = [match.start() for match in _SOLID.finditer(data)]
    vertices = [match.start() for match in _VERTEX.finditer(data)][::3]
    solids = np.maximum(np.searchsorted(begins, vertices, side="right") - 1, 0)
    if len(vertices) * 3 != len(places):
        begins, solids = [], np.zeros(len(places) // 3, dtype=int)
    names = [_SOLID.match(data, begin)[1].decode("utf-8", "replace").strip() for begin in begins]
    names = [name or f"solid {number}" for number, name in enumerate(names)]
    return corners.reshape(-1, 3, 3), solids, names


def weld_exactly(corners):
    """Make one vertex of all equal corners: points (n, 3), faces (k, 3), the faces kept (m,).

    Parameters
    ----------
    corners : (m, 3, 3) float array

    Notes
    -----
    Vertices are numbered as they first appear. A triangle with two equal corners is left out:
    its neighbours then meet along the edge it had collapsed to.
    """
    flat = np.ascontiguousarray(corners, dtype=float).reshape(-1, 3) + 0.0  # no negative zero
    order = np.lexsort(flat.T[::-1])
    ordered = flat[order]
    new = np.ones(len(flat), dtype=bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    group = np.empty(len(flat), dtype=np.int64)
    group[order] = np.cumsum(new) - 1
    first = order[new]  # lexsort is stable: the first appearance
    rank = np.empty(len(first), dtype=np.int32)
    rank[np.argsort(first)] = np.arange(len(first), dtype=np.int32)
    faces = rank[group].reshape(-1, 3)
    collapsed = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return flat[np.sort(first)], faces[~collapsed], ~collapsed


def stl_bytes(points, faces):
    """Binary STL (the same bytes for the same mesh).

    Raises
    ------
    InvalidMesh
        If coordinates are too large for single precision.
    """
    corners = points[faces]
    if np.abs(corners).max(initial=0.0) > np.finfo(np.float32).max:
        raise InvalidMesh("coordinates above 3.4e38 do not fit an STL file")
    corners = corners.astype("<f4")
    records = np.zeros(len(faces), RECORD)
    records["corners"] = corners
    wide = corners.astype(float)
    normal = np.cross(wide[:, 1] - wide[:, 0], wide[:, 2] - wide[:, 0])
    length = np.linalg.norm(normal, axis=1)[:, None]
    records["normal"] = normal / np.where(length > 0, length, 1.0)
    return HEADER + len(faces).to_bytes(4, "little") + records.tobytes()
