"""Kernels of the sliver repair: edge collapses and flips on flat half-edge arrays."""

from collections import namedtuple

import numpy as np
from numba import njit

from isosurface.half_edge_kernels import (
    CORNER,
    CURVE,
    FROZEN,
    RING,
    contains,
    difference,
    dot,
    following,
    gather_fan,
    gather_neighbours,
    inner,
    measure_face,
    origin,
    preceding,
    row,
)

ZERO = (0.0, 0.0, 0.0)

Limits = namedtuple("Limits", "short_edge good_shape bad_shape ear_shape least_cosine")

_kernel = njit(cache=True, error_model="numpy")


@inner
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


@inner
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


@inner
def flat_in_plane(mesh, face, a, b, c):
    """Whether vertices a, b, c all lie on a plane that is not the plane of the face."""
    shared = mesh.planes[a] & mesh.planes[b] & mesh.planes[c]
    if mesh.face_plane[face] >= 0:
        shared &= ~(1 << mesh.face_plane[face])
    return shared != 0


@inner
def worst_shape(mesh, ring, count):
    """Worst shape of the faces of ring[:count] as they are."""
    worst = 1.0
    for i in range(count):
        shape, _, _ = measure_face(mesh, ring[i] // 3, -1, -1, ZERO, ZERO)
        worst = min(worst, shape)
    return worst


@inner
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


@inner
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


@inner
def blend(a, b):
    """The middle of a and b."""
    return (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]))


@inner
def collapse(mesh, h, kept, ring, count):
    """Merge the other end of h, whose fan is ring[:count], into the end `kept`."""
    other = mesh.twin[h]
    for i in range(count):
        mesh.faces[ring[i] // 3, ring[i] % 3] = kept
    close_gap(mesh, h)
    if other != -1:
        close_gap(mesh, other)


@inner
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


@inner
def is_ear(mesh, h, t):
    """Whether h is the only edge by which its face hangs on, and to a face inside its label.

    Such a face on the convex side of a curve collapses when the curve is smoothed.
    """
    ear = mesh.curve[following(h)] and mesh.curve[preceding(h)]
    return ear and not mesh.curve[following(t)] and not mesh.curve[preceding(t)]


@inner
def makes_ear(mesh, h, t):
    """Whether flipping the edge of half-edges h and t makes an ear of the faces at h's end."""
    return mesh.curve[following(h)] and mesh.curve[preceding(t)]


@inner
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


@inner
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


@inner
def edge_share(mesh, h):
    """Length of a half-edge over the edge length aimed at there."""
    u, v = origin(mesh, h), origin(mesh, following(h))
    edge = difference(row(mesh.points, u), row(mesh.points, v))
    squared = dot(edge, edge)
    return 2.0 * np.sqrt(squared) / (mesh.size[u] + mesh.size[v])


@inner
def stale(mesh, face, since):
    """Whether no face at any corner of a face has changed since a sweep."""
    corner = mesh.faces[face]
    return max(mesh.changed[corner[0]], mesh.changed[corner[1]], mesh.changed[corner[2]]) < since


@inner
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
