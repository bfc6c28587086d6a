"""Compiled loop of the projection: every query walks to the zero set on its own.

The centres around a cell of queries are gathered once, with a margin; a query that leaves the
margin is handed back to be binned anew.
"""

import numpy as np
from numba import njit

from rbf.cell_kernels import MAX_RUNS, OUTSIDE, REACH, neighbour_runs
from rbf.evaluate_kernels import bounds, gather, room
from rbf.profiles import LEAN, OPTIONS
from rbf.sum_kernels import value_and_gradient

MARGIN = 0.1  # how far a query may leave its cell's queries' box, in support radii

CONVERGED, MOVED, FAILED = 0, 1, 2  # status of a query


@njit(**LEAN)
def _step(result, box, settings, x, state, step):
    """Move one query after `step` steps, unless it has arrived or cannot go on.

    Parameters
    ----------
    result : tuple
        Value, gradient at x, and whether it is supported.
    box : (2, 3) float array
        Of the cell's queries, see `bounds`.
    settings : tuple
        (tolerance, longest step, least slope, most steps, steps per renewed gradient).
    x : (3,) float array
        The query; moved.
    state : (4,) float array
        Direction of descent (3 entries) and its squared length, carried between steps. On
        convergence it holds the gradient at x.

    Returns
    -------
    status : int
        MOVED if it goes on.
    moved : bool
        Whether it took a step.
    away : bool
        Whether it left the margin.
    """
    tolerance, longest, least_slope, most, refresh = settings
    v, gx, gy, gz, supported = result
    if not supported:
        return FAILED, False, False
    slope2 = gx * gx + gy * gy + gz * gz
    arrived = abs(v) < tolerance and slope2 > least_slope * least_slope
    if not arrived and (step == most or not slope2 > 0.0):
        return FAILED, False, False
    if arrived or step % refresh == 0:
        state[0], state[1], state[2], state[3] = gx, gy, gz, slope2
    if arrived:
        return CONVERGED, False, False
    length = v / max(state[3], least_slope * least_slope)
    distance = abs(length) * np.sqrt(state[3])
    if distance > longest:
        length *= longest / distance
    beyond = 0.0
    for axis in range(3):
        x[axis] -= length * state[axis]
        beyond += max(abs(x[axis] - box[0, axis]) - box[1, axis], 0.0) ** 2
    return MOVED, True, beyond > MARGIN * MARGIN


@njit(**LEAN)
def _walk(form, near, begin, end, box, settings, x, step, state):
    """Move one query x (3,) until it has arrived, failed or left the margin: (status, steps)."""
    while True:
        result = value_and_gradient(form, near, begin, end, x[0], x[1], x[2])
        status, moved, away = _step(result, box, settings, x, state, step)
        step += moved
        if not moved or away:
            return status, step


@njit(**OPTIONS)
def project(
    first_cell,
    last_cell,
    form,
    points,
    order,
    keys,
    starts,
    centres,
    grid,
    settings,
    steps,
    states,
    status,
):
    """Walk the queries (n, 3) of some cells, in place, towards the zero set.

    Parameters as in `evaluate_kernels.evaluate`, and

    settings : tuple
        See `_step`.
    steps, status : (n,) int arrays
        Steps taken so far (added to); MOVED queries must be binned anew.
    states : (n, 4) float array
        Gradient at the point reached (3 entries), and its squared length.
    """
    found, box = np.empty((MAX_RUNS, 2), np.int64), np.empty((2, 3))
    near, around = np.empty((centres.shape[0], 512)), np.full((MAX_RUNS + 1, 2), -1)
    for cell in range(first_cell, last_cell):
        first, last = starts[cell], starts[cell + 1]
        if keys[cell] == OUTSIDE:
            for place in range(first, last):
                status[order[place]] = FAILED
            continue
        runs = found[: neighbour_runs(keys[cell], REACH + 1, grid, around, found)]
        bounds(points, order, first, last, box)
        near = room(runs, near)
        begin, end = gather(runs, box, 1.0 + MARGIN, centres, near)
        for place in range(first, last):
            p = order[place]
            status[p], steps[p] = _walk(
                form, near, begin, end, box, settings, points[p], steps[p], states[p]
            )
