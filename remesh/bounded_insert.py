"""Points of the original put into triangles that miss it by too much: the end of `bounded`."""

import math

import numpy as np

from meshes.closest_point_kernels import FAR, closest_on_triangle
from remesh.bounded_kernels import (
    MOST_STAR,
    assign,
    fill_fan,
    fill_star,
    gather,
    measure,
    ring_of,
    star_shape,
)
from remesh.bounded_mesh import INSIDE, ON_CURVE
from remesh.compiled import allocating, kernel
from remesh.connectivity import following, preceding

MIDDLE = 0.12  # barycentric coordinate above which a point lies inside, not near an edge
LEAST_SHAPE = 0.01  # height over longest edge, of the triangles that a point makes
LEAST_AGREEMENT = 0.0


def insert_points(work, faces, targets, on_curves, limits):
    """Put points into faces or their edges; return how many.

    Parameters
    ----------
    work : BoundedMesh
    faces : (k,) int array
        Faces of the work mesh; of two for one face the first counts.
    targets : (k, 3) float array
        Points of the original near the faces.
    on_curves : (k, 3) float array
        Points of its feature edges, for where such an edge has to be split.
    limits : BoundLimits
    """
    work.reserve(len(faces))
    room = len(work.samples[2])
    return sweep_inserts(
        work.state, work.samples, work.counts, limits.figures(), faces, targets, on_curves,
        np.empty(room, np.int64), np.empty(room, np.int64),
    )  # fmt: skip


@kernel
def new_face(state, samples, counts, label):
    """The first half-edge of a new face."""
    face = counts[1]
    counts[1] += 1
    state[3][face] = label
    samples[0][face] = -1
    return 3 * face


@kernel
def link(twin, h, g):
    """Make two half-edges opposite; g may be -1."""
    twin[h] = g
    if g >= 0:
        twin[g] = h


