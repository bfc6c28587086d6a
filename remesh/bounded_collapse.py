"""Edge collapses that keep all samples of the original within an error bound.

The order is that of quadric errors (Garland and Heckbert 1997, per area), in passes with a rising
threshold; whether a collapse is made is decided by the samples alone, so that every triangle may
use the whole bound.
"""

import math

import numpy as np

from meshes.closest_point_kernels import FAR, STACK
from remesh.bounded_kernels import (
    MOST_STAR,
    STAR_WIDTH,
    WORSE,
    assign,
    fill_fan,
    fill_star,
    gather,
    measure,
    ring_of,
    star_shape,
)
from remesh.bounded_mesh import FIXED, INSIDE
from remesh.bounded_original import leaves_original
from remesh.compiled import allocating, kernel
from remesh.connectivity import following, preceding

FIRST_COST, LAST_COST, GROWTH = 0.02, 2.0, 1.5  # of the bound; of the squared cost per pass
PULL = 1e-4  # towards the middle of the edge, where the quadric leaves a direction free
LENGTH_COST = 1e-5  # of the squared edge: shorter ones first where the surface is flat
LAST_SWEEPS, FEW = 3, 0.005
NO_COST = -1.0


def collapse_within(work, limits, last_cost=LAST_COST):
    """Collapse edges as long as the samples allow it; return how many.

    Parameters
    ----------
    work : BoundedMesh
    limits : BoundLimits
    last_cost : float
        Mean distance from the planes of the original up to which edges are tried, in bounds.
    """
    cost = np.full(len(work.state[0]), NO_COST)
    total, threshold = 0, FIRST_COST
    figures = limits.figures()
    while True:
        total += _sweep(work, cost, threshold * limits.error, figures)
        if threshold >= last_cost:
            break
        threshold = min(threshold * math.sqrt(GROWTH), last_cost)
    for _ in range(LAST_SWEEPS):
        cost[cost == FAR] = NO_COST
        done = _sweep(work, cost, last_cost * limits.error, figures)
        total += done
        if done <= FEW * work.vertices:
            break
    return total


def _sweep(work, cost, threshold, figures):
    room = len(work.samples[2])
    return sweep_collapses(
        work.state, work.samples, work.counts, cost, threshold**2, figures,
        work.reference, work.centre,
        np.empty(room, np.int64), np.empty(room, np.int64),
    )  # fmt: skip


@kernel
def quadric_at(q, x, y, z):
    """Value of the quadric q (11,) at a point."""
    return (
        x * (q[0] * x + 2.0 * (q[1] * y + q[2] * z + q[6]))
        + y * (q[3] * y + 2.0 * (q[4] * z + q[7]))
        + z * (q[5] * z + 2.0 * q[8])
        + q[9]
    )


@kernel
def lowest_point(q, middle, x):
    """Fill x (3,) with the point where q, with a pull towards the middle, is lowest."""
    pull = PULL * (q[0] + q[3] + q[5]) + 1e-300
    a, b, c, d, e, f = q[0] + pull, q[1], q[2], q[3] + pull, q[4], q[5] + pull
    r, s, t = pull * middle[0] - q[6], pull * middle[1] - q[7], pull * middle[2] - q[8]
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * aa + b * bb + c * cc
    if det <= 0.0:
        for k in range(3):
            x[k] = middle[k]
        return
    dd, ee, ff = a * f - c * c, b * c - a * e, a * d - b * b
    x[0] = (aa * r + bb * s + cc * t) / det
    x[1] = (bb * r + dd * s + ee * t) / det
    x[2] = (cc * r + ee * s + ff * t) / det


