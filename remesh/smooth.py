"""Tangential smoothing, vertex by vertex, each move projected and checked at once."""

import math

import numpy as np

from remesh.compiled import allocating, hot, kernel
from remesh.connectivity import (
    BASE,
    CORNER,
    CURVE,
    KIND,
    MAX_RING,
    ORIGIN,
    PARAMETER,
    ROWS,
    following,
    preceding,
    ring,
)
from remesh.embedding import as_tangents, squared_length, triangle_normal
from remesh.guard import no_worse, reaches
from remesh.moves import (
    curve_neighbours,
    move_inside,
    restore_vertex,
    save_vertex,
    slide,
)
from remesh.star import (
    LANES,
    PULL,
    STAR_SHAPE,
    WEIGHT,
    gather_star,
    set_centre,
    star_pulls,
    star_quality,
)

UNIFORM, AREA, BOSSEN_HECKBERT = 0, 1, 2
SHORTER_STEP, TRIALS = 0.4, 3


def smooth_vertices(
    work, sigma, limits, weights=UNIFORM, factor=1.0, target=1.0, clip=0.0, chosen=None
):
    """Move vertices within their patch or along their curve; return how many moved.

    Parameters
    ----------
    work : WorkMesh
    sigma : float [unit of the points]
    limits : (angle6, angle3, agreement)
        A move is shortened, and then refused, where a triangle would fall below these and below
        what it was.
    weights : UNIFORM, AREA or BOSSEN_HECKBERT
        Step towards the neighbours' mean, towards the triangles' centroids weighted by 6D area,
        or by f(d) = (1 - d^4) exp(-d^4), d the 6D length over `target` (thesis section 2.4.4).
    factor : float
        Of the full step (alpha for BOSSEN_HECKBERT).
    target : float [unit of the points]
        The 6D edge length asked for.
    clip : float
        If positive, a step is at most this times the least height of the triangles around.
    chosen : (n,) bool array, optional
        Rows that may move; all if not given.
    """
    if chosen is None:
        chosen = np.ones(len(work.links), bool)
    return sweep_smoothing(
        work.halves, work.links, work.rows, work.counts, sigma**2, as_tangents(limits),
        weights, factor, target, clip, chosen, work.carrier.reference,
        work.curves,
    )  # fmt: skip


