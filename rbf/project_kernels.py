"""Compiled loop of the projection: every query walks to the zero set on its own.

The centres around a cell of queries are gathered once, with a margin; a query that leaves the
margin is handed back to be binned anew.
"""

import numpy as np
from numba import njit, prange

from rbf.cell_kernels import OUTSIDE, REACH
from rbf.evaluate_kernels import bounding_box, gather, list_near
from rbf.sum_kernels import value_and_gradient

OPTIONS = {"cache": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
MARGIN = 0.1  # how far a query may walk before it is binned anew, in support radii

CONVERGED, MOVED, FAILED = 0, 1, 2  # status of a query


@njit(**OPTIONS)
def _walk(x, origin, near, kernel, hermite, settings, start, state):
    """Move one query x (3,) to the zero set.

    Parameters
    ----------
    x, origin : (3,) float arrays
        The query, and the point the centres are relative to.
    settings : tuple
        (tolerance, longest step, least slope, most steps, steps per renewed gradient).
    start : int
        Steps this query has taken before.
    state : (4,) float array
        Direction of descent (3 entries) and its squared length, carried between calls.

    Returns
    -------
    status, steps : int
        Steps taken so far. On convergence `state` holds the gradient at x.
    """
    tolerance, longest, least_slope, most, refresh = settings
    beginning = x.copy()
    for step in range(start, most + 1):
        v, gx, gy, gz, support = value_and_gradient(
            kernel,
            hermite,
            near.shape[1],
            near,
            x[0] - origin[0],
            x[1] - origin[1],
            x[2] - origin[2],
        )
        if not support > 0.0:
            return FAILED, step
        slope2 = gx * gx + gy * gy + gz * gz
        if abs(v) < tolerance and slope2 > least_slope * least_slope:
            state[0], state[1], state[2], state[3] = gx, gy, gz, slope2
            return CONVERGED, step
        if step == most or not slope2 > 0.0:
            return FAILED, step
        if step % refresh == 0:
            state[0], state[1], state[2], state[3] = gx, gy, gz, slope2
        length = v / max(state[3], least_slope * least_slope)
        distance = abs(length) * np.sqrt(state[3])
        if distance > longest:
            length *= longest / distance
        moved = 0.0
        for axis in range(3):
            x[axis] -= length * state[axis]
            moved += (x[axis] - beginning[axis]) ** 2
        if moved > MARGIN * MARGIN:
            return MOVED, step + 1
    return FAILED, most


@njit(parallel=True, **OPTIONS)
def project(
    points, order, keys, starts, centres, grid, kernel, hermite, settings, steps, states, status
):
    """Walk all queries (n, 3), in place, towards the zero set.

    Parameters as in `evaluate_kernels.evaluate`, and

    settings : tuple
        See `_walk`.
    steps, status : (n,) int arrays
    states : (n, 4) float array
        Gradient at the point reached (3 entries), and its squared length.
    """
    for cell in prange(keys.size):
        first, last = starts[cell], starts[cell + 1]
        if keys[cell] == OUTSIDE:
            for q in range(first, last):
                status[order[q]] = FAILED
            continue
        box = np.empty((2, 3))
        bounding_box(points, order, first, last, box)
        chosen = list_near(keys[cell], np.int64(REACH + 1), box, 1.0 + MARGIN, grid)
        near = gather(chosen, box, centres)
        origin = 0.5 * (box[0] + box[1])
        for q in range(first, last):
            p = order[q]
            status[p], steps[p] = _walk(
                points[p], origin, near, kernel, hermite, settings, steps[p], states[p]
            )