@kernel
def plan(state, h, centre, q, x):
    """Where the vertex of a collapsed edge goes: fills q (11,), x (3,); cost, or FAR if forbidden.

    q is in coordinates about the centre.
    """
    corner, _twin, crease, _, _, kind, points, _, quadrics = state
    u, v = corner[h], corner[following(h)]
    if kind[u] != INSIDE and kind[v] != INSIDE and crease[h] == 0:
        return FAR
    if kind[u] == FIXED and kind[v] == FIXED:
        return FAR
    for k in range(11):
        q[k] = quadrics[u, k] + quadrics[v, k]
    keep = u if kind[u] > kind[v] else v
    if kind[u] == kind[v]:
        for k in range(3):
            x[k] = 0.5 * (points[u, k] + points[v, k]) - centre[k]
        lowest_point(q, x, x)
    else:
        for k in range(3):
            x[k] = points[keep, k] - centre[k]
    length = 0.0
    for k in range(3):
        length += (points[u, k] - points[v, k]) ** 2
    value = max(quadric_at(q, x[0], x[1], x[2]), 0.0) / max(q[10], 1e-300)
    for k in range(3):
        x[k] = x[k] + centre[k] if kind[u] == kind[v] else points[keep, k]
    return value + LENGTH_COST * length


@kernel
def link_allows(state, h, ring_u, count_u, ring_v, count_v):
    """Whether a collapse leaves a manifold: only the two opposite corners neighbour both ends."""
    corner, twin, _, _, _first, _, _, _, _ = state
    g = twin[h]
    a = corner[preceding(h)]
    b = corner[preceding(g)] if g >= 0 else -1
    common = 0
    for i in range(-1, count_u):
        p = corner[following(ring_u[i])] if i >= 0 else corner[preceding(ring_u[count_u - 1])]
        if i < 0 and twin[preceding(ring_u[count_u - 1])] >= 0:
            continue
        for j in range(-1, count_v):
            q = corner[following(ring_v[j])] if j >= 0 else corner[preceding(ring_v[count_v - 1])]
            if j < 0 and twin[preceding(ring_v[count_v - 1])] >= 0:
                continue
            if p == q:
                common += 1
                if p != a and p != b:
                    return False
    return common == (2 if g >= 0 else 1)


@kernel
def has_three(twin, first, v):
    """Whether a vertex has exactly three faces around it, or one on a boundary."""
    h, count = first[v], 0
    while True:
        count += 1
        g = twin[preceding(h)]
        if g < 0:
            break
        h = g
        if h == first[v]:
            return count <= 3
    h = first[v]
    while twin[h] >= 0:
        h = following(twin[h])
        count += 1
    return count <= 1


@kernel
def joint_normal(kind, normals, u, v, result):
    """Fill result (3,) with the mean normal that two vertices have once they are one.

    On a curve or at a corner that of the vertex that stays: others would tilt it to one side.
    """
    for k in range(3):
        own_u, own_v = normals[u, k], normals[v, k]
        if kind[u] == kind[v]:
            result[k] = own_u + own_v
        else:
            result[k] = own_u if kind[u] > kind[v] else own_v


@kernel
def join(state, cost, h, x):
    """Collapse half-edge h into its end, which goes to x."""
    corner, twin, crease, _, first, kind, points, normals, quadrics = state
    u, v = corner[h], corner[following(h)]
    a = corner[preceding(h)]
    g = twin[h]
    start = first[u]
    i = start
    while True:  # all corners of u become v
        corner[i] = v
        j = twin[preceding(i)]
        if j < 0 or j == start:
            break
        i = j
    i = start
    while twin[i] >= 0:
        i = following(twin[i])
        if i == start:
            break
        corner[i] = v
    for k in range(3):
        points[v, k] = x[k]
    joint_normal(kind, normals, u, v, normals[v])
    for k in range(11):
        quadrics[v, k] += quadrics[u, k]
    kind[v] = max(kind[u], kind[v])
    first[u] = -1
    for side in range(2):
        e = h if side == 0 else g
        if e < 0:
            continue
        p, r = twin[following(e)], twin[preceding(e)]
        top = corner[preceding(e)]
        marked = max(crease[following(e)], crease[preceding(e)])
        if p >= 0:
            twin[p] = r
            crease[p] = marked
        if r >= 0:
            twin[r] = p
            crease[r] = marked
        # p leaves top and r ends there, seen from outside of the face
        first[top] = p if p >= 0 and corner[p] == top else following(r)
        if side == 0:
            first[v] = r if r >= 0 else following(p)
        for k in range(3):
            corner[e - e % 3 + k] = -1
    return a


