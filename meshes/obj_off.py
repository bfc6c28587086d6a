"""OBJ and OFF: surfaces in words. Only vertices and faces are read and written."""

import numpy as np

from meshes.errors import InvalidMesh
from meshes.polygons import triangulate


def read_obj(data):
    """Points (n, 3) and faces (m, 3) of OBJ bytes; polygons are cut into triangles.

    Raises
    ------
    InvalidMesh
        If a line cannot be read; names the line.
    """
    points, sizes, corners = [], [], []
    for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), 1):
        words = line.split("#", 1)[0].split()
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
    return points, triangulate(points, np.array(sizes, dtype=int), np.array(corners, dtype=int))


def obj_bytes(points, faces):
    """OBJ in words; coordinates with as many digits as they have."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode("ascii")


def read_off(data):
    """Points (n, 3) and faces (m, 3) of OFF bytes (also COFF, NOFF: extra numbers are skipped).

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
    return points, triangulate(points, sizes, np.array(corners, dtype=int))


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
