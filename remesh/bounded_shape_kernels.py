"""Kernels that better the shapes of triangles within an error bound: moves, flips and halvings.

The cost of a triangle is that of its least angle a, in space or in the embedding (x, sigma n),

    ((60 - a) / 30)^2 + WEIGHT (1 - slack)^2 where slack < 1,

and its slack the least of a over its floor and, where sigma > 0, the least angle in space over a
floor of its own. `aims` is (sigma^2, floor,
floor in space [degrees], squared bound); `embedded` (n, 3) the
original's unit normal at every vertex; on features that of the triangle itself counts, as there is
one for every patch. `open_to` (n,) int8 says which vertices' triangles may change: CLOSED, OPEN, or
AT_REST where nothing could be bettered since something changed there. An operation is made
if it lowers the cost, leaves no triangle below its floor with less slack than there was, and keeps
the samples within the bound.
"""

import math

import numpy as np

from meshes.closest_point_kernels import FAR, STACK
from meshes.distance_bound_kernels import MOST_WAITING
from remesh.bounded_insert import split_at
from remesh.bounded_kernels import (
    MOST_STAR,
    STAR_WIDTH,
    WORSE,
    assign,
    fill_fan,
    fill_star,
    fill_triangle,
    gather,
    gather_fan,
    measure,
    nearest_curve,
    ring_of,
    segment_square,
    star_shape,
    turn_between,
)
from remesh.bounded_mesh import FIXED, INSIDE
from remesh.bounded_original import leaves_original, place_near, strays
from remesh.bounded_relax import (
    fill_flipped,
    flip,
    flipped_leaves,
    joined,
    looks_down,
    quad_measure,
    quad_shape,
)
from remesh.compiled import allocating, kernel
from remesh.connectivity import following, preceding
from remesh.embedding import degrees_of, least_angle

CLOSED, OPEN, AT_REST = 0, 1, 2
WEIGHT = 20.0
BETTER = 0.99  # of the cost
TRIES = 14
SHARES = (1.0, 0.5)  # of the way to the neighbours' mean, the first tries
STEPS = (0.3, 0.08)  # of the mean spoke, in six directions each
TURNS = ((1.0, 0.0), (0.5, 0.866), (-0.5, 0.866), (-1.0, 0.0), (-0.5, -0.866), (0.5, -0.866))
LONGEST_WALK = 60  # triangles to a terminal edge


@kernel
def put_normal(room, k, star, i, kind, embedded, v):
    """Row k of room: the unit normal of vertex v in a star's triangle."""
    size = math.sqrt(star[i, 9] ** 2 + star[i, 10] ** 2 + star[i, 11] ** 2)
    inside = kind[v] == INSIDE
    for d in range(3):
        room[k, d] = embedded[v, d] if inside else star[i, 9 + d] / max(size, 1e-300)


@kernel
def triangle_cost(star, i, corners, kind, embedded, hub, aims, room):
    """Cost and slack of a star's triangle with vertices `corners`.

    hub (3,) is the unit normal of the first vertex. room (3, 3) is to work in.
    """
    sigma2, floor, floor3, _ = aims
    uu = star[i, 3] ** 2 + star[i, 4] ** 2 + star[i, 5] ** 2
    vv = star[i, 6] ** 2 + star[i, 7] ** 2 + star[i, 8] ** 2
    ww = 0.0
    for d in range(3):
        ww += (star[i, 3 + d] - star[i, 6 + d]) ** 2
    sine, cosine = least_angle(uu, vv, ww)
    angle = degrees_of(sine, cosine)
    slack = angle / floor
    if sigma2 > 0.0:
        slack = angle / floor3
        for k in range(3):
            put_normal(room, k, star, i, kind, embedded, corners[k])
        if kind[corners[0]] == INSIDE:
            for d in range(3):
                room[0, d] = hub[d]
        uu += sigma2 * turn_between(room, 0, room, 1)
        vv += sigma2 * turn_between(room, 0, room, 2)
        ww += sigma2 * turn_between(room, 1, room, 2)
        sine, cosine = least_angle(uu, vv, ww)
        angle = degrees_of(sine, cosine)
        slack = min(slack, angle / floor)
    cost = ((60.0 - angle) / 30.0) ** 2
    if slack < 1.0:
        cost += WEIGHT * (1.0 - slack) ** 2
    return cost, slack


