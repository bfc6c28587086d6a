"""Pattern search on single vertices for better angles, in 6D, in 3D, or for the worst alone."""

import math

import numpy as np

from remesh.compiled import allocating, hot
from remesh.connectivity import (
    BASE,
    CORNER,
    CURVE,
    KIND,
    MAX_RING,
    ORIGIN,
    PARAMETER,
    following,
    preceding,
    ring,
)
from remesh.embedding import degrees_of
from remesh.follow import chord_bound, curve_of, gaps_beside
from remesh.moves import curve_neighbours, move_inside, restore_vertex, save_vertex, slide
from remesh.star import (
    AREA,
    COSINE3,
    COST,
    EXCESS,
    EXCESS3,
    LANES,
    NEXT,
    SINE3,
    STAR_SHAPE,
    gather_star,
    set_centre,
    star_costs,
    star_quality,
)

BARRIER = 1e3
DOUBLINGS = 2
GROWTH, SHRINKAGE = 1.2, 0.5
LONGEST_STEP, SHORTEST_STEP = 0.3, 0.012  # of the mean edge at a vertex
TURN_PER_ROW, TURN_PER_SWEEP = 2.4, 1.9  # [radians], so that directions differ


def optimise_vertices(
    work, sigma, steps, power=2, least_angle3=0.0, weight3=0.0, least_agreement=0.3,
    only_below=180.0, sweeps=1, directions=4, hold=None, hold_weight=0.0,
    along_curves=0.0, listed=None,
):  # fmt: skip
    """Search around each vertex for a place with better triangles; return (moved, visited).

    The cost of a star is sum ((60 - angle6) / 30)^power + weight3 * sum (least_angle3 - angle3)+^2,
    with a barrier where a triangle agrees less than asked with the surface's normals. The first
    better place is taken. Each vertex has a step of its own, which grows with success and shrinks
    without; a vertex whose step has become too short rests until a neighbour moves.

    Parameters
    ----------
    work : WorkMesh
    sigma : float [unit of the points]
        Of the angles in the cost.
    steps : float or (n,) float array
        Step of every row, in units of the mean edge at its vertex; an array is updated.
    power : 1, 2, 4 or 8
        High powers improve the worst angles at the others' cost.
    least_angle3, weight3 : float [degrees], float
        3D angles below this are penalised too.
    least_agreement : float
        Cosine to the surface's normals below which the barrier rises.
    only_below : float [degrees]
        Visit only vertices with a 6D angle below this around them (or a 3D angle or agreement
        below the bounds above).
    sweeps : int
        Passes over all vertices in index order; `moved` and `visited` are those of the last.
    directions : int
        Of the search in the tangent plane (2 on a curve).
    hold : (n, 9) float array, optional
        What `adjust.fit_vertices` returned.
    hold_weight : float
        Of the growth of the squared gaps by a move away from where that fit put the vertex: 1
        lets a vertex that adds the mean gap turn one triangle from 30 to 60 degrees.
    along_curves : float [unit of the points]
        If positive, vertices on curves are moved too; no edge of a crease may come to be farther
        from its curve than this and than before.
    listed : (k,) int array, optional
        Vertices to visit; all if not given.
    """
    listed = work.base_rows() if listed is None else listed
    tangent3 = math.tan(math.radians(least_angle3))
    settings = np.array([sigma**2, power, least_angle3, weight3, least_agreement, tangent3], float)
    if np.ndim(steps) == 0:
        steps = np.full(len(work.links), float(steps))
    if hold is None:
        hold, hold_weight = np.zeros((1, 9)), 0.0
    return sweep_search(
        work.halves, work.links, work.rows, listed, settings, steps, only_below, sweeps, directions,
        hold, hold_weight, along_curves, work.carrier.reference, work.curves,
    )  # fmt: skip


