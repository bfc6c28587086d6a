"""PLY, ASCII and binary, with the labels and feature edges of a TriMesh.

Beside vertices and faces, a TriMesh with more than one bare label is written with

- a face property `int label`,
- one comment line per label: `comment label <number> smooth "<name>"`, or
  `comment label <number> plane <nx> <ny> <nz> <offset> "<name>"`, names as JSON strings,
- an element `edge` with `int vertex1`, `int vertex2`: the feature edges.

Other programs read such a file as any PLY; foreign files are read whatever else they carry.
"""

import json
from dataclasses import dataclass, field

import numpy as np

from meshes.errors import InvalidMesh
from meshes.patch import Patch, Plane
from meshes.polygons import triangulate
from meshes.tri_mesh import TriMesh

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8", "int64": "i8",
    "uint64": "u8",
}  # fmt: skip


@dataclass
class Element:
    """One element of a PLY header: its name, count, and properties (name, type, count type)."""

    name: str
    count: int
    properties: list = field(default_factory=list)


def read_ply(data):
    """Return the TriMesh in PLY bytes; polygons are cut into triangles.

    Raises
    ------
    InvalidMesh
        If the bytes are no PLY, are cut off, or have no vertices and faces.
    """
    kind, elements, comments, body = _header(data)
    reader = _read_ascii if kind == "ascii" else _read_binary
    order = ">" if kind == "binary_big_endian" else "<"
    place, found = 0, {}
    if kind == "ascii":
        body = body.split()
    for element in elements:
        found[element.name], place = reader(body, place, element, order)
    return _assemble(found, comments)


