"""OBJ and OFF: surfaces in words.

Only vertices and faces are read and written, and for OBJ the labels of the faces: the materials
(usemtl) of a file if there are several, else its groups (g), else its objects (o); groups on
writing.
"""

import numpy as np

from meshes.errors import InvalidMesh
from meshes.face_labels import named_labels
from meshes.polygons import triangulate
from meshes.tri_mesh import TriMesh


def read_obj(data):
    """The TriMesh in OBJ bytes; polygons are cut into triangles.

    Raises
    ------
    InvalidMesh
        If a line cannot be read; names the line.
    """
    points, sizes, corners, parts = [], [], [], _Parts()
    for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), 1):
        words = line.split("#", 1)[0].split()
        if words and words[0] in _Parts.KINDS:
            parts.begin(words[0], " ".join(words[1:]), len(sizes))
        if not words or words[0] not in ("v", "f"):
            continue
        try:
            if words[0] == "v":
                x, y, z = words[1:4]
                points.append((float(x), float(y), float(z)))
            else:
                loop = [int(word.split("/", 1)[0]) for word in words[1:]]
                corners.extend(i - 1 if i > 0 else len(points) + i for i in loop)
                sizes.append(len(loop))
        except ValueError as error:
            raise InvalidMesh(f"line {number} cannot be read: {line.strip()[:60]!r}") from error
    points = np.array(points, dtype=float).reshape(-1, 3)
    sizes = np.array(sizes, dtype=int)
    faces = triangulate(points, sizes, np.array(corners, dtype=int))
    found = parts.labels(np.repeat(np.arange(len(sizes)), np.maximum(sizes - 2, 0)))
    return TriMesh(points, faces) if found is None else TriMesh(points, faces, found[1], found[0])


class _Parts:
    """Which material, group and object the faces of an OBJ belong to."""

    KINDS = ("usemtl", "g", "o")

    def __init__(self):
        self._names = {kind: {"": 0} for kind in self.KINDS}
        self._starts = {kind: [0] for kind in self.KINDS}
        self._current = {kind: [0] for kind in self.KINDS}

    def begin(self, kind, name, face):
        """From this face on the name holds."""
        number = self._names[kind].setdefault(name, len(self._names[kind]))
        self._starts[kind].append(face)
        self._current[kind].append(number)

    def labels(self, polygons):
        """Labels and numbers for the polygons (m,) that the triangles were cut from, or None."""
        for kind in self.KINDS:
            place = np.searchsorted(self._starts[kind], polygons, side="right") - 1
            names = [name or "none" for name in self._names[kind]]
            found = named_labels(names, np.array(self._current[kind])[place])
            if found is not None:
                return found
        return None


def obj_bytes(mesh, scale=1.0):
    """OBJ in words; coordinates with as many digits as they have, a group for every label."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (mesh.points * scale).tolist()]
    corners = (mesh.faces + 1).tolist()
    if len(np.unique(mesh.face_labels)) < 2:
        lines += [f"f {a} {b} {c}" for a, b, c in corners]
    else:
        current = -1
        for label, (a, b, c) in zip(mesh.face_labels.tolist(), corners):
            if label != current:
                lines.append(f"g {_group_name(mesh.labels[label].name)}")
                current = label
            lines.append(f"f {a} {b} {c}")
    return ("\n".join(lines) + "\n").encode("utf-8")


def _group_name(name):
    return "_".join(name.replace("#", " ").split()) or "none"


def read_off(data):
    """The TriMesh in OFF bytes (also COFF, NOFF: extra numbers are skipped).

    Raises
    ------
    InvalidMesh
        If the file is binary, cut off, or no OFF.
    """
    lines = [line.split(b"#", 1)[0].split() for line in data.splitlines()]
    lines = [words for words in lines if words]
    if not lines or not lines[0][0].endswith(b"OFF"):
        raise InvalidMesh("it is no OFF file: it does not begin with OFF")
    if b"BINARY" in lines[0]:
        raise InvalidMesh("binary OFF is not read; write it in ASCII")
    head = lines[0][1:] or (lines.pop(1) if len(lines) > 1 else [])
    try:
        n_points, n_faces = int(head[0]), int(head[1])
        points = [[float(x) for x in words[:3]] for words in lines[1 : 1 + n_points]]
        loops = [[int(i) for i in words] for words in _face_lines(lines, n_points, n_faces)]
        if len(points) < n_points or len(loops) < n_faces:
            raise InvalidMesh(
                f"it is cut off: {n_points} vertices and {n_faces} faces announced, "
                f"{len(points)} and {len(loops)} found"
            )
        points = np.array(points, dtype=float).reshape(n_points, 3)
        sizes = np.array([loop[0] for loop in loops], dtype=int)
        if any(len(loop) < 1 + loop[0] for loop in loops):
            raise InvalidMesh("a face has fewer corners than it announces")
    except (ValueError, IndexError) as error:
        if isinstance(error, InvalidMesh):
            raise
        raise InvalidMesh(f"a line cannot be read as numbers ({error})") from error
    corners = [i for loop in loops for i in loop[1 : 1 + loop[0]]]
    return TriMesh(points, triangulate(points, sizes, np.array(corners, dtype=int)))


def _face_lines(lines, n_points, n_faces):
    """The words of each face's corners (without colours, which may be no whole numbers)."""
    chosen = lines[1 + n_points : 1 + n_points + n_faces]
    return [words[: 1 + int(words[0])] for words in chosen]


def off_bytes(points, faces):
    """OFF in words; coordinates with as many digits as they have."""
    lines = ["OFF", f"{len(points)} {len(faces)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    return ("\n".join(lines) + "\n").encode("ascii")