@hot
def star_cost(rows, halves, fan, count, star, settings):
    """Cost of the triangles around a vertex (see `optimise_vertices`)."""
    sigma2, power, least3, weight3, least_agreement, tangent3 = settings
    set_centre(halves, rows, fan, count, star)
    a = halves[fan[0], ORIGIN]
    x, y, z = rows[a, 0], rows[a, 1], rows[a, 2]
    if sigma2 > 0.0:
        star_costs(star, count, x, y, z, sigma2, tangent3, least_agreement)
    else:
        star_costs(star, count, x, y, z, 0.0, tangent3, least_agreement)
    cost = 0.0
    for i in range(count):
        part, lane = star[i // LANES], i % LANES
        t = part[COST + lane]
        if power > 1.0:
            t *= t
        if power > 2.0:
            t *= t
        if power > 4.0:
            t *= t
        cost += t
        if weight3 > 0.0 and part[EXCESS3 + lane] < 0.0:
            t = least3 - degrees_of(part[SINE3 + lane], part[COSINE3 + lane])
            cost += weight3 * t * t
        if part[AREA + lane] <= 0.0:
            cost += BARRIER * (least_agreement + 1.0)
        elif part[EXCESS + lane] < 0.0:
            cost += BARRIER * (-part[EXCESS + lane] / part[AREA + lane])
    return cost


@hot
def held_cost(rows, v, hold, weight):
    """Weight times the quadratic form of a vertex's displacement from where a fit put it."""
    if weight == 0.0:
        return 0.0
    x, y, z = rows[v, 0] - hold[v, 0], rows[v, 1] - hold[v, 1], rows[v, 2] - hold[v, 2]
    square = hold[v, 3] * x * x + hold[v, 4] * y * y + hold[v, 5] * z * z
    mixed = hold[v, 6] * x * y + hold[v, 7] * y * z + hold[v, 8] * z * x
    return weight * (square + 2.0 * mixed)


@hot
def wants_search(rows, halves, fan, count, star, settings, only_below):
    """Whether a star has a triangle below the bounds of the search."""
    if only_below >= 60.0:
        return True
    tangent6, tangent3, normal = star_quality(rows, halves, fan, count, star, settings[0])
    bad3 = settings[3] > 0.0 and tangent3 < settings[5]
    return degrees_of(tangent6, 1.0) < only_below or bad3 or normal < settings[4]


@hot
def mean_edge(rows, v, count, star):
    """Root mean square of the lengths of the edges at the centre of a star."""
    total = 0.0
    for i in range(count):
        part, lane = star[i // LANES], i % LANES
        for k in range(3):
            d = part[NEXT + k * LANES + lane] - rows[v, k]
            total += d * d
    return math.sqrt(total / count)


@hot
def tangent_frame(rows, v, frame):
    """Write two unit vectors (2, 3) that span the tangent plane of a row."""
    x, y, z = rows[v, 3], rows[v, 4], rows[v, 5]
    if abs(x) < 0.6:
        frame[0, 0], frame[0, 1], frame[0, 2] = 0.0, z, -y
    else:
        frame[0, 0], frame[0, 1], frame[0, 2] = -z, 0.0, x
    size = math.sqrt(frame[0, 0] ** 2 + frame[0, 1] ** 2 + frame[0, 2] ** 2)
    for k in range(3):
        frame[0, k] /= size if size > 0.0 else 1.0
    frame[1, 0] = y * frame[0, 2] - z * frame[0, 1]
    frame[1, 1] = z * frame[0, 0] - x * frame[0, 2]
    frame[1, 2] = x * frame[0, 1] - y * frame[0, 0]


@hot
def try_move(
    halves, links, rows, v, fan, count, star, on_curve, saved, shift, scale, settings, bound,
    hold, hold_weight, reference, curves, point,
):  # fmt: skip
    """Move a vertex by scale * shift (on a curve: shift[0] in the parameter); return the cost."""
    if on_curve:
        parameter = saved[0, PARAMETER] + scale * shift[0]
        slide(halves, links, rows, v, fan, count, parameter, curves, point)
    else:
        move_inside(rows, links, v, saved[0], shift, scale, reference, point)
    cost = held_cost(rows, v, hold, hold_weight)
    if cost >= bound:
        return cost
    return cost + star_cost(rows, halves, fan, count, star, settings)


@hot
def wake_neighbours(halves, links, fan, count, closed, steps, content):
    """Let the vertices around a moved one search again."""
    for i in range(count if closed else count + 1):
        h = following(fan[i]) if i < count else preceding(fan[count - 1])
        u = links[halves[h, ORIGIN], BASE]
        steps[u] = max(steps[u], 2.0 * SHORTEST_STEP)
        content[u] = False


@allocating
def sweep_search(
    halves, links, rows, listed, settings, steps, only_below, sweeps, directions, hold, hold_weight,
    along_curves, reference, curves,
):  # fmt: skip
    """Passes of the pattern search in index order; returns (moved, visited) of the last."""
    fan, star = np.empty(MAX_RING, np.int64), np.zeros(STAR_SHAPE)
    shift, point, four, frame = np.empty(3), np.empty(9), np.empty(4), np.empty((2, 3))
    ends = np.empty((2, 9))
    saved, saved_hints = np.empty((2, 8)), np.empty(2, np.int64)
    best_rows, best_hints = np.empty((2, 8)), np.empty(2, np.int64)
    content = np.zeros(links.shape[0], np.bool_)  # no search wanted since a neighbour moved
    turn_x, turn_y = math.cos(2.0 * math.pi / directions), math.sin(2.0 * math.pi / directions)
    moved, visited = 0, 0
    for sweep in range(sweeps):
        moved, visited = 0, 0
        for index in range(listed.size):
            v = listed[index]
            if content[v] or links[v, KIND] == CORNER or steps[v] < SHORTEST_STEP:
                continue
            on_curve = links[v, KIND] == CURVE
            count, closed = ring(halves, links, v, fan)
            if count == 0 or (on_curve and along_curves <= 0.0):
                continue
            gather_star(halves, rows, fan, count, star)
            if not wants_search(rows, halves, fan, count, star, settings, only_below):
                content[v] = True
                continue
            if on_curve and not curve_neighbours(
                halves, links, rows, v, fan, count, closed, 0.0, curves, four
            ):
                continue
            curve, here, low, high, bound = -1, 0.0, 0.0, 0.0, 0.0
            if on_curve:
                curve, here = curve_of(halves, fan, count), rows[v, PARAMETER]
                low, high = here + min(four[0], four[2]), here + max(four[0], four[2])
                bound = chord_bound(curves, curve, low, here, high, along_curves**2, ends)
            visited += 1
            best = held_cost(rows, v, hold, hold_weight)
            best += star_cost(rows, halves, fan, count, star, settings)
            save_vertex(rows, links, v, saved, saved_hints)
            size = steps[v] * mean_edge(rows, v, count, star)
            tangent_frame(rows, v, frame)
            turn = TURN_PER_ROW * v + TURN_PER_SWEEP * sweep
            ahead, aside = size * math.cos(turn), size * math.sin(turn)
            success, scale = False, 1.0
            for i in range(2 if on_curve else directions):
                for k in range(3):
                    shift[k] = ahead * frame[0, k] + aside * frame[1, k]
                ahead, aside = ahead * turn_x - aside * turn_y, aside * turn_x + ahead * turn_y
                if on_curve:
                    shift[0] = size if i == 0 else -size
                for _ in range(DOUBLINGS + 1):
                    cost = try_move(
                        halves, links, rows, v, fan, count, star, on_curve, saved, shift, scale,
                        settings, best, hold, hold_weight, reference, curves, point,
                    )  # fmt: skip
                    if cost >= best:
                        break
                    if on_curve and bound < math.inf:
                        s = here + scale * shift[0]
                        if gaps_beside(curves, curve, low, s, high, ends)[1] > bound:
                            break
                    best, success = cost, True
                    save_vertex(rows, links, v, best_rows, best_hints)
                    scale *= 2.0
                if success:
                    break
            if success:
                restore_vertex(rows, links, v, best_rows, best_hints)
                steps[v] = min(steps[v] * max(GROWTH, 0.5 * scale), LONGEST_STEP)
                wake_neighbours(halves, links, fan, count, closed, steps, content)
                moved += 1
            else:
                restore_vertex(rows, links, v, saved, saved_hints)
                steps[v] *= SHRINKAGE
    return moved, visited