@kernel
def split_face(state, samples, counts, h, m):
    """Put vertex m into the face of half-edge h, from a to b, with third corner c."""
    corner, twin, crease, label, first, _, _, _, _ = state
    h1, h2 = following(h), preceding(h)
    a, b, c = corner[h], corner[h1], corner[h2]
    n = new_face(state, samples, counts, label[h // 3])
    p = new_face(state, samples, counts, label[h // 3])
    corner[n], corner[n + 1], corner[n + 2] = b, c, m
    corner[p], corner[p + 1], corner[p + 2] = c, a, m
    corner[h2] = m
    link(twin, n, twin[h1])
    link(twin, p, twin[h2])
    crease[n], crease[p] = crease[h1], crease[h2]
    link(twin, h1, n + 2)
    link(twin, n + 1, p + 2)
    link(twin, p + 1, h2)
    crease[h1], crease[h2] = 0, 0
    for e in (n + 1, n + 2, p + 1, p + 2):
        crease[e] = 0
    first[a], first[b], first[c], first[m] = h, n, p, h2


@kernel
def split_side(state, samples, counts, h, m):
    """Cut the face of half-edge h, from a to b, at m: h is from a to m now; from m to b: returned.

    The two halves have no opposite half-edges yet.
    """
    corner, twin, crease, label, first, _, _, _, _ = state
    h1, h2 = following(h), preceding(h)
    b, c = corner[h1], corner[h2]
    n = new_face(state, samples, counts, label[h // 3])
    corner[n], corner[n + 1], corner[n + 2] = m, b, c
    corner[h1] = m
    link(twin, n + 1, twin[h1])
    link(twin, h1, n + 2)
    crease[n + 1], crease[n] = crease[h1], crease[h]
    crease[h1], crease[n + 2] = 0, 0
    first[b], first[c] = n + 1, n + 2
    twin[h], twin[n] = -1, -1
    return n


@kernel
def split_edge(state, samples, counts, h, m):
    """Put vertex m into the edge of half-edge h."""
    twin, first = state[1], state[4]
    g = twin[h]
    n = split_side(state, samples, counts, h, m)
    first[m] = following(h)
    if g >= 0:
        link(twin, h, split_side(state, samples, counts, g, m))
        link(twin, n, g)


@kernel
def closest_corner_weights(points, a, b, c, target, triangle):
    """Weights of the corners of the point of triangle (a, b, c) closest to the target."""
    for d in range(3):
        triangle[d] = points[a, d]
        triangle[3 + d] = points[b, d] - points[a, d]
        triangle[6 + d] = points[c, d] - points[a, d]
    triangle[9] = triangle[4] * triangle[8] - triangle[5] * triangle[7]
    triangle[10] = triangle[5] * triangle[6] - triangle[3] * triangle[8]
    triangle[11] = triangle[3] * triangle[7] - triangle[4] * triangle[6]
    v, w, _ = closest_on_triangle(target[0], target[1], target[2], triangle, FAR)
    return 1.0 - v - w, v, w


@kernel
def put_vertex(state, counts, kind, normal, x):
    """A new vertex at x."""
    _, _, _, _, _, kinds, points, normals, quadrics = state
    m = counts[0]
    counts[0] += 1
    kinds[m] = kind
    quadrics[m] = 0.0
    for d in range(3):
        points[m, d] = x[d]
        normals[m, d] = normal[d]
    return m


@kernel
def mean_normal(normals, a, b, normal):
    """Fill normal (3,) with the sum of two vertices' unit normals."""
    normal[:] = 0.0
    for v in (a, b):
        size = math.sqrt(normals[v, 0] ** 2 + normals[v, 1] ** 2 + normals[v, 2] ** 2)
        for d in range(3):
            normal[d] += normals[v, d] / size if size > 0.0 else 0.0


@kernel
def put_row(fan, i, face, p, q):
    """Row i of a fan: a face and its corners but the first."""
    fan[i] = 0
    fan[i, 0], fan[i, 1], fan[i, 2] = face, p, q


@kernel
def fits(state, fan, star, count, normal, x, figures, one):
    """Whether the triangles of a fan are well shaped with their common vertex at x."""
    fill_star(state[6], fan, count, x, star)
    shape, agree, _ = star_shape(state, fan, star, count, normal, figures, one)
    return shape > LEAST_SHAPE and agree > LEAST_AGREEMENT


@kernel
def move_corner(state, samples, v, x, figures, ring, fan, star, one, pool, found):
    """Move a vertex inside of a patch to x, if that leaves good triangles; whether it moved."""
    _, twin, _, _, first, kind, points, normals, _ = state
    if kind[v] != INSIDE:
        return False
    count = fill_fan(state, v, ring, ring_of(twin, first, v, ring), -1, fan, 0)
    if count == 0 or not fits(state, fan, star, count, normals[v], x, figures, one):
        return False
    filled = 0
    for i in range(count):
        filled = gather(samples[0], samples[1], fan[i, 0], pool, filled)
    for d in range(3):
        points[v, d] = x[d]
    measure(state, samples, fan, star, count, x, pool, filled, FAR, -1.0, found)
    assign(samples, fan, count, pool, filled, found)
    return True


@kernel
def split_fan(corner, h, g, inside, fan):
    """The triangles around a vertex put into the face or the edge of h; returns their number."""
    a, b, c = corner[h], corner[following(h)], corner[preceding(h)]
    put_row(fan, 0, h // 3, b, c)
    put_row(fan, 1, h // 3, c, a)
    if inside:
        put_row(fan, 2, h // 3, a, b)
        return 3
    if g < 0:
        return 2
    d = corner[preceding(g)]
    put_row(fan, 2, g // 3, a, d)
    put_row(fan, 3, g // 3, d, b)
    return 4


@allocating
def sweep_inserts(state, samples, counts, figures, faces, targets, on_curves, pool, found):
    """Split faces or edges at points, or move corners there; returns the number of splits."""
    corner, twin, crease, _, first, _, points, normals, _ = state
    fan, star = np.empty((MOST_STAR, 6), np.int64), np.empty((MOST_STAR, 12))
    ring, one, triangle = np.empty(MOST_STAR, np.int64), np.empty((1, 3)), np.empty(12)
    x, normal = np.empty(3), np.empty(3)
    touched = np.zeros(samples[0].size, np.bool_)
    done = 0
    for i in range(faces.size):
        f = faces[i]
        if touched[f] or corner[3 * f] < 0:
            continue
        h = 3 * f
        weights = closest_corner_weights(
            points, corner[h], corner[h + 1], corner[h + 2], targets[i], triangle
        )
        low, high = 0, 0
        for k in range(1, 3):
            low = k if weights[k] < weights[low] else low
            high = k if weights[k] > weights[high] else high
        touched[f] = True
        if weights[high] > 1.0 - MIDDLE:
            v = corner[h + high]
            count = fill_fan(state, v, ring, ring_of(twin, first, v, ring), -1, fan, 0)
            for j in range(count):
                touched[fan[j, 0]] = True
            move_corner(state, samples, v, targets[i], figures, ring, fan, star, one, pool, found)
            continue
        inside = weights[low] > MIDDLE
        if not inside:
            h = 3 * f + (low + 1) % 3  # the edge opposite to that corner
        g = twin[h]
        if not inside and g >= 0 and touched[g // 3] and g // 3 != f:
            continue
        a, b = corner[h], corner[following(h)]
        square = 0.0
        for d in range(3):
            square += (points[a, d] - points[b, d]) ** 2
        if square < 4.0 * figures[7]:
            continue
        curved = not inside and crease[h] == 1
        for d in range(3):
            x[d] = on_curves[i, d] if curved else targets[i, d]
        mean_normal(normals, a, b, normal)
        count = split_fan(corner, h, g, inside, fan)
        if not fits(state, fan, star, count, normal, x, figures, one):
            for d in range(3):
                x[d] = 0.5 * (points[a, d] + points[b, d])
            if inside or curved or not fits(state, fan, star, count, normal, x, figures, one):
                continue
        filled = gather(samples[0], samples[1], f, pool, 0)
        if not inside and g >= 0:
            touched[g // 3] = True
            filled = gather(samples[0], samples[1], g // 3, pool, filled)
        m = put_vertex(state, counts, ON_CURVE if curved else INSIDE, normal, x)
        if inside:
            split_face(state, samples, counts, h, m)
        else:
            split_edge(state, samples, counts, h, m)
        count = fill_fan(state, m, ring, ring_of(twin, first, m, ring), -1, fan, 0)
        fill_star(points, fan, count, x, star)
        measure(state, samples, fan, star, count, x, pool, filled, FAR, -1.0, found)
        assign(samples, fan, count, pool, filled, found)
        done += 1
    return done
