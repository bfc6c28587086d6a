"""Vertices moved and edges flipped so that samples of the original come closer.

Both lower the sum of the fourth powers of the samples' distances (in bounds), so that the largest
count most; what the bound forbids is never done.
"""

import math

import numpy as np

from meshes.closest_point_kernels import FAR, STACK, closest_on_triangle
from remesh.bounded_kernels import (
    MOST_STAR,
    STAR_WIDTH,
    WORSE,
    agreement_with,
    assign,
    closest_in_star,
    fill_fan,
    fill_star,
    fill_triangle,
    gather,
    gather_fan,
    least_sine,
    measure,
    nearest_curve,
    ring_of,
    star_shape,
    turn_between,
)
from remesh.bounded_mesh import INSIDE
from remesh.bounded_original import inverted_in, leaves_original, place_near
from remesh.compiled import allocating, kernel
from remesh.connectivity import following, preceding

DAMPING = 0.05
BETTER = 0.98
BASE_WEIGHT = 0.05


def relax_within(work, limits, rounds=2, chosen=None):
    """Move vertices and flip edges; return how many moves and flips were made.

    chosen : (n,) bool array, optional
        Vertices that may move, and whose edges may flip; all if not given.
    """
    if chosen is None:
        chosen = np.ones(len(work.state[4]), bool)
    figures = limits.figures()
    room = len(work.samples[2])
    pool, found = np.empty(room, np.int64), np.empty(room, np.int64)
    total = 0
    reference = work.reference
    for _ in range(rounds):
        for sweep in (sweep_flips, sweep_moves):
            total += sweep(
                work.state, work.samples, work.counts, figures, reference, chosen, pool, found
            )
    return total


@kernel
def solve_three(a, b, x):
    """Solve the symmetric positive definite system a x = b, a = (xx, xy, xz, yy, yz, zz)."""
    aa, bb, cc = a[3] * a[5] - a[4] * a[4], a[2] * a[4] - a[1] * a[5], a[1] * a[4] - a[2] * a[3]
    det = a[0] * aa + a[1] * bb + a[2] * cc
    dd, ee, ff = a[0] * a[5] - a[2] ** 2, a[1] * a[2] - a[0] * a[4], a[0] * a[3] - a[1] ** 2
    x[0] = (aa * b[0] + bb * b[1] + cc * b[2]) / det
    x[1] = (bb * b[0] + dd * b[1] + ee * b[2]) / det
    x[2] = (cc * b[0] + ee * b[1] + ff * b[2]) / det


@kernel
def best_move(samples, star, pool, filled, found, limit2, step, room):
    """Fill step (3,) with the move of a star's vertex that fits the samples best.

    Point to plane, weighted by the squared distance. room (9,) is to work in.
    """
    place, share = samples[2], samples[5]
    a, b = room[:6], room[6:9]
    a[:] = 0.0
    b[:] = 0.0
    for j in range(filled):
        s = pool[j]
        i = found[s]
        x, y, z = place[s, 0], place[s, 1], place[s, 2]
        v, w, square = closest_on_triangle(x, y, z, star[i], FAR)
        u = 1.0 - v - w
        nn = math.sqrt(star[i, 9] ** 2 + star[i, 10] ** 2 + star[i, 11] ** 2)
        if u <= 0.0 or nn <= 0.0:
            continue
        n0, n1, n2 = star[i, 9] / nn, star[i, 10] / nn, star[i, 11] / nn
        gap = (
            (x - star[i, 0] - v * star[i, 3] - w * star[i, 6]) * n0
            + (y - star[i, 1] - v * star[i, 4] - w * star[i, 7]) * n1
            + (z - star[i, 2] - v * star[i, 5] - w * star[i, 8]) * n2
        )
        weight = (BASE_WEIGHT + square / (limit2 * share[s])) * u
        b[0] += weight * gap * n0
        b[1] += weight * gap * n1
        b[2] += weight * gap * n2
        weight *= u
        a[0] += weight * n0 * n0
        a[1] += weight * n0 * n1
        a[2] += weight * n0 * n2
        a[3] += weight * n1 * n1
        a[4] += weight * n1 * n2
        a[5] += weight * n2 * n2
    extra = DAMPING * (a[0] + a[3] + a[5])
    if extra <= 0.0:
        return False
    a[0] += extra
    a[3] += extra
    a[5] += extra
    solve_three(a, b, step)
    return True


