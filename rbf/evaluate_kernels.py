"""Compiled loops of the evaluator: cells of queries against the centres around them.

The centres within a support radius of a cell's queries are copied into contiguous arrays once;
then each query runs over them without a branch. A cell writes to its own queries only, so that
the result does not depend on the number of threads.
"""

import numpy as np
from numba import njit, prange

from rbf.cell_kernels import MAX_RUNS, OUTSIDE, REACH, neighbour_runs
from rbf.sum_kernels import value_and_gradient

OPTIONS = {"cache": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
LANES = 8  # the gathered arrays are padded to a multiple of this
FAR = 1e3  # where padding centres lie, in support radii


@njit(**OPTIONS)
def bounding_box(points, order, first, last, box):
    """Bounding box (2, 3) of the points order[first:last]."""
    for axis in range(3):
        low = high = points[order[first], axis]
        for q in range(first + 1, last):
            low = min(low, points[order[q], axis])
            high = max(high, points[order[q], axis])
        box[0, axis], box[1, axis] = low, high


@njit(**OPTIONS)
def gather(key, reach, box, radius, centres, grid):
    """Copy the centres nearer than `radius` to a box, relative to the box's middle.

    Returns
    -------
    near : (7, m or more) float array
    padded : int
        Number of centres m, a multiple of LANES: the last ones may have weight 0 and lie far away.
    """
    run_start, run_end = np.empty(MAX_RUNS, np.int64), np.empty(MAX_RUNS, np.int64)
    runs, total = neighbour_runs(key, reach, grid, run_start, run_end)
    near = np.empty((7, total // LANES * LANES + LANES))
    x0, y0, z0, x1, y1, z1 = box[0, 0], box[0, 1], box[0, 2], box[1, 0], box[1, 1], box[1, 2]
    ox, oy, oz = 0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (z0 + z1)
    count = 0
    for run in range(runs):
        for j in range(run_start[run], run_end[run]):
            x, y, z = centres[j, 0], centres[j, 1], centres[j, 2]
            dx = max(x0 - x, x - x1, 0.0)
            dy = max(y0 - y, y - y1, 0.0)
            dz = max(z0 - z, z - z1, 0.0)
            near[0, count], near[1, count], near[2, count] = x - ox, y - oy, z - oz
            near[3, count], near[4, count] = centres[j, 3], centres[j, 4]
            near[5, count], near[6, count] = centres[j, 5], centres[j, 6]
            # copied in any case and overwritten if too far: cheaper than a branch
            count += np.int64(dx * dx + dy * dy + dz * dz < radius * radius)
    padded = (count + LANES - 1) // LANES * LANES
    for j in range(count, padded):
        near[0, j], near[1, j], near[2, j] = FAR, FAR, FAR
        for k in range(3, 7):
            near[k, j] = 0.0
    return near, padded


@njit(parallel=True, **OPTIONS)
def evaluate(points, order, keys, starts, centres, grid, kernel, hermite, values, gradients):
    """S and its gradient at points (n, 3) binned in cells; NaN outside the support.

    Parameters
    ----------
    points : (n, 3) float array
        In units of the support radius.
    order, keys, starts : arrays
        The queries' cells, from `CellGrid.bin_queries`.
    centres : (n, 7) float array
        x, y, z, a, b of the centres, in the grid's order.
    grid : tuple
        `CellGrid.arrays` of the centres.
    kernel : int
        k of Wendland's phi_{3,k}.
    hermite : bool
    values, gradients : (n,) and (n, 3) float arrays
        Results.
    """
    for cell in prange(keys.size):
        first, last = starts[cell], starts[cell + 1]
        if keys[cell] == OUTSIDE:
            for q in range(first, last):
                values[order[q]] = np.nan
                gradients[order[q], :] = np.nan
            continue
        box = np.empty((2, 3))
        bounding_box(points, order, first, last, box)
        near, m = gather(keys[cell], np.int64(REACH), box, 1.0, centres, grid)
        ox, oy, oz = (
            0.5 * (box[0, 0] + box[1, 0]),
            0.5 * (box[0, 1] + box[1, 1]),
            0.5 * (box[0, 2] + box[1, 2]),
        )
        for q in range(first, last):
            p = order[q]
            v, gx, gy, gz, support = value_and_gradient(
                kernel,
                hermite,
                m,
                near,
                points[p, 0] - ox,
                points[p, 1] - oy,
                points[p, 2] - oz,
            )
            if support > 0.0:
                values[p] = v
                gradients[p, 0], gradients[p, 1], gradients[p, 2] = gx, gy, gz
            else:
                values[p] = np.nan
                gradients[p, :] = np.nan