@kernel
def star_cost(state, fan, star, count, v, embedded, hub, aims, corners, room):
    """Cost of a star about vertex v, and its least slack; hub (3,) is the normal there."""
    total, least = 0.0, FAR
    corners[0] = v
    for i in range(count):
        corners[1], corners[2] = fan[i, 1], fan[i, 2]
        cost, slack = triangle_cost(star, i, corners, state[5], embedded, hub, aims, room)
        total += cost
        least = min(least, slack)
    return total, least


@kernel
def quad_cost(state, star, turned, embedded, aims, corners, room):
    """Cost and least slack of two triangles: (a, b, c) and (b, a, d) of `turned` (4,)."""
    total, least = 0.0, FAR
    for i in range(2):
        corners[0], corners[1] = turned[i], turned[1 - i]
        corners[2] = turned[2 + i]
        hub = embedded[corners[0]]
        cost, slack = triangle_cost(star, i, corners, state[5], embedded, hub, aims, room)
        total += cost
        least = min(least, slack)
    return total, least


@allocating
def measure_shapes(state, faces, aims, embedded, costs, slacks):
    """Write cost and slack of faces (k,)."""
    corner, points = state[0], state[6]
    star, corners, room = np.empty((1, STAR_WIDTH)), np.empty(3, np.int64), np.empty((3, 3))
    for i in range(faces.size):
        for k in range(3):
            corners[k] = corner[3 * faces[i] + k]
        fill_triangle(points, corners[0], corners[1], corners[2], star, 0)
        hub = embedded[corners[0]]
        costs[i], slacks[i] = triangle_cost(star, 0, corners, state[5], embedded, hub, aims, room)


@allocating
def embed_vertices(state, counts, reference, embedded):
    """Fill embedded (n, 3) with the original's unit normals closest to the vertices."""
    first, points = state[4], state[6]
    nodes, squares, foot = np.empty(STACK, np.int32), np.empty(STACK), np.empty(3)
    t = 0
    for v in range(counts[0]):
        if first[v] >= 0:
            t = foot_near(points[v], t, reference, nodes, squares, foot, embedded[v])


@kernel
def foot_near(x, t, reference, nodes, squares, foot, normal):
    """Fill foot (3,) with the original's point closest to x, and normal (3,) there; its place."""
    t, v, w, _ = place_near(x[0], x[1], x[2], -1.0, t, reference, nodes, squares)
    flat, normals, size = reference[0][3], reference[2], 0.0
    for d in range(3):
        foot[d] = flat[t, d] + v * flat[t, 3 + d] + w * flat[t, 6 + d]
        normal[d] = (1.0 - v - w) * normals[t, d] + v * normals[t, 3 + d] + w * normals[t, 6 + d]
        size += normal[d] ** 2
    size = math.sqrt(size)
    for d in range(3):
        normal[d] = normal[d] / size if size > 0.0 else 0.0
    return t


@kernel
def all_open(open_to, fan, count, v):
    """Whether v is not at rest, and all triangles of the fan around it may change."""
    for i in range(count):
        if open_to[fan[i, 1]] == CLOSED or open_to[fan[i, 2]] == CLOSED:
            return False
    return open_to[v] == OPEN


@kernel
def wake(open_to, fan, count):
    """Mark the vertices of a fan's triangles for new tries."""
    for i in range(count):
        open_to[fan[i, 1]] = open_to[fan[i, 2]] = OPEN


@kernel
def any_strays(star, count, limit2, t, reference, nodes, squares, pieces):
    """Whether one of a star's triangles is not within the distance of the original; see there."""
    found = False
    for i in range(count):
        found = found or strays(star, i, limit2, t, reference, nodes, squares, pieces)
    return found