@allocating
def sweep_moves(state, samples, counts, figures, reference, chosen, pool, found):
    """One pass over the vertices inside of patches; returns how many moved."""
    _corner, twin, _, _, first, kind, points, normals, _ = state
    limit2, least_shape, least_agreement, cosine, _, _, _, _ = figures
    ring, fan, star = (
        np.empty(MOST_STAR, np.int64), np.empty((MOST_STAR, 6), np.int64),
        np.empty((MOST_STAR, STAR_WIDTH)),
    )  # fmt: skip
    x, step, one, room = np.empty(3), np.empty(3), np.empty((1, 3)), np.empty(9)
    nodes, squares = np.empty(STACK, np.int32), np.empty(STACK)
    moved = 0
    for v in range(counts[0]):
        if not chosen[v] or first[v] < 0 or kind[v] != INSIDE:
            continue
        count = ring_of(twin, first, v, ring)
        if count == 0:
            continue
        count = fill_fan(state, v, ring, count, -1, fan, 0)
        filled = gather_fan(samples, fan, count, pool)
        fill_star(points, fan, count, points[v], star)
        before = measure(
            state, samples, fan, star, count, points[v], pool, filled, FAR, -1.0, found
        )
        if filled == 0:
            continue
        before = measure(
            state, samples, fan, star, count, points[v], pool, filled, limit2, cosine, found
        )
        old = star_shape(state, fan, star, count, normals[v], figures, one)
        if not best_move(samples, star, pool, filled, found, limit2, step, room):
            continue
        share = 1.0
        for _ in range(3):
            for k in range(3):
                x[k] = points[v, k] + share * step[k]
            share *= 0.5
            fill_star(points, fan, count, x, star)
            shape, agree, excess = star_shape(state, fan, star, count, normals[v], figures, one)
            if shape < min(least_shape, WORSE * old[0]) or shape <= 0.0:
                continue
            if agree < min(least_agreement, WORSE * old[1]) or excess > max(1.0, old[2]):
                continue
            after = measure(
                state, samples, fan, star, count, x, pool, filled, limit2, cosine, found
            )
            if after < 0.0 or (before >= 0.0 and after > BETTER * before):
                continue
            near = samples[6][pool[0]]
            if leaves_original(star, count, x, limit2, near, reference, nodes, squares):
                continue
            for k in range(3):
                points[v, k] = x[k]
            assign(samples, fan, count, pool, filled, found)
            moved += 1
            break
    return moved


@kernel
def joined(twin, corner, first, v, w):
    """Whether an edge joins v and w."""
    h = first[v]
    while twin[h] >= 0:
        h = following(twin[h])
        if h == first[v]:
            break
    start = h
    while True:
        if corner[following(h)] == w or corner[preceding(h)] == w:
            return True
        g = twin[preceding(h)]
        if g < 0 or g == start:
            return False
        h = g


@kernel
def fill_flipped(state, h, fan):
    """The two triangles that a flip of h would make, (c, d, b) and (d, c, a), as rows of a fan."""
    corner, twin, crease, _, _, _, _, _, _ = state
    g = twin[h]
    fan[0, 0], fan[0, 1], fan[0, 2] = h // 3, corner[preceding(g)], corner[g]
    fan[0, 3], fan[0, 4], fan[0, 5] = 0, crease[preceding(g)], crease[following(h)]
    fan[1, 0], fan[1, 1], fan[1, 2] = g // 3, corner[preceding(h)], corner[h]
    fan[1, 3], fan[1, 4], fan[1, 5] = 0, crease[preceding(h)], crease[following(g)]


@kernel
def flip(state, h):
    """Turn an inner edge; returns its two half-edges' faces, whose corners are (c, d, b), (d, c, a)
    for an edge from a to b with opposite corners c (of h) and d.
    """
    corner, twin, crease, _, first, _, _, _, _ = state
    g = twin[h]
    a, b = corner[h], corner[g]
    c, d = corner[preceding(h)], corner[preceding(g)]
    h1, h2, g1, g2 = following(h), preceding(h), following(g), preceding(g)
    # faces: h: a b c, h1: b c, h2: c a;  g: b a, g1: a d, g2: d b
    t_h1, t_h2, t_g1, t_g2 = twin[h1], twin[h2], twin[g1], twin[g2]
    m_h1, m_h2, m_g1, m_g2 = crease[h1], crease[h2], crease[g1], crease[g2]
    # new face of h: h: c -> d, h1: d -> b (was g2), h2: b -> c (was h1)
    corner[h], corner[h1], corner[h2] = c, d, b
    # new face of g: g: d -> c, g1: c -> a (was h2), g2: a -> d (was g1)
    corner[g], corner[g1], corner[g2] = d, c, a
    twin[h1], twin[h2], twin[g1], twin[g2] = t_g2, t_h1, t_h2, t_g1
    crease[h1], crease[h2], crease[g1], crease[g2] = m_g2, m_h1, m_h2, m_g1
    if t_g2 >= 0:
        twin[t_g2] = h1
    if t_h1 >= 0:
        twin[t_h1] = h2
    if t_h2 >= 0:
        twin[t_h2] = g1
    if t_g1 >= 0:
        twin[t_g1] = g2
    first[a], first[b], first[c], first[d] = g2, h2, h, g
    return h // 3, g // 3


@kernel
def looks_down(star, up):
    """Whether one of two triangles turns away from the direction up (3,): their quad is not convex.

    Normals of vertices on creases cannot tell: they are means over patches.
    """
    for i in range(2):
        if star[i, 9] * up[0] + star[i, 10] * up[1] + star[i, 11] * up[2] <= 0.0:
            return True
    return False