@kernel
def forget_costs(state, cost, v, ring):
    """Mark the edges around v for a new evaluation."""
    twin, first = state[1], state[4]
    count = ring_of(twin, first, v, ring)
    for i in range(count):
        h = ring[i]
        cost[h] = -1.0
        if twin[h] >= 0:
            cost[twin[h]] = -1.0
        if twin[preceding(h)] < 0:
            cost[preceding(h)] = -1.0


@allocating
def sweep_collapses(
    state, samples, counts, cost, threshold2, figures, reference, centre, pool, found
):
    """One pass over all edges; returns the number of collapses.

    figures : (squared bound, least height over edge, least agreement, least cosine of samples,
        longest squared edge in 3D, in 6D, sigma^2, squared edge that is collapsed at any price)
    """
    corner, twin, _, _, first, kind, points, normals, _ = state
    limit2, least_shape, least_agreement, cosine, _, _, _, shortest2 = figures
    ring_u, ring_v = np.empty(MOST_STAR, np.int64), np.empty(MOST_STAR, np.int64)
    fan, star = np.empty((2 * MOST_STAR, 6), np.int64), np.empty((2 * MOST_STAR, STAR_WIDTH))
    q, x, normal, one = np.empty(11), np.empty(3), np.empty(3), np.empty((1, 3))
    nodes, squares = np.empty(STACK, np.int32), np.empty(STACK)
    done = 0
    for h in range(3 * counts[1]):
        if corner[h] < 0 or (twin[h] >= 0 and twin[h] < h) or cost[h] > threshold2:
            continue
        price = plan(state, h, centre, q, x)
        u, v = corner[h], corner[following(h)]
        square = 0.0
        for k in range(3):
            square += (points[u, k] - points[v, k]) ** 2
        forced = square < shortest2 and price < FAR
        cost[h] = price
        if price > threshold2 and not forced:
            continue
        cost[h] = FAR  # unless something changes around it
        count_u = ring_of(twin, first, u, ring_u)
        count_v = ring_of(twin, first, v, ring_v)
        if count_u == 0 or count_v == 0:
            continue
        if not link_allows(state, h, ring_u, count_u, ring_v, count_v):
            continue
        g = twin[h]
        if has_three(twin, first, corner[preceding(h)]):
            continue
        if g >= 0 and has_three(twin, first, corner[preceding(g)]):
            continue
        count = fill_fan(state, u, ring_u, count_u, v, fan, 0)
        half = count
        fill_star(points, fan, half, points[u], star)
        old = star_shape(state, fan, star, half, normals[u], figures, one)
        count = fill_fan(state, v, ring_v, count_v, u, fan, half)
        fill_star(points, fan[half:], count - half, points[v], star[half:])
        old_v = star_shape(state, fan[half:], star[half:], count - half, normals[v], figures, one)
        if count == 0 or count > MOST_STAR:
            continue
        joint_normal(kind, normals, u, v, normal)
        fill_star(points, fan, count, x, star)
        shape, agree, excess = star_shape(state, fan, star, count, normal, figures, one)
        if shape < min(least_shape, WORSE * min(old[0], old_v[0])) or shape <= 0.0:
            continue
        if agree < min(least_agreement, WORSE * min(old[1], old_v[1])):
            continue
        if excess > max(1.0, max(old[2], old_v[2])):
            continue
        filled = 0
        for i in range(count_u):
            filled = gather(samples[0], samples[1], ring_u[i] // 3, pool, filled)
        for i in range(count_v):
            if corner[following(ring_v[i])] != u and corner[preceding(ring_v[i])] != u:
                filled = gather(samples[0], samples[1], ring_v[i] // 3, pool, filled)
        allowed = FAR if forced else limit2
        if measure(state, samples, fan, star, count, x, pool, filled, allowed, cosine, found) < 0:
            continue
        if filled > 0:
            t = samples[6][pool[0]]
            if leaves_original(star, count, x, allowed, t, reference, nodes, squares):
                continue
        join(state, cost, h, x)
        assign(samples, fan, count, pool, filled, found)
        forget_costs(state, cost, v, ring_v)
        done += 1
    return done