@kernel
def put_try(points, v, star, count, k, normal, x):
    """Fill x (3,) with the k-th place in the plane through v across the normal to try for it."""
    if k < len(SHARES):
        for d in range(3):
            total = 0.0
            for i in range(count):
                total += star[i, 3 + d]
            x[d] = points[v, d] + SHARES[k] * total / count
        return
    k -= len(SHARES)
    length = 0.0
    for i in range(count):
        length += math.sqrt(star[i, 3] ** 2 + star[i, 4] ** 2 + star[i, 5] ** 2) / count
    ux, uy, uz = star[0, 3], star[0, 4], star[0, 5]
    along = ux * normal[0] + uy * normal[1] + uz * normal[2]
    ux, uy, uz = ux - along * normal[0], uy - along * normal[1], uz - along * normal[2]
    size = math.sqrt(ux * ux + uy * uy + uz * uz)
    length *= STEPS[k // 6] / size if size > 0.0 else 0.0
    wx = normal[1] * uz - normal[2] * uy
    wy = normal[2] * ux - normal[0] * uz
    wz = normal[0] * uy - normal[1] * ux
    c, s = length * TURNS[k % 6][0], length * TURNS[k % 6][1]
    x[0] = points[v, 0] + c * ux + s * wx
    x[1] = points[v, 1] + c * uy + s * wy
    x[2] = points[v, 2] + c * uz + s * wz


@kernel
def lies_on_spoke(points, fan, star, count, v, x):
    """Whether of a star's feature edges one that ends at v is the nearest to x (3,)."""
    _, least = nearest_curve(points, fan, star, count, x[0], x[1], x[2], points[v])
    for i in range(count):
        for k in range(2):
            if fan[i, 3 + 2 * k] == 1:
                square = segment_square(x[0], x[1], x[2], points[v], points[fan[i, 1 + k]])
                if square <= least:
                    return True
    return False


@kernel
def shortest_spoke(star, count):
    """Squared length of the shortest edge from a star's vertex."""
    least = FAR
    for i in range(count):
        for k in (3, 6):
            least = min(least, star[i, k] ** 2 + star[i, k + 1] ** 2 + star[i, k + 2] ** 2)
    return least


@allocating
def sweep_places(state, samples, counts, figures, reference, aims, embedded, open_to, pool, found):
    """One pass over the vertices, moved along the surface or their curve; returns how many."""
    _, twin, _, _, first, kind, points, normals, _ = state
    limit2, least_shape, least_agreement, cosine, _, _, _, shortest2 = figures
    ring, corners = np.empty(MOST_STAR, np.int64), np.empty(3, np.int64)
    fan, star = np.empty((MOST_STAR, 6), np.int64), np.empty((MOST_STAR, STAR_WIDTH))
    start, spokes = np.empty(3), np.empty((MOST_STAR, STAR_WIDTH))
    x, foot, normal, hub = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    one, room = np.empty((1, 3)), np.empty((3, 3))
    nodes, squares = np.empty(STACK, np.int32), np.empty(STACK)
    far2, pieces = aims[3], np.empty((MOST_WAITING + 4, 10))
    moved = 0
    for v in range(counts[0]):
        if first[v] < 0 or kind[v] == FIXED or open_to[v] != OPEN:
            continue
        count = fill_fan(state, v, ring, ring_of(twin, first, v, ring), -1, fan, 0)
        if count == 0 or not all_open(open_to, fan, count, v):
            continue
        filled = gather_fan(samples, fan, count, pool)
        if filled == 0:
            continue
        inside = kind[v] == INSIDE
        for d in range(3):
            start[d] = points[v, d]
        fill_star(points, fan, count, start, spokes)
        fill_star(points, fan, count, start, star)
        old = star_shape(state, fan, star, count, normals[v], figures, one)
        cost, slack = star_cost(
            state, fan, star, count, v, embedded, embedded[v], aims, corners, room
        )
        near = foot_near(start, samples[6][pool[0]], reference, nodes, squares, foot, normal)
        offset = 0.0
        for d in range(3):
            offset += (start[d] - foot[d]) * normal[d]
            one[0, d] = normal[d]
        changed, short2 = False, min(shortest2, shortest_spoke(spokes, count))
        tries = TRIES if inside else filled
        for k in range(tries):
            if inside:
                put_try(points, v, spokes, count, k, normal, x)
                foot_near(x, near, reference, nodes, squares, foot, hub)
                for d in range(3):
                    x[d] = foot[d] + offset * hub[d]
            else:
                s = pool[k]
                if samples[3][s] == 0:
                    continue
                for d in range(3):
                    x[d] = samples[2][s, d]
                if not lies_on_spoke(points, fan, spokes, count, v, x):
                    continue
            fill_star(points, fan, count, x, star)
            after, least = star_cost(state, fan, star, count, v, embedded, hub, aims, corners, room)
            if after > BETTER * cost or least < min(slack, 1.0):
                continue
            if shortest_spoke(star, count) < short2:
                continue
            shape, agree, excess = star_shape(state, fan, star, count, normals[v], figures, one)
            if shape < min(least_shape, WORSE * old[0]) or shape <= 0.0:
                continue
            if agree < min(least_agreement, WORSE * old[1]) or excess > max(1.0, old[2]):
                continue
            if (
                measure(state, samples, fan, star, count, x, pool, filled, limit2, cosine, found)
                < 0.0
            ):
                continue
            if leaves_original(star, count, x, far2, near, reference, nodes, squares):
                continue
            if any_strays(star, count, far2, near, reference, nodes, squares, pieces):
                continue
            cost, slack, changed = after, least, True
            for d in range(3):
                points[v, d] = x[d]
                if inside:
                    embedded[v, d] = hub[d]
        if changed:
            fill_star(points, fan, count, points[v], star)
            measure(state, samples, fan, star, count, points[v], pool, filled, FAR, -1.0, found)
            assign(samples, fan, count, pool, filled, found)
            wake(open_to, fan, count)
            moved += 1
        else:
            open_to[v] = AT_REST
    return moved


@allocating
def sweep_turns(state, samples, counts, figures, reference, aims, embedded, open_to, pool, found):
    """One pass over the edges inside of patches; returns how many were flipped."""
    corner, twin, crease, _, first, _, points, normals, _ = state
    limit2, least_shape, least_agreement, cosine, longest2, longest6, sigma2, shortest2 = figures
    fan, star, up = np.zeros((2, 6), np.int64), np.empty((2, STAR_WIDTH)), np.empty(3)
    quad, corners, room = np.empty(4, np.int64), np.empty(3, np.int64), np.empty((3, 3))
    nodes, squares = np.empty(STACK, np.int32), np.empty(STACK)
    far2, pieces = aims[3], np.empty((MOST_WAITING + 4, 10))
    flipped = 0
    for h in range(3 * counts[1]):
        g = twin[h]
        if corner[h] < 0 or g < h or crease[h] == 1:
            continue
        a, b = corner[h], corner[g]
        c, d = corner[preceding(h)], corner[preceding(g)]
        low = min(min(open_to[a], open_to[b]), min(open_to[c], open_to[d]))
        if low != OPEN:
            continue
        fill_triangle(points, a, b, c, star, 0)
        fill_triangle(points, b, a, d, star, 1)
        quad[0], quad[1], quad[2], quad[3] = a, b, c, d
        cost, slack = quad_cost(state, star, quad, embedded, aims, corners, room)
        old_sine, old_agree = quad_shape(normals, star, a, b, c, d)
        for k in range(3):
            up[k] = star[0, 9 + k] + star[1, 9 + k]
        fill_triangle(points, c, d, b, star, 0)
        fill_triangle(points, d, c, a, star, 1)
        quad[0], quad[1], quad[2], quad[3] = c, d, b, a
        after, least = quad_cost(state, star, quad, embedded, aims, corners, room)
        if after > BETTER * cost or least < min(slack, 1.0):
            continue
        if c == d or joined(twin, corner, first, c, d):
            continue
        filled = gather(samples[0], samples[1], h // 3, pool, 0)
        filled = gather(samples[0], samples[1], g // 3, pool, filled)
        if filled == 0:
            continue
        fill_flipped(state, h, fan)
        sine, agree = quad_shape(normals, star, c, d, b, a)
        if sine < min(least_shape, WORSE * old_sine) or sine <= 0.0:
            continue
        if agree < min(least_agreement, WORSE * old_agree) or looks_down(star, up):
            continue
        length = star[0, 3] ** 2 + star[0, 4] ** 2 + star[0, 5] ** 2
        if length > longest2 or length < shortest2:
            continue
        if length + sigma2 * turn_between(normals, c, normals, d) > longest6:
            continue
        if quad_measure(points, samples, fan, star, pool, filled, limit2, cosine, found) < 0.0:
            continue
        near = samples[6][pool[0]]
        if flipped_leaves(star, far2, near, reference, nodes, squares):
            continue
        if any_strays(star, 2, far2, near, reference, nodes, squares, pieces):
            continue
        flip(state, h)
        assign(samples, fan, 2, pool, filled, found)
        wake(open_to, fan, 2)
        flipped += 1
    return flipped


@kernel
def longest_side(state, h, embedded, sigma2):
    """The half-edge of the longest edge, in the embedding, of the face of h."""
    corner, points = state[0], state[6]
    best, most = h, -1.0
    for _ in range(3):
        a, b = corner[h], corner[following(h)]
        square = sigma2 * turn_between(embedded, a, embedded, b)
        for d in range(3):
            square += (points[a, d] - points[b, d]) ** 2
        # the same from both sides
        if square > most:
            best, most = h, square
        h = following(h)
    return best


@kernel
def terminal_edge(state, h, embedded, sigma2):
    """An edge that is the longest of both its faces: on the way over longest edges from a face."""
    twin = state[1]
    h = longest_side(state, h, embedded, sigma2)
    for _ in range(LONGEST_WALK):
        g = twin[h]
        if g < 0:
            break
        other = longest_side(state, g, embedded, sigma2)
        if other == g:
            break
        h = other
    return h


@kernel
def between_features(state, f):
    """Whether the shortest edge of face f lies opposite to two feature edges that meet."""
    corner, crease, points = state[0], state[2], state[6]
    best, least = 3 * f, FAR
    for k in range(3):
        a, b = corner[3 * f + k], corner[3 * f + (k + 1) % 3]
        square = 0.0
        for d in range(3):
            square += (points[a, d] - points[b, d]) ** 2
        if square < least:
            best, least = 3 * f + k, square
    return crease[following(best)] == 1 and crease[preceding(best)] == 1


@allocating
def halve_faces(
    state, samples, counts, faces, shortest2, held, reference, sigma2, embedded, open_to,
    touched, pool, found,
):  # fmt: skip
    """Halve terminal edges near faces (k,), as long as there is room; returns how many.

    Edges shorter than the square root of shortest2, and boundaries if `held`, stay. touched (f,)
    bool is true for faces that are not to be cut (again).
    """
    corner, twin, _, _, _, _, points, _, _ = state
    fan, star = np.empty((MOST_STAR, 6), np.int64), np.empty((MOST_STAR, STAR_WIDTH))
    room = (fan, star, np.empty(MOST_STAR, np.int64), np.empty(3), pool, found)
    nodes, squares = np.empty(STACK, np.int32), np.empty(STACK)
    original = (reference, nodes, squares)
    x, foot, done = np.empty(3), np.empty(3), 0
    for f in faces:
        if corner[3 * f] < 0 or touched[f]:
            continue
        h = terminal_edge(state, 3 * f, embedded, sigma2)
        g = twin[h]
        if touched[h // 3] or (g < 0 and held) or (g >= 0 and touched[g // 3]):
            continue
        a, b, c = corner[h], corner[following(h)], corner[preceding(h)]
        if open_to[a] == CLOSED or open_to[b] == CLOSED or open_to[c] == CLOSED:
            continue
        d = corner[preceding(g)] if g >= 0 else c
        if open_to[d] == CLOSED:
            continue
        for k in range(3):
            x[k] = 0.5 * (points[a, k] + points[b, k])
        if not split_at(state, samples, counts, h, False, x, 0.25 * shortest2, original, room):
            continue
        open_to[a] = open_to[b] = open_to[c] = open_to[d] = OPEN
        m = counts[0] - 1
        foot_near(x, 0, reference, nodes, squares, foot, embedded[m])
        touched[h // 3] = True
        if g >= 0:
            touched[g // 3] = True
        done += 1
    return done
