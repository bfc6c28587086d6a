"""Kernels of the sliver repair: edge collapses and flips on flat half-edge arrays.

Half-edge 3 f + k of face f runs from its corner k to its corner k + 1 (modulo 3); `twin` is the
half-edge of the other face at the same edge, or -1 where the surface is open.
"""

from collections import namedtuple

import numpy as np
from numba import njit

RING = 64  # vertices of more faces are left alone

INTERIOR, CURVE, CORNER, FROZEN = 0, 1, 2, 3
ZERO = (0.0, 0.0, 0.0)

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
Limits = namedtuple("Limits", "short_edge good_shape bad_shape ear_shape least_cosine")

# Called from kernels only: no wrappers for Python, which take half of the time to compile.
_inner = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
_kernel = njit(cache=True, error_model="numpy")


@_inner
def following(h):
    """The next half-edge of the same face."""
    return h - 2 if h % 3 == 2 else h + 1


@_inner
def preceding(h):
    """The previous half-edge of the same face."""
    return h + 2 if h % 3 == 0 else h - 1


@_inner
def origin(mesh, h):
    """The vertex that a half-edge leaves."""
    return mesh.faces[h // 3, h % 3]


@_inner
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


@_inner
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


@_inner
def contains(values, count, value):
    """Whether values[:count] has the value."""
    for i in range(count):  # noqa: SIM110
        if values[i] == value:
            return True
    return False


@_inner
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


@_inner
def corner_at(rows, vertex, first, moved, position):
    """Row of a vertex; `position` for the vertices `first` and `moved`."""
    if vertex == first or vertex == moved:  # noqa: SIM109
        return position
    return row(rows, vertex)


@_inner
def row(rows, index):
    """A row of three as a tuple."""
    return (rows[index, 0], rows[index, 1], rows[index, 2])


@_inner
def difference(a, b):
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@_inner
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_inner
def may_merge(mesh, h, u, v, ring_u, count_u, ring_v, count_v):
    """Whether merging u into v along half-edge h keeps topology, curves, planes and labels."""
    if (
        mesh.kind[u] >= CORNER
        or mesh.kind[v] == FROZEN
        or (mesh.kind[u] == CURVE and not mesh.curve[h])
    ):
        return False
    if mesh.planes[u] & ~mesh.planes[v]:
        return False
    near_u, near_v = np.empty(RING + 1, np.int64), np.empty(RING + 1, np.int64)
    total_u = gather_neighbours(mesh, ring_u, count_u, near_u)
    total_v = gather_neighbours(mesh, ring_v, count_v, near_v)
    if count_u == total_u == 3 and count_v == total_v == 3:
        return False  # a tetrahedron
    common = 0
    for i in range(total_u):
        common += contains(near_v, total_v, near_u[i])
    if makes_chord(mesh, u, v, ring_u, count_u, near_v, total_v):
        return False
    if common != (1 if mesh.twin[h] == -1 else 2):
        return False  # the link condition
    for side in (h, mesh.twin[h]):
        if side != -1 and mesh.curve[following(side)] and mesh.curve[preceding(side)]:
            return False  # two curves would become one
    for i in range(count_u):
        a = origin(mesh, following(ring_u[i]))
        b = origin(mesh, preceding(ring_u[i]))
        if a != v and b != v and flat_in_plane(mesh, ring_u[i] // 3, v, a, b):
            return False
    return True


@_inner
def makes_chord(mesh, u, v, ring, count, near_v, total_v):
    """Whether merging u, whose fan is ring[:count], into v makes an edge in a plane it must avoid.

    An inner edge within a symmetry plane would meet its own image; a curve may not come to lie on
    the line where two planes meet.
    """
    for i in range(count):
        h = ring[i]
        w = origin(mesh, following(h))
        shared = mesh.planes[v] & mesh.planes[w]
        if mesh.curve[h]:
            shared &= ~mesh.planes[u]
        else:
            shared &= mesh.symmetry
        if w != v and shared and not contains(near_v, total_v, w):
            return True
        h = preceding(h)
        w = origin(mesh, h)
        if mesh.twin[h] == -1 and w != v and mesh.planes[v] & mesh.planes[w] & ~mesh.planes[u]:
            return True
    return False


@_inner
def flat_in_plane(mesh, face, a, b, c):
    """Whether vertices a, b, c all lie on a plane that is not the plane of the face."""
    shared = mesh.planes[a] & mesh.planes[b] & mesh.planes[c]
    if mesh.face_plane[face] >= 0:
        shared &= ~(1 << mesh.face_plane[face])
    return shared != 0


@_inner
def worst_shape(mesh, ring, count):
    """Worst shape of the faces of ring[:count] as they are."""
    worst = 1.0
    for i in range(count):
        shape, _, _ = measure_face(mesh, ring[i] // 3, -1, -1, ZERO, ZERO)
        worst = min(worst, shape)
    return worst


@_inner
def worst_shape_merged(mesh, h, u, v, ring, count, position, normal, limits):
    """Worst shape of the faces of ring[:count] that merging u and v at `position` leaves.

    Faces that keep another short edge do not count: that edge is to be collapsed too. -1 if a
    face is turned over.
    """
    worst = 1.0
    for i in range(count):
        face = ring[i] // 3
        if face == h // 3 or (mesh.twin[h] != -1 and face == mesh.twin[h] // 3):
            continue
        shape, cosine, shortest = measure_face(mesh, face, u, v, position, normal)
        if cosine < limits.least_cosine:
            _, before, _ = measure_face(mesh, face, -1, -1, position, normal)
            if mesh.face_plane[face] >= 0 or cosine < before:
                return -1.0
        if shortest >= limits.short_edge:
            worst = min(worst, shape)
    return worst


@_inner
def try_collapse(mesh, h, u, v, limits, ring, other, sweep):
    """Merge u into v, the ends of half-edge h, if all guards allow it; whether it did.

    Vertices of the same kind merge in the middle of the edge, if that leaves the better shapes.
    """
    count_u, count_v = gather_fan(mesh, u, ring), gather_fan(mesh, v, other)
    if count_u < 0 or count_v < 0 or not may_merge(mesh, h, u, v, ring, count_u, other, count_v):
        return False
    for i in range(count_v):
        ring[count_u + i] = other[i]
    count = count_u + count_v
    before = worst_shape(mesh, ring, count)
    target, normal = row(mesh.points, v), blend(row(mesh.normals, u), row(mesh.normals, v))
    same = mesh.kind[u] == mesh.kind[v] and mesh.planes[u] == mesh.planes[v]
    middle = blend(row(mesh.points, u), target)
    best = -1.0
    for candidate in range(2 if same else 1):
        position = target if candidate == 0 else middle
        after = worst_shape_merged(mesh, h, u, v, ring, count, position, normal, limits)
        if after > best or (candidate == 1 and after == best):
            best, target = after, position
    if best < min(before, limits.good_shape):
        return False
    for k in range(3):
        mesh.points[v, k] = target[k]
        mesh.normals[v, k] = normal[k]
    mesh.merged[u] = v
    collapse(mesh, h, v, ring, count_u)
    for i in range(count):
        for k in range(3):
            mesh.changed[mesh.faces[ring[i] // 3, k]] = sweep
    return True


@_inner
def blend(a, b):
    """The middle of a and b."""
    return (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]))


@_inner
def collapse(mesh, h, kept, ring, count):
    """Merge the other end of h, whose fan is ring[:count], into the end `kept`."""
    other = mesh.twin[h]
    for i in range(count):
        mesh.faces[ring[i] // 3, ring[i] % 3] = kept
    close_gap(mesh, h)
    if other != -1:
        close_gap(mesh, other)


@_inner
def close_gap(mesh, h):
    """Take out the face of half-edge h, both of whose ends are one vertex now."""
    vertex = origin(mesh, following(h))
    apex = origin(mesh, preceding(h))
    into, back = mesh.twin[following(h)], mesh.twin[preceding(h)]
    kept = mesh.curve[following(h)] or mesh.curve[preceding(h)]
    for one, two in ((into, back), (back, into)):
        if one != -1:
            mesh.twin[one] = two
            mesh.curve[one] = kept
            start = origin(mesh, one)
            mesh.out[start] = one
            mesh.out[apex if start == vertex else vertex] = following(one)
    mesh.alive[h // 3] = False


@_inner
def is_ear(mesh, h, t):
    """Whether h is the only edge by which its face hangs on, and to a face inside its label.

    Such a face on the convex side of a curve collapses when the curve is smoothed.
    """
    ear = mesh.curve[following(h)] and mesh.curve[preceding(h)]
    return ear and not mesh.curve[following(t)] and not mesh.curve[preceding(t)]


@_inner
def makes_ear(mesh, h, t):
    """Whether flipping the edge of half-edges h and t makes an ear of the faces at h's end."""
    return mesh.curve[following(h)] and mesh.curve[preceding(t)]


@_inner
def try_flip(mesh, h, limits, ring, sweep):
    """Flip the edge of half-edge h if that mends a bad triangle and all guards allow it."""
    t = mesh.twin[h]
    if t == -1 or mesh.curve[h]:
        return False
    a, b = origin(mesh, h), origin(mesh, following(h))
    c, d = origin(mesh, preceding(h)), origin(mesh, preceding(t))
    shape_f, cosine_f, _ = measure_face(mesh, h // 3, -1, -1, ZERO, ZERO)
    shape_g, cosine_g, _ = measure_face(mesh, t // 3, -1, -1, ZERO, ZERO)
    before = min(shape_f, shape_g)
    if is_ear(mesh, h, t) or is_ear(mesh, t, h):
        before = min(before, limits.ear_shape)
    elif before >= limits.bad_shape:
        return False
    if before >= limits.ear_shape and (makes_ear(mesh, h, t) or makes_ear(mesh, t, h)):
        return False
    if c == d or max(mesh.kind[a], mesh.kind[b], mesh.kind[c], mesh.kind[d]) == FROZEN:
        return False
    if mesh.planes[c] & mesh.planes[d] & mesh.symmetry:
        return False
    if flat_in_plane(mesh, h // 3, d, b, c) or flat_in_plane(mesh, h // 3, a, d, c):
        return False
    count = gather_fan(mesh, c, ring)
    near = np.empty(RING + 1, np.int64)
    if count < 0 or contains(near, gather_neighbours(mesh, ring, count, near), d):
        return False
    flip(mesh, h)
    shape_f, new_f, _ = measure_face(mesh, h // 3, -1, -1, ZERO, ZERO)
    shape_g, new_g, _ = measure_face(mesh, t // 3, -1, -1, ZERO, ZERO)
    least = min(limits.least_cosine, min(cosine_f, cosine_g))
    if mesh.face_plane[h // 3] >= 0:
        least = limits.least_cosine
    if min(shape_f, shape_g) > before and min(new_f, new_g) >= least:
        for vertex in (a, b, c, d):
            mesh.changed[vertex] = sweep
        return True
    for _ in range(3):
        flip(mesh, 3 * (h // 3) + 2)
    return False


@_inner
def flip(mesh, h):
    """Replace the edge a -> b of half-edge h by the one between the opposite vertices c and d.

    The new edge is half-edge 2 of h's face and half-edge 1 of the other face.
    """
    t = mesh.twin[h]
    a, b = origin(mesh, h), origin(mesh, following(h))
    c, d = origin(mesh, preceding(h)), origin(mesh, preceding(t))
    f, g = 3 * (h // 3), 3 * (t // 3)
    sides = (following(h), preceding(h), following(t), preceding(t))  # bc, ca, ad, db
    beyond = (mesh.twin[sides[0]], mesh.twin[sides[1]], mesh.twin[sides[2]], mesh.twin[sides[3]])
    kept = (
        mesh.curve[sides[0]], mesh.curve[sides[1]], mesh.curve[sides[2]], mesh.curve[sides[3]]
    )  # fmt: skip
    places = (f + 1, g + 2, g, f)
    mesh.faces[h // 3, 0], mesh.faces[h // 3, 1], mesh.faces[h // 3, 2] = d, b, c
    mesh.faces[t // 3, 0], mesh.faces[t // 3, 1], mesh.faces[t // 3, 2] = a, d, c
    for k in range(4):
        mesh.twin[places[k]] = beyond[k]
        mesh.curve[places[k]] = kept[k]
        if beyond[k] != -1:
            mesh.twin[beyond[k]] = places[k]
    mesh.twin[f + 2], mesh.twin[g + 1] = g + 1, f + 2
    mesh.curve[f + 2] = mesh.curve[g + 1] = False
    mesh.out[a], mesh.out[b], mesh.out[c], mesh.out[d] = g, f + 1, f + 2, f


@_inner
def edge_share(mesh, h):
    """Length of a half-edge over the edge length aimed at there."""
    u, v = origin(mesh, h), origin(mesh, following(h))
    edge = difference(row(mesh.points, u), row(mesh.points, v))
    squared = dot(edge, edge)
    return 2.0 * np.sqrt(squared) / (mesh.size[u] + mesh.size[v])


@_inner
def stale(mesh, face, since):
    """Whether no face at any corner of a face has changed since a sweep."""
    corner = mesh.faces[face]
    return max(mesh.changed[corner[0]], mesh.changed[corner[1]], mesh.changed[corner[2]]) < since


@_inner
def sum_of_curves(mesh, face):
    """Number of a face's edges that lie on curves."""
    return mesh.curve[3 * face] + mesh.curve[3 * face + 1] + mesh.curve[3 * face + 2]


@_kernel
def collapse_sweep(mesh, limits, short_edge, sweep, since):
    """Try to collapse every half-edge shorter than this share of the edges around; how many did.

    Those at which nothing has changed since sweep number `since` are not tried.
    """
    ring, other = np.empty(2 * RING, np.int64), np.empty(RING, np.int64)
    done = 0
    for h in range(len(mesh.twin)):
        if (
            not mesh.alive[h // 3]
            or stale(mesh, h // 3, since)
            or edge_share(mesh, h) >= short_edge
        ):
            continue
        u, v = origin(mesh, h), origin(mesh, following(h))
        for _ in range(2 if mesh.twin[h] == -1 else 1):  # the only half-edge of an open edge
            if try_collapse(mesh, h, u, v, limits, ring, other, sweep):
                done += 1
                break
            u, v = v, u
    return done


@_kernel
def flip_sweep(mesh, limits, sweep, since):
    """Try to flip every edge of a bad triangle; how many did (`sweep`, `since` as above)."""
    ring = np.empty(RING, np.int64)
    done = 0
    for face in range(len(mesh.faces)):
        if not mesh.alive[face] or stale(mesh, face, since):
            continue
        shape, _, _ = measure_face(mesh, face, -1, -1, ZERO, ZERO)
        curves = sum_of_curves(mesh, face)
        if shape >= limits.bad_shape and curves < 2:
            continue
        for k in range(3):
            if try_flip(mesh, 3 * face + k, limits, ring, sweep):
                done += 1
                break
    return done
