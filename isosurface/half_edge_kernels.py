"""Kernels on flat half-edge arrays: the faces around a vertex, and the shape of a face.

Half-edge 3 f + k of face f runs from its corner k to its corner k + 1 (modulo 3); `twin` is the
half-edge of the other face at the same edge, or -1 where the surface is open.
"""

from collections import namedtuple

import numpy as np
from numba import njit

RING = 64  # vertices of more faces are left alone

INTERIOR, CURVE, CORNER, FROZEN = 0, 1, 2, 3

# faces (m, 3), twin (3m,), out (n,): a half-edge that leaves each vertex; curve (3m,) bool: on a
# kept curve; alive (m,) bool; points (n, 3); kind (n,): INTERIOR, CURVE, CORNER (does not move) or
# FROZEN (nor do its faces); planes (n,): bit set of the planes a vertex lies on; symmetry: bits of
# the symmetry planes; face_plane (m,): number of a face's plane or -1; plane_normals (q, 3);
# normals (n, 3): of the smooth faces around, averaged; size (n,): edge length aimed at; changed
# (n,): the last sweep that changed a face of it; merged (n,): the vertex it was merged into.
HalfEdges = namedtuple(
    "HalfEdges",
    "faces twin out curve alive points kind planes symmetry face_plane plane_normals normals size "
    "changed merged",
)

# Called from kernels only: no wrappers for Python, which take half of the time to compile.
inner = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)


@inner
def following(h):
    """The next half-edge of the same face."""
    return h - 2 if h % 3 == 2 else h + 1


@inner
def preceding(h):
    """The previous half-edge of the same face."""
    return h + 2 if h % 3 == 0 else h - 1


@inner
def origin(mesh, h):
    """The vertex that a half-edge leaves."""
    return mesh.faces[h // 3, h % 3]


@inner
def gather_fan(mesh, vertex, ring):
    """Put all half-edges that leave a vertex into ring (RING or more,); their number, or -1."""
    start = mesh.out[vertex]
    h, count = start, 0
    while True:
        if count == RING:
            return -1
        ring[count] = h
        count += 1
        h = mesh.twin[preceding(h)]
        if h == start:
            return count
        if h == -1:
            break
    h = mesh.twin[start]
    while h != -1:
        if count == RING:
            return -1
        h = following(h)
        ring[count] = h
        count += 1
        h = mesh.twin[h]
    return count


@inner
def gather_neighbours(mesh, ring, count, found):
    """Put the neighbours of the vertex that ring[:count] leaves into found (RING + 1,)."""
    total = 0
    for i in range(count):
        found[total] = origin(mesh, following(ring[i]))
        total += 1
        if mesh.twin[preceding(ring[i])] == -1:
            found[total] = origin(mesh, preceding(ring[i]))
            total += 1
    return total


@inner
def contains(values, count, value):
    """Whether values[:count] has the value."""
    for i in range(count):  # noqa: SIM110
        if values[i] == value:
            return True
    return False


@inner
def measure_face(mesh, face, first, moved, position, normal):
    """Shape of a face (1 equilateral, 0 flat), cosine to its reference normal, shortest edge.

    Vertices `first` and `moved` (-1 for none) are taken at `position` with normal `normal`. The
    edge is a share of the edge length aimed at.
    """
    corner = mesh.faces[face]
    a = corner_at(mesh.points, corner[0], first, moved, position)
    b = corner_at(mesh.points, corner[1], first, moved, position)
    c = corner_at(mesh.points, corner[2], first, moved, position)
    if mesh.face_plane[face] >= 0:
        reference = row(mesh.plane_normals, mesh.face_plane[face])
    else:
        reference = (0.0, 0.0, 0.0)
        for k in range(3):
            part = corner_at(mesh.normals, corner[k], first, moved, normal)
            reference = (reference[0] + part[0], reference[1] + part[1], reference[2] + part[2])
    ab, bc, ca = difference(b, a), difference(c, b), difference(a, c)
    squares = (dot(ab, ab), dot(bc, bc), dot(ca, ca))
    area = (
        ca[1] * ab[2] - ca[2] * ab[1],
        ca[2] * ab[0] - ca[0] * ab[2],
        ca[0] * ab[1] - ca[1] * ab[0],
    )
    twice = np.sqrt(dot(area, area))
    length = np.sqrt(dot(reference, reference))
    size = (mesh.size[corner[0]] + mesh.size[corner[1]] + mesh.size[corner[2]]) / 3.0
    shortest = np.sqrt(min(squares[0], squares[1], squares[2])) / size
    if twice == 0.0 or length == 0.0:
        return 0.0, -1.0, shortest
    shape = 2.0 * np.sqrt(3.0) * twice / (squares[0] + squares[1] + squares[2])
    return shape, dot(area, reference) / (twice * length), shortest


@inner
def corner_at(rows, vertex, first, moved, position):
    """Row of a vertex; `position` for the vertices `first` and `moved`."""
    if vertex == first or vertex == moved:  # noqa: SIM109
        return position
    return row(rows, vertex)


@inner
def row(rows, index):
    """A row of three as a tuple."""
    return (rows[index, 0], rows[index, 1], rows[index, 2])


@inner
def difference(a, b):
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inner
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