@hot
def pull_to_centroids(halves, rows, fan, count, star, sigma2, shift):
    """The step of `pull` towards the triangles' centroids, weighted by 6D area."""
    set_centre(halves, rows, fan, count, star)
    v = halves[fan[0], ORIGIN]
    star_pulls(star, count, rows[v, 0], rows[v, 1], rows[v, 2], sigma2)
    total, shift[0], shift[1], shift[2] = 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        part, lane = star[i // LANES], i % LANES
        total += 2.0 * part[WEIGHT + lane]
        for k in range(3):
            shift[k] += part[WEIGHT + lane] * part[PULL + k * LANES + lane]
    for k in range(3):
        shift[k] /= total if total > 0.0 else 1.0


@hot
def pull(halves, rows, fan, count, star, sigma2, weights, target, shift):
    """Write the full smoothing step (3,) of the centre of a closed fan."""
    if weights == AREA:
        pull_to_centroids(halves, rows, fan, count, star, sigma2, shift)
        return
    shift[0] = shift[1] = shift[2] = 0.0
    total = 0.0
    for i in range(count):
        h = fan[i]
        v, p = halves[h, ORIGIN], halves[following(h), ORIGIN]
        if weights == UNIFORM:
            total += 1.0
            for k in range(3):
                shift[k] += rows[p, k] - rows[v, k]
        else:
            d4 = (squared_length(rows, v, p, sigma2) / (target * target)) ** 2
            weight = (1.0 - d4) * math.exp(-d4)
            total = 1.0
            for k in range(3):
                shift[k] -= weight * (rows[p, k] - rows[v, k])
    for k in range(3):
        shift[k] /= total if total > 0.0 else 1.0


@kernel
def least_height(halves, rows, fan, count):
    """Least height over the opposite edge of the triangles of a fan."""
    least = math.inf
    for i in range(count):
        h = fan[i]
        v, p, q = halves[h, ORIGIN], halves[following(h), ORIGIN], halves[preceding(h), ORIGIN]
        x, y, z = triangle_normal(rows, v, p, q)
        base2 = squared_length(rows, p, q, 0.0)
        if base2 > 0.0:
            least = min(least, math.sqrt((x * x + y * y + z * z) / base2))
    return least


@hot
def tangential_step(
    halves, rows, vertex, fan, count, star, sigma2, weights, factor, target, clip, shift
):  # fmt: skip
    """Write the step of a vertex inside its patch, in the tangent plane and clipped."""
    pull(halves, rows, fan, count, star, sigma2, weights, target, shift)
    along = 0.0
    for k in range(3):
        along += shift[k] * rows[vertex, 3 + k]
    size = 0.0
    for k in range(3):
        shift[k] = factor * (shift[k] - along * rows[vertex, 3 + k])
        size += shift[k] * shift[k]
    if clip > 0.0:
        most = clip * least_height(halves, rows, fan, count)
        size = math.sqrt(size)
        if size > most:
            for k in range(3):
                shift[k] *= most / size


@kernel
def curve_step(halves, links, rows, vertex, fan, count, closed, sigma2, factor, curves, work4):
    """Change of a curve vertex's parameter that evens the 6D lengths to its two neighbours."""
    if not curve_neighbours(halves, links, rows, vertex, fan, count, closed, sigma2, curves, work4):
        return 0.0
    first, second = math.sqrt(work4[1]), math.sqrt(work4[3])
    if first > second:
        return 0.5 * factor * (first - second) / first * work4[0]
    if second > 0.0:
        return 0.5 * factor * (second - first) / second * work4[2]
    return 0.0


@allocating
def sweep_smoothing(
    halves, links, rows, counts, sigma2, limits, weights, factor, target, clip, chosen,
    reference, curves,
):  # fmt: skip
    """One Gauss-Seidel pass in index order; returns the number of vertices moved."""
    fan, star = np.empty(MAX_RING, np.int64), np.zeros(STAR_SHAPE)
    shift, point, four = np.empty(3), np.empty(9), np.empty(4)
    saved, saved_hints = np.empty((2, 8)), np.empty(2, np.int64)
    tried, tried_hints = np.empty((2, 8)), np.empty(2, np.int64)
    moved = 0
    for v in range(counts[ROWS]):
        if links[v, BASE] != v or links[v, KIND] == CORNER or not chosen[v]:
            continue
        count, closed = ring(halves, links, v, fan)
        if count == 0:
            continue
        gather_star(halves, rows, fan, count, star)
        on_curve = links[v, KIND] == CURVE
        step = 0.0
        if on_curve:
            step = curve_step(
                halves, links, rows, v, fan, count, closed, sigma2, factor, curves, four
            )
        else:
            tangential_step(
                halves, rows, v, fan, count, star, sigma2, weights, factor, target, clip, shift
            )  # fmt: skip
        save_vertex(rows, links, v, saved, saved_hints)
        before, known = (0.0, 0.0, 0.0), False
        scale, accepted = 1.0, False
        for _ in range(TRIALS):
            if on_curve:
                parameter = saved[0, PARAMETER] + scale * step
                slide(halves, links, rows, v, fan, count, parameter, curves, point)
            else:
                move_inside(rows, links, v, saved[0], shift, scale, reference, point)
            after = star_quality(rows, halves, fan, count, star, sigma2)
            if reaches(after, limits):
                accepted = True
                break
            if not known:  # seldom asked for
                save_vertex(rows, links, v, tried, tried_hints)
                restore_vertex(rows, links, v, saved, saved_hints)
                before, known = star_quality(rows, halves, fan, count, star, sigma2), True
                restore_vertex(rows, links, v, tried, tried_hints)
            if no_worse(after, before, limits):
                accepted = True
                break
            scale *= SHORTER_STEP
        if accepted:
            moved += 1
        else:
            restore_vertex(rows, links, v, saved, saved_hints)
    return moved
