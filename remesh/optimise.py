"""Pattern search on single vertices for better angles, in 6D, in 3D, or for the worst alone."""

import math

import numpy as np

from remesh.compiled import kernel
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
from remesh.embedding import DEGREES, agreement, least_tangent, squared_length, squared_parts
from remesh.guard import fan_quality
from remesh.moves import curve_neighbours, move_inside, restore_vertex, save_vertex, slide

BARRIER = 1e3
DOUBLINGS = 3


def optimise_vertices(
    work, sigma, step, power=2, least_angle3=0.0, weight3=0.0, least_agreement=0.3,
    only_below=180.0, directions=8,
):  # fmt: skip
    """Search around each vertex for a place with better triangles; return (moved, visited).

    The cost of a fan is sum ((60 - angle6) / 30)^power + weight3 * sum (least_angle3 - angle3)+^2,
    with a barrier where a triangle agrees less than asked with the surface's normals.

    Parameters
    ----------
    work : WorkMesh
    sigma : float [unit of the points]
        Of the angles in the cost.
    step : float
        First step, in units of the shortest edge at the vertex.
    power : 2, 4 or 8
        High powers improve the worst angles at the others' cost.
    least_angle3, weight3 : float [degrees], float
        3D angles below this are penalised too.
    least_agreement : float
        Cosine to the surface's normals below which the barrier rises.
    only_below : float [degrees]
        Visit only vertices with a 6D angle below this around them (or a 3D angle or agreement
        below the bounds above).
    directions : int
        Of the search in the tangent plane (2 on a curve).
    """
    settings = np.array([sigma**2, power, least_angle3, weight3, least_agreement], float)
    return sweep_search(
        work.halves, work.links, work.rows, work.counts, settings, step, only_below, directions,
        work.carrier.reference, work.curves,
    )  # fmt: skip


@kernel
def fan_cost(rows, halves, fan, count, settings, bound):
    """Cost of the triangles around a vertex (see `optimise_vertices`); stops above `bound`."""
    sigma2, power, least3, weight3, least_agreement = settings
    cost = 0.0
    last_centre, last_rim = -1, -1
    position, turn = 0.0, 0.0
    for i in range(count):
        h = fan[i]
        a, b, c = halves[h, ORIGIN], halves[following(h), ORIGIN], halves[preceding(h), ORIGIN]
        if a != last_centre or b != last_rim:
            position, turn = squared_parts(rows, a, b)
        rim_position, rim_turn = squared_parts(rows, b, c)
        next_position, next_turn = squared_parts(rows, c, a)
        tangent = least_tangent(
            position + sigma2 * turn,
            rim_position + sigma2 * rim_turn,
            next_position + sigma2 * next_turn,
        )
        x = 2.0 - DEGREES / 30.0 * math.atan(tangent)
        x *= x
        if power > 2.0:
            x *= x
        if power > 4.0:
            x *= x
        cost += x
        if weight3 > 0.0:
            tangent = least_tangent(position, rim_position, next_position)
            y = least3 - DEGREES * math.atan(tangent)
            if y > 0.0:
                cost += weight3 * y * y
        z = least_agreement - agreement(rows, a, b, c)
        if z > 0.0:
            cost += BARRIER * z
        if cost >= bound:
            return cost
        last_centre, last_rim = a, c
        position, turn = next_position, next_turn
    return cost


@kernel
def wants_search(rows, halves, fan, count, settings, only_below):
    """Whether a fan has a triangle below the bounds of the search."""
    if only_below >= 60.0:
        return True
    tangent6, tangent3, normal = fan_quality(rows, halves, fan, count, settings[0])
    bad3 = settings[3] > 0.0 and DEGREES * math.atan(tangent3) < settings[2]
    return DEGREES * math.atan(tangent6) < only_below or bad3 or normal < settings[4]


@kernel
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


@kernel
def try_move(
    halves, links, rows, v, fan, count, on_curve, saved, shift, scale, settings, bound,
    reference, curves, point,
):  # fmt: skip
    """Move a vertex by scale * shift (on a curve: shift[0] in the parameter); return the cost."""
    if on_curve:
        parameter = saved[0, PARAMETER] + scale * shift[0]
        slide(halves, links, rows, v, fan, count, parameter, curves, point)
    else:
        move_inside(rows, links, v, saved[0], shift, scale, reference, point)
    return fan_cost(rows, halves, fan, count, settings, bound)


@kernel
def sweep_search(
    halves, links, rows, counts, settings, step, only_below, directions, reference, curves
):
    """One pass of the pattern search in index order; returns (moved, visited)."""
    fan = np.empty(MAX_RING, np.int64)
    shift, chosen, point, four = np.empty(3), np.empty(3), np.empty(9), np.empty(4)
    saved, saved_hints = np.empty((2, 8)), np.empty(2, np.int64)
    best_rows, best_hints = np.empty((2, 8)), np.empty(2, np.int64)
    frame = np.empty((2, 3))
    moved, visited = 0, 0
    for v in range(counts[ROWS]):
        if links[v, BASE] != v or links[v, KIND] == CORNER:
            continue
        count, closed = ring(halves, links, v, fan)
        if count == 0 or not wants_search(rows, halves, fan, count, settings, only_below):
            continue
        visited += 1
        on_curve = links[v, KIND] == CURVE
        if on_curve and not curve_neighbours(
            halves, links, rows, v, fan, count, closed, 0.0, curves, four
        ):
            continue
        start = fan_cost(rows, halves, fan, count, settings, math.inf)
        save_vertex(rows, links, v, saved, saved_hints)
        save_vertex(rows, links, v, best_rows, best_hints)
        best = start
        shortest2 = math.inf
        for i in range(count):
            shortest2 = min(
                shortest2, squared_length(rows, halves[fan[i], ORIGIN],
                                          halves[following(fan[i]), ORIGIN], 0.0)
            )  # fmt: skip
        size = step * math.sqrt(shortest2)
        tangent_frame(rows, v, frame)
        for i in range(2 if on_curve else directions):
            turn = 2.0 * math.pi * i / directions + 0.5 * v
            for k in range(3):
                shift[k] = size * (math.cos(turn) * frame[0, k] + math.sin(turn) * frame[1, k])
            if on_curve:
                shift[0] = size if i == 0 else -size
            cost = try_move(
                halves, links, rows, v, fan, count, on_curve, saved, shift, 1.0, settings,
                best, reference, curves, point,
            )  # fmt: skip
            if cost < best:
                best = cost
                chosen[:] = shift
                save_vertex(rows, links, v, best_rows, best_hints)
        scale = 2.0
        for _ in range(DOUBLINGS if best < start else 0):
            cost = try_move(
                halves, links, rows, v, fan, count, on_curve, saved, chosen, scale, settings,
                best, reference, curves, point,
            )  # fmt: skip
            if cost >= best:
                break
            best = cost
            save_vertex(rows, links, v, best_rows, best_hints)
            scale *= 2.0
        if best < start:
            moved += 1
        restore_vertex(rows, links, v, best_rows, best_hints)
    return moved, visited
