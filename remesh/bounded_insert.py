"""Points of the original put into triangles that miss it by too much: the end of `bounded`."""

import math

import numpy as np

from meshes.closest_point_kernels import FAR, STACK, closest_on_triangle
from remesh.bounded_kernels import (
    MOST_STAR,
    STAR_WIDTH,
    assign,
    fill_fan,
    fill_star,
    fill_triangle,
    gather,
    gather_fan,
    least_sine,
    measure,
    ring_of,
)
from remesh.bounded_mesh import INSIDE, ON_CURVE
from remesh.bounded_original import inverted_count, place_near
from remesh.compiled import allocating, kernel
from remesh.connectivity import following, preceding

MIDDLE = 0.12  # barycentric coordinate above which a point lies inside, not near an edge
LEAST_SHAPE = 0.01  # height over longest edge, of the triangles that a point makes
LEAST_HALVED = 36.0  # of the squared bound: an edge cut in its middle


def insert_points(work, faces, places, targets, on_curves, limits, may_move=True):
    """Put points into faces or their edges; return how many.

    Parameters
    ----------
    work : BoundedMesh
    faces : (k,) int array
        Faces of the work mesh; of two for one face the first counts.
    places : (k, 3) float array
        Where in the faces.
    targets : (k, 3) float array
        Points of the original that the surface is to go through there.
    on_curves : (k, 3) float array
        Points of its feature edges, for where such an edge has to be split.
    limits : BoundLimits
    may_move : bool
        Whether corners near the places may move there instead.
    """
    work.reserve(len(faces))
    room = len(work.samples[2])
    return sweep_inserts(
        work.state, work.samples, work.counts, limits.figures(), work.reference,
        faces, places, targets, on_curves, may_move,
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
def closest_corner_weights(points, a, b, c, place, triangle):
    """Weights of the corners of the point of triangle (a, b, c) closest to a place."""
    for d in range(3):
        triangle[d] = points[a, d]
        triangle[3 + d] = points[b, d] - points[a, d]
        triangle[6 + d] = points[c, d] - points[a, d]
    triangle[9] = triangle[4] * triangle[8] - triangle[5] * triangle[7]
    triangle[10] = triangle[5] * triangle[6] - triangle[3] * triangle[8]
    triangle[11] = triangle[3] * triangle[7] - triangle[4] * triangle[6]
    v, w, _ = closest_on_triangle(place[0], place[1], place[2], triangle, FAR)
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
def fill_face(points, corner, f, star, i):
    """Row i of a star for face f as it is."""
    fill_triangle(points, corner[3 * f], corner[3 * f + 1], corner[3 * f + 2], star, i)


@kernel
def place_of(samples, pool, filled, x, reference, nodes, squares):
    """A place of the original near x: that of a sample, if there is one."""
    if filled > 0:
        return samples[6][pool[0]]
    t, _, _, _ = place_near(x[0], x[1], x[2], -1.0, 0, reference, nodes, squares)
    return t


@kernel
def fits(star, count, before, t, reference, nodes, squares):
    """Whether a star's triangles are well shaped, and none lies against the original's normals.

    Unless there were such triangles before.
    """
    for i in range(count):
        if not least_sine(star, i)[0] > LEAST_SHAPE:
            return False
    return before > 0 or inverted_count(star, count, t, reference, nodes, squares) == 0


@kernel
def move_corner(state, samples, v, x, original, room):
    """Move a vertex inside of a patch to x, if that leaves good triangles; whether it moved."""
    _, twin, _, _, first, kind, points, _, _ = state
    reference, nodes, squares = original
    fan, star, ring, _, pool, found = room
    if kind[v] != INSIDE:
        return False
    count = fill_fan(state, v, ring, ring_of(twin, first, v, ring), -1, fan, 0)
    if count == 0:
        return False
    filled = gather_fan(samples, fan, count, pool)
    t = place_of(samples, pool, filled, x, reference, nodes, squares)
    fill_star(points, fan, count, points[v], star)
    before = inverted_count(star, count, t, reference, nodes, squares)
    fill_star(points, fan, count, x, star)
    if not fits(star, count, before, t, reference, nodes, squares):
        return False
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


@kernel
def choose_split(points, corner, f, weights, attempt, shortest2, x, target):
    """Where to split face f: (half-edge, whether inside of the face); fills x (3,).

    The half-edge is -1 if nowhere.

    First at the target, inside of the face or at the edge next to it; then at that edge in any
    case; last in the middle of the longest edge, if it is not too short.
    """
    low, longest, most = 0, 0, -1.0
    for k in range(3):
        low = k if weights[k] < weights[low] else low
        a, b = corner[3 * f + k], corner[3 * f + (k + 1) % 3]
        square = 0.0
        for d in range(3):
            square += (points[a, d] - points[b, d]) ** 2
        if square > most:
            longest, most = k, square
    for d in range(3):
        x[d] = target[d]
    if attempt == 0 and weights[low] > MIDDLE:
        return 3 * f, True
    if attempt < 2:
        return 3 * f + (low + 1) % 3, False  # the edge opposite to that corner
    if most < shortest2:
        return -1, False
    a, b = corner[3 * f + longest], corner[3 * f + (longest + 1) % 3]
    for d in range(3):
        x[d] = 0.5 * (points[a, d] + points[b, d])
    return 3 * f + longest, False


@kernel
def split_at(state, samples, counts, h, inside, x, shortest2, original, room):
    """Split the face or the edge of half-edge h at x, if that leaves good triangles.

    Returns whether it did. original : (reference, nodes, squares);
    room : (fan, star, ring, normal, pool, found)
    """
    corner, twin, crease, _, first, _, points, normals, _ = state
    reference, nodes, squares = original
    fan, star, ring, normal, pool, found = room
    g = -1 if inside else twin[h]
    a, b = corner[h], corner[following(h)]
    square = 0.0
    for d in range(3):
        square += (points[a, d] - points[b, d]) ** 2
    if square < 4.0 * shortest2:
        return False
    filled = gather(samples[0], samples[1], h // 3, pool, 0)
    fill_face(points, corner, h // 3, star, 0)
    if g >= 0:
        filled = gather(samples[0], samples[1], g // 3, pool, filled)
        fill_face(points, corner, g // 3, star, 1)
    t = place_of(samples, pool, filled, x, reference, nodes, squares)
    before = inverted_count(star, 2 if g >= 0 else 1, t, reference, nodes, squares)
    count = split_fan(corner, h, g, inside, fan)
    fill_star(points, fan, count, x, star)
    if not fits(star, count, before, t, reference, nodes, squares):
        return False
    mean_normal(normals, a, b, normal)
    curved = not inside and crease[h] == 1
    m = put_vertex(state, counts, ON_CURVE if curved else INSIDE, normal, x)
    if inside:
        split_face(state, samples, counts, h, m)
    else:
        split_edge(state, samples, counts, h, m)
    count = fill_fan(state, m, ring, ring_of(twin, first, m, ring), -1, fan, 0)
    fill_star(points, fan, count, x, star)
    measure(state, samples, fan, star, count, x, pool, filled, FAR, -1.0, found)
    assign(samples, fan, count, pool, filled, found)
    return True


@allocating
def sweep_inserts(
    state, samples, counts, figures, reference, faces, places, targets, on_curves, may_move,
    pool, found,
):  # fmt: skip
    """Split faces or edges at points, or move corners there; returns the number of splits."""
    corner, twin, crease, _, first, _, points, _, _ = state
    fan, star = np.empty((MOST_STAR, 6), np.int64), np.empty((MOST_STAR, STAR_WIDTH))
    ring, triangle = np.empty(MOST_STAR, np.int64), np.empty(12)
    x, halved2 = np.empty(3), LEAST_HALVED * figures[0]
    room = (fan, star, ring, np.empty(3), pool, found)
    original = (reference, np.empty(STACK, np.int32), np.empty(STACK))
    touched = np.zeros(samples[0].size, np.bool_)
    done = 0
    for i in range(faces.size):
        f = faces[i]
        if touched[f] or corner[3 * f] < 0:
            continue
        weights = closest_corner_weights(
            points, corner[3 * f], corner[3 * f + 1], corner[3 * f + 2], places[i], triangle
        )
        high = 0
        for k in range(1, 3):
            high = k if weights[k] > weights[high] else high
        begin = 0
        if weights[high] > 1.0 - MIDDLE:
            v, begin = corner[3 * f + high], 2
            if may_move and move_corner(state, samples, v, targets[i], original, room):
                count = fill_fan(state, v, ring, ring_of(twin, first, v, ring), -1, fan, 0)
                for j in range(count):
                    touched[fan[j, 0]] = True
                continue
        for attempt in range(begin, 3):
            h, inside = choose_split(points, corner, f, weights, attempt, halved2, x, targets[i])
            if h < 0:
                continue
            g = twin[h]
            if not inside and g >= 0 and touched[g // 3]:
                continue
            if not inside and crease[h] == 1:
                for d in range(3):
                    x[d] = on_curves[i, d]
            if split_at(state, samples, counts, h, inside, x, figures[7], original, room):
                touched[f] = True
                if not inside and g >= 0:
                    touched[g // 3] = True
                done += 1
                break
    return done
