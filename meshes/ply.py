"""PLY, ASCII and binary, with the labels and feature edges of a TriMesh and values at its points.

Beside vertices and faces, a TriMesh with more than one bare label is written with

- a face property `int label`,
- one comment line per label: `comment label <number> smooth "<name>"`, or
  `comment label <number> plane <nx> <ny> <nz> <offset> "<name>"`, names as JSON strings,
- an element `edge` with `int vertex1`, `int vertex2`: the feature edges.

Values at the points are vertex properties: `nx, ny, nz` are the array "Normals", and `name_0`,
`name_1` ... one array with several columns. Other programs read such a file as any PLY. Foreign
files are read whatever else they carry; a face property of whole numbers with a name such as
`label` or `material_index` holds labels.
"""

import json
import re
from dataclasses import dataclass, field

import numpy as np

from meshes.errors import InvalidMesh
from meshes.face_labels import is_label_name, numbered_labels
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
    """Return the TriMesh in PLY bytes, and the values at its points by name.

    Polygons are cut into triangles.

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
    kinds = {name: kind for e in elements if e.name == "vertex" for name, kind, _ in e.properties}
    return _assemble(found, comments), _point_data(found["vertex"], kinds)


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
    for element in elements:
        if len({name for name, *_ in element.properties}) < len(element.properties):
            raise InvalidMesh(f"its element {element.name!r} has two properties of one name")
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
        if kind[0] in "iu":
            if not np.all(np.abs(column) < 2.0**53):
                raise InvalidMesh(f"a property {name!r} has a value that is no whole number")
            column = column.astype(np.int64)
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
    labels, numbers = _face_labels(face, _labels(comments), len(sizes))
    numbers = np.repeat(np.asarray(numbers).astype(np.int64), np.maximum(sizes - 2, 0))
    if np.any((numbers < 0) | (numbers >= len(labels))):
        raise InvalidMesh("a face has a label that no comment line explains")
    return TriMesh(points, faces, numbers, labels, _edges(found.get("edge", {}), len(points)))


def _face_labels(face, labels, count):
    """Labels and the number of each polygon's: ours, foreign ones, or one for all."""
    numbers = face.get("label")
    if labels is not None and numbers is not None and not isinstance(numbers, tuple):
        return labels, numbers
    for name, values in face.items():
        found = None
        if is_label_name(name) and not isinstance(values, tuple) and len(values) == count:
            found = numbered_labels(values)
        if found is not None:
            return found
    return (Patch("surface"),), np.zeros(count, int)


def _point_data(columns, kinds):
    """Arrays at the points by name: properties other than coordinates, vectors put together."""
    left = {
        name: _typed(values, kinds[name])
        for name, values in columns.items()
        if name not in ("x", "y", "z") and not isinstance(values, tuple)
    }
    found = {}
    while left:
        name = next(iter(left))
        stem = re.sub(r"_0$", "", name)
        parts = [name]
        if {"nx", "ny", "nz"} <= left.keys() and name in ("nx", "ny", "nz"):
            stem, parts = "Normals", ["nx", "ny", "nz"]
        elif stem != name:
            while f"{stem}_{len(parts)}" in left:
                parts.append(f"{stem}_{len(parts)}")
        arrays = [left.pop(part) for part in parts]
        single = len(arrays) == 1
        found[name if single else stem] = arrays[0] if single else np.stack(arrays, axis=1)
    return found


def _typed(values, kind):
    """Values of words as the type of their property, where they fit it."""
    kind = np.dtype(kind)
    values = np.asarray(values)
    if values.dtype == kind.newbyteorder("=") or kind.kind == "f":
        return values.astype(kind)
    if values.dtype.kind == "f":
        limits = np.iinfo(kind)
        fits = (values >= limits.min) & (values <= limits.max) & (values == np.rint(values))
        return values.astype(kind) if fits.all() else values
    return values.astype(values.dtype.newbyteorder("="))


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