def _header(data):
    """Format, elements, comments and the body of PLY bytes."""
    if not data.startswith(b"ply"):
        raise InvalidMesh("it is no PLY file: it does not begin with 'ply'")
    place, kind, elements, comments = 0, None, [], []
    while True:
        end = data.find(b"\n", place)
        if end < 0:
            raise InvalidMesh("its PLY header is cut off: 'end_header' is missing")
        line = data[place:end].decode("utf-8", "replace").strip()
        place = end + 1
        words = line.split()
        try:
            if line == "end_header":
                break
            if line.startswith(("comment", "obj_info")):
                comments.append(line.partition(" ")[2])
            elif words[:1] == ["format"]:
                kind = words[1]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2])))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append((words[4], TYPES[words[3]], TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append((words[2], TYPES[words[1]], None))
        except (IndexError, KeyError, ValueError) as error:
            raise InvalidMesh(f"its PLY header has a line that means nothing: {line!r}") from error
    if kind not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise InvalidMesh(f"its PLY format {kind!r} is unknown")
    if any(element.count < 0 for element in elements):
        raise InvalidMesh("its PLY header has an element with a negative count")
    return kind, elements, comments, data[place:]


def _cut_off(element, number):
    return InvalidMesh(
        f"it is cut off: {element.count} elements {element.name!r} announced, {number} found"
    )


def _read_binary(body, place, element, order):
    """Columns of one element: name -> values (count,), or (sizes, values) of a list."""
    if element.count == 0 or not element.properties:
        return _empty(element), place
    sizes = _guess_sizes(body, place, element, order)
    record = np.dtype(
        [
            item
            for (name, kind, counter), size in zip(element.properties, sizes)
            for item in (
                [(name, order + kind)]
                if counter is None
                else [(f"{name} count", order + counter), (name, order + kind, (size,))]
            )
        ]
    )
    room = (len(body) - place) // record.itemsize if record.itemsize else 0
    regular = np.frombuffer(body, record, min(room, element.count), offset=place)
    lists = [(p, size) for p, size in zip(element.properties, sizes) if p[2] is not None]
    if not all(np.all(regular[f"{name} count"] == size) for (name, _, _), size in lists):
        return _read_records(body, place, element, order)
    if room < element.count:
        raise _cut_off(element, room)
    columns = {}
    for (name, _, counter), size in zip(element.properties, sizes):
        column = regular[name]
        columns[name] = (
            column if counter is None else (np.full(len(column), size), column.reshape(-1))
        )
    return columns, place + record.itemsize * element.count


def _empty(element):
    return {
        name: np.zeros(0) if counter is None else (np.zeros(0, int), np.zeros(0, int))
        for name, _, counter in element.properties
    }


def _guess_sizes(body, place, element, order):
    """Lengths of the lists of the first record (0 for scalars)."""
    sizes = []
    for _, kind, counter in element.properties:
        size = 0
        if counter is not None:
            size = _number(body, place, order + counter, element)
            place += np.dtype(counter).itemsize + size * np.dtype(kind).itemsize
        else:
            place += np.dtype(kind).itemsize
        sizes.append(size)
    return sizes


def _number(body, place, kind, element):
    """One whole number of the body."""
    kind = np.dtype(kind)
    if place + kind.itemsize > len(body):
        raise _cut_off(element, 0)
    number = int(np.frombuffer(body, kind, 1, offset=place)[0])
    if number < 0:
        raise InvalidMesh(f"an element {element.name!r} has a list of negative length")
    return number


def _read_records(body, place, element, order):
    """As `_read_binary`, record by record: for lists of different lengths."""
    values = {name: [] for name, _, _ in element.properties}
    sizes = {name: [] for name, _, counter in element.properties if counter is not None}
    kinds = [
        (name, np.dtype(order + kind), None if counter is None else np.dtype(order + counter))
        for name, kind, counter in element.properties
    ]
    for index in range(element.count):
        for name, kind, counter in kinds:
            size = 1
            if counter is not None:
                if place + counter.itemsize > len(body):
                    raise _cut_off(element, index)
                size = _number(body, place, counter, element)
                place += counter.itemsize
                sizes[name].append(size)
            if place + size * kind.itemsize > len(body):
                raise _cut_off(element, index)
            values[name].append(np.frombuffer(body, kind, size, offset=place))
            place += size * kind.itemsize
    joined = {name: np.concatenate(columns) for name, columns in values.items()}
    columns = {
        name: (np.array(sizes[name], int), joined[name]) if name in sizes else joined[name]
        for name in joined
    }
    return columns, place


def _read_ascii(words, place, element, _):
    """As `_read_binary`, from the words of an ASCII body."""
    if element.count == 0 or not element.properties:
        return _empty(element), place
    try:
        if all(counter is None for _, _, counter in element.properties):
            return _ascii_table(words, place, element)
        return _ascii_records(words, place, element)
    except ValueError as error:
        raise InvalidMesh(f"an element {element.name!r} is no number ({error})") from error


def _ascii_table(words, place, element):
    width = len(element.properties)
    table = np.array(words[place : place + width * element.count], dtype=float)
    if len(table) < width * element.count:
        raise _cut_off(element, len(table) // width)
    table = table.reshape(element.count, width)
    columns = {name: table[:, k] for k, (name, _, _) in enumerate(element.properties)}
    return columns, place + table.size


def _ascii_records(words, place, element):
    values = {name: [] for name, _, _ in element.properties}
    sizes = {name: [] for name, _, counter in element.properties if counter is not None}
    for index in range(element.count):
        for name, _, counter in element.properties:
            size = 1
            if counter is not None:
                if place >= len(words):
                    raise _cut_off(element, index)
                size = int(words[place])
                place += 1
                sizes[name].append(size)
            if size < 0 or place + size > len(words):
                raise _cut_off(element, index)
            values[name].extend(words[place : place + size])
            place += size
    columns = {}
    for name, kind, _ in element.properties:
        column = np.array(values[name], dtype=float)
        column = column.astype(np.int64) if kind[0] in "iu" else column
        columns[name] = (np.array(sizes[name], int), column) if name in sizes else column
    return columns, place


def _assemble(found, comments):
    """The TriMesh of the elements vertex, face and edge."""
    vertex, face = found.get("vertex"), found.get("face", {})
    if vertex is None or not all(axis in vertex for axis in "xyz"):
        raise InvalidMesh("it has no vertices with x, y and z")
    points = np.stack([np.asarray(vertex[axis], dtype=float) for axis in "xyz"], axis=1)
    loops = face.get("vertex_indices", face.get("vertex_index"))
    if not isinstance(loops, tuple):
        raise InvalidMesh("it has no faces (no list property 'vertex_indices')")
    sizes, corners = loops[0], loops[1].astype(np.int64)
    faces = triangulate(points, sizes, corners)
    labels = _labels(comments)
    numbers = face.get("label")
    if labels is None or numbers is None or isinstance(numbers, tuple):
        labels, numbers = (Patch("surface"),), np.zeros(len(sizes), int)
    numbers = np.repeat(np.asarray(numbers).astype(np.int64), np.maximum(sizes - 2, 0))
    if np.any((numbers < 0) | (numbers >= len(labels))):
        raise InvalidMesh("a face has a label that no comment line explains")
    return TriMesh(points, faces, numbers, labels, _edges(found.get("edge", {}), len(points)))


def _edges(columns, n_points):
    """Feature edges (k, 2) of the element edge."""
    if "vertex1" not in columns or "vertex2" not in columns:
        return np.zeros((0, 2), dtype=np.int32)
    edges = np.stack([columns["vertex1"], columns["vertex2"]], axis=1).astype(np.int64)
    if np.any((edges < 0) | (edges >= n_points)):
        raise InvalidMesh("an edge refers to a vertex that does not exist")
    return edges


def _labels(comments):
    """The patches of our comment lines, or None."""
    patches = []
    for comment in comments:
        words = comment.split(" ", 2)
        if words[0] != "label" or len(words) < 3:
            continue
        try:
            kind, rest = words[2].split(" ", 1)
            if int(words[1]) != len(patches):
                return None
            plane = None
            if kind == "plane":
                *numbers, rest = rest.split(" ", 4)
                nx, ny, nz, offset = (float(word) for word in numbers)
                plane = Plane((nx, ny, nz), offset)
            patches.append(Patch(str(json.loads(rest)), plane))
        except ValueError:
            return None
    return tuple(patches) or None


def ply_bytes(mesh, scale=1.0):
    """Binary PLY of a TriMesh, coordinates and planes times `scale`; the same bytes each time."""
    points = np.ascontiguousarray(mesh.points * scale, dtype="<f8")
    labelled = len(mesh.labels) > 1 or mesh.labels[:1] != (Patch("surface"),)
    lines = ["ply", "format binary_little_endian 1.0", "comment phasemesh surface"]
    if labelled:
        lines += [_label_line(k, patch, scale) for k, patch in enumerate(mesh.labels)]
    lines += [f"element vertex {len(points)}", *(f"property double {axis}" for axis in "xyz")]
    lines += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"]
    fields = [("size", "u1"), ("corners", "<i4", 3)]
    if labelled:
        lines.append("property int label")
        fields.append(("label", "<i4"))
    records = np.zeros(len(mesh.faces), np.dtype(fields))
    records["size"], records["corners"] = 3, mesh.faces
    if labelled:
        records["label"] = mesh.face_labels
    body = points.tobytes() + records.tobytes()
    if len(mesh.feature_edges):
        lines.append(f"element edge {len(mesh.feature_edges)}")
        lines += ["property int vertex1", "property int vertex2"]
        body += mesh.feature_edges.astype("<i4").tobytes()
    return ("\n".join([*lines, "end_header"]) + "\n").encode("ascii") + body


def _label_line(number, patch, scale):
    """The comment that explains a label."""
    name = json.dumps(patch.name)
    if patch.plane is None:
        return f"comment label {number} smooth {name}"
    x, y, z = (float(c) for c in patch.plane.normal)
    offset = float(patch.plane.offset) * scale
    return f"comment label {number} plane {x!r} {y!r} {z!r} {offset!r} {name}"