@kernel
def flipped_leaves(star, limit2, t, reference, nodes, squares):
    """As `leaves_original`, of the middle of the new edge and of both triangles' normals."""
    x, y, z = star[0, 0], star[0, 1], star[0, 2]
    t, _, _, square = place_near(
        x + 0.5 * star[0, 3], y + 0.5 * star[0, 4], z + 0.5 * star[0, 5],
        limit2, t, reference, nodes, squares,
    )  # fmt: skip
    if square > limit2:
        return True
    for i in range(2):
        px = star[i, 0] + (star[i, 3] + star[i, 6]) / 3.0
        py = star[i, 1] + (star[i, 4] + star[i, 7]) / 3.0
        pz = star[i, 2] + (star[i, 5] + star[i, 8]) / 3.0
        if inverted_in(star, i, px, py, pz, t, reference, nodes, squares):
            return True
    return False


@allocating
def sweep_flips(state, samples, counts, figures, reference, chosen, pool, found):
    """One pass over the edges inside of patches; returns how many were flipped."""
    corner, twin, crease, _, first, _, points, normals, _ = state
    limit2, least_shape, least_agreement, cosine, longest2, longest6, sigma2, _ = figures
    fan, star, up = np.zeros((2, 6), np.int64), np.empty((2, STAR_WIDTH)), np.empty(3)
    nodes, squares = np.empty(STACK, np.int32), np.empty(STACK)
    flipped = 0
    for h in range(3 * counts[1]):
        g = twin[h]
        if corner[h] < 0 or g < h or crease[h] == 1:
            continue
        a, b = corner[h], corner[g]
        c, d = corner[preceding(h)], corner[preceding(g)]
        if not (chosen[a] or chosen[b] or chosen[c] or chosen[d]):
            continue
        if c == d or joined(twin, corner, first, c, d):
            continue
        filled = gather(samples[0], samples[1], h // 3, pool, 0)
        filled = gather(samples[0], samples[1], g // 3, pool, filled)
        if filled == 0:
            continue
        fill_triangle(points, a, b, c, star, 0)
        fill_triangle(points, b, a, d, star, 1)
        fill_flipped(state, h, fan)
        old_sine, old_agree = quad_shape(normals, star, a, b, c, d)
        for k in range(3):
            up[k] = star[0, 9 + k] + star[1, 9 + k]
        before = quad_measure(points, samples, fan, star, pool, filled, limit2, cosine, found)
        fill_triangle(points, c, d, b, star, 0)
        fill_triangle(points, d, c, a, star, 1)
        sine, agree = quad_shape(normals, star, c, d, b, a)
        if sine < min(least_shape, WORSE * old_sine) or sine <= 0.0:
            continue
        if agree < min(least_agreement, WORSE * old_agree) or looks_down(star, up):
            continue
        length = star[0, 3] ** 2 + star[0, 4] ** 2 + star[0, 5] ** 2
        if length > longest2 or length + sigma2 * turn_between(normals, c, normals, d) > longest6:
            continue
        after = quad_measure(points, samples, fan, star, pool, filled, limit2, cosine, found)
        if after < 0.0 or (before >= 0.0 and after > BETTER * before):
            continue
        t = samples[6][pool[0]]
        if flipped_leaves(star, limit2, t, reference, nodes, squares):
            continue
        flip(state, h)
        assign(samples, fan, 2, pool, filled, found)
        flipped += 1
    return flipped


@kernel
def quad_shape(normals, star, a, b, c, d):
    """Least height over edge and least agreement of two triangles (a, b, c) and (b, a, d)."""
    sine, agree = FAR, FAR
    for i in range(2):
        sine = min(sine, least_sine(star, i)[0])
        for v in (a, b, c if i == 0 else d):
            agree = min(agree, agreement_with(normals, v, star, i))
    return sine, agree


@kernel
def quad_measure(points, samples, fan, star, pool, filled, limit2, cosine, found):
    """As `measure`, of two triangles inside of a patch; samples on curves do not count.

    They are assigned to the triangle of the flipped pair (in fan) that has their feature edge.
    """
    _, _, place, on_curve, direction, share, _ = samples
    total = 0.0
    for j in range(filled):
        s = pool[j]
        x, y, z = place[s, 0], place[s, 1], place[s, 2]
        if on_curve[s] == 1:
            first = nearest_curve(points, fan[:1], star, 1, x, y, z, points[fan[1, 1]])[1]
            second = nearest_curve(points, fan[1:], star, 1, x, y, z, points[fan[0, 1]])[1]
            found[s] = 0 if first <= second else 1
            continue
        best, least = 0, closest_in_star(x, y, z, star, 0, FAR)
        square = closest_in_star(x, y, z, star, 1, least)
        if square < least:
            best, least = 1, square
        found[s] = best
        if least > limit2 * share[s]:
            total = -1.0
        if cosine > -1.0:
            size = math.sqrt(star[best, 9] ** 2 + star[best, 10] ** 2 + star[best, 11] ** 2)
            dot = 0.0
            for d in range(3):
                dot += star[best, 9 + d] * direction[s, d]
            if dot < cosine * size:
                total = -1.0
        if total >= 0.0:
            total += (least / (limit2 * share[s])) ** 2
    return total
