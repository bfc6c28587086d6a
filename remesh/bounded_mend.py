"""Triangles that lie against the original's normals, or cannot be brought near it, are mended.

Edges of such a triangle are collapsed or flipped, or its corners moved, if that leaves fewer such
triangles around and the samples within the bound. A triangle that was handed in counts as one,
though its own centroid may show nothing.
"""

import numpy as np

from meshes.closest_point_kernels import FAR, STACK
from remesh.bounded_collapse import NO_COST, sweep_collapses
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
from remesh.bounded_mesh import INSIDE
from remesh.bounded_original import place_near, wrong_count
from remesh.bounded_relax import fill_flipped, flip, joined, quad_measure
from remesh.compiled import allocating, kernel
from remesh.connectivity import following, preceding

ANY_COST = 1e100
# Of the way from a corner to the middle of its neighbours; negative: onto the original.
SHARES = (-1.0, 1.0, 0.5, 0.25, 0.75, 0.125)
LEAST_SHAPE = 0.01  # height over longest edge


def untangle(work, faces, limits, moves_first=False):
    """Mend faces (k,) of the work mesh; return how many changes were made.

    moves_first : before flips; in turn, so that the same flips are not made and undone again.
    """
    figures = limits.figures()
    figures = (figures[0], min(figures[1], LEAST_SHAPE), -1.0, *figures[3:])
    pool, found = (np.empty(len(work.samples[2]), np.int64) for _ in range(2))
    cost = np.full(len(work.state[0]), FAR)
    cost[(3 * faces[:, None] + np.arange(3)).ravel()] = NO_COST
    twins = work.state[1][(3 * faces[:, None] + np.arange(3)).ravel()]
    cost[twins[twins >= 0]] = NO_COST
    done = sweep_collapses(
        work.state, work.samples, work.counts, cost, ANY_COST, figures, work.reference,
        work.centre, pool, found,
    )  # fmt: skip
    return done + sweep_wrong(
        work.state, work.samples, figures[0], work.reference, faces, moves_first, pool, found
    )


@allocating
def sweep_wrong(state, samples, limit2, reference, faces, moves_first, pool, found):
    """Flip an edge of each face, or move a corner; returns how many changes were made."""
    corner = state[0]
    fan, star = np.zeros((MOST_STAR, 6), np.int64), np.empty((MOST_STAR, STAR_WIDTH))
    ring, x = np.empty(MOST_STAR, np.int64), np.empty(3)
    nodes, squares = np.empty(STACK, np.int32), np.empty(STACK)
    original, room = (reference, nodes, squares), (fan, star, ring, x, pool, found)
    done = 0
    for f in faces:
        for turn in range(6):
            moving = (turn < 3) == moves_first
            if corner[3 * f] < 0:
                break
            h = 3 * f + turn % 3
            if moving and move_wrong(state, samples, corner[h], limit2, original, room):
                done += 1
            if not moving and flip_wrong(state, samples, h, limit2, original, room):
                done += 1
    return done


@kernel
def flip_wrong(state, samples, h, limit2, original, room):
    """Flip an inner edge if that leaves fewer wrong triangles; whether it did."""
    corner, twin, crease, _, first, _, points, _, _ = state
    reference, nodes, squares = original
    fan, star, _, _, pool, found = room
    g = twin[h]
    if g < 0 or crease[h] == 1:
        return False
    a, b = corner[h], corner[g]
    c, d = corner[preceding(h)], corner[preceding(g)]
    if c == d or joined(twin, corner, first, c, d):
        return False
    filled = gather(samples[0], samples[1], h // 3, pool, 0)
    filled = gather(samples[0], samples[1], g // 3, pool, filled)
    if filled == 0:
        return False
    t = samples[6][pool[0]]
    fill_flipped(state, h, fan)
    fill_triangle(points, a, b, c, star, 0)
    fill_triangle(points, b, a, d, star, 1)
    before = max(wrong_count(star, 2, limit2, t, reference, nodes, squares), 1)
    old = quad_measure(points, samples, fan, star, pool, filled, limit2, -1.0, found)
    fill_triangle(points, c, d, b, star, 0)
    fill_triangle(points, d, c, a, star, 1)
    if min(least_sine(star, 0)[0], least_sine(star, 1)[0]) < LEAST_SHAPE:
        return False
    if wrong_count(star, 2, limit2, t, reference, nodes, squares) >= before:
        return False
    new = quad_measure(points, samples, fan, star, pool, filled, limit2, -1.0, found)
    if new < 0.0 and old >= 0.0:
        return False
    flip(state, h)
    assign(samples, fan, 2, pool, filled, found)
    return True


@kernel
def candidate(points, ring, count, corner, v, k, place, x):
    """Fill x (3,) with the k-th place to try for v.

    First on the original, closest to v, then on the way to the mean of the neighbours.
    """
    t, p, q, flat = place
    share = SHARES[k]
    for d in range(3):
        if share < 0.0:
            x[d] = flat[t, d] + p * flat[t, 3 + d] + q * flat[t, 6 + d]
            continue
        total = 0.0
        for i in range(count):
            total += points[corner[following(ring[i])], d]
        x[d] = (1.0 - share) * points[v, d] + share * total / count


@kernel
def move_wrong(state, samples, v, limit2, original, room):
    """Move a vertex inside of a patch if that leaves fewer wrong triangles; whether it did."""
    corner, twin, _, _, first, kind, points, _, _ = state
    reference, nodes, squares = original
    fan, star, ring, x, pool, found = room
    if kind[v] != INSIDE:
        return False
    around = ring_of(twin, first, v, ring)
    count = fill_fan(state, v, ring, around, -1, fan, 0)
    filled = gather_fan(samples, fan, count, pool)
    if count == 0 or filled == 0:
        return False
    t = samples[6][pool[0]]
    fill_star(points, fan, count, points[v], star)
    before = max(wrong_count(star, count, limit2, t, reference, nodes, squares), 1)
    old = measure(state, samples, fan, star, count, points[v], pool, filled, limit2, -1.0, found)
    t, p, q, _ = place_near(
        points[v, 0], points[v, 1], points[v, 2], -1.0, t, reference, nodes, squares
    )
    for k in range(len(SHARES)):
        candidate(points, ring, around, corner, v, k, (t, p, q, reference[0][3]), x)
        fill_star(points, fan, count, x, star)
        shape = FAR
        for i in range(count):
            shape = min(shape, least_sine(star, i)[0])
        if shape < LEAST_SHAPE:
            continue
        if wrong_count(star, count, limit2, t, reference, nodes, squares) >= before:
            continue
        new = measure(state, samples, fan, star, count, x, pool, filled, limit2, -1.0, found)
        if new < 0.0 and old >= 0.0:
            continue
        if new < 0.0:  # to have them all assigned
            measure(state, samples, fan, star, count, x, pool, filled, FAR, -1.0, found)
        for d in range(3):
            points[v, d] = x[d]
        assign(samples, fan, count, pool, filled, found)
        return True
    return False
