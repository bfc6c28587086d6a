"""Compiled loops of the evaluator: cells of queries against the centres around them.

The centres within a support radius of a cell's queries are listed and copied into contiguous arrays
once; then each query runs over them without a branch. The iterations of a fit keep the lists. A
cell writes to its own queries only, so that the result does not depend on the number of threads.
"""

import numpy as np
from numba import njit, prange

from rbf.cell_kernels import MAX_RUNS, OUTSIDE, REACH, neighbour_runs
from rbf.sum_kernels import value_and_gradient

OPTIONS = {"cache": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
UNSIGNED = np.uint64  # loops over unsigned indices vectorise: they need no wrapping
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
def middle(box, axis):
    """Middle of a box (2, 3) along an axis."""
    return 0.5 * (box[0, axis] + box[1, axis])


@njit(**OPTIONS)
def list_near(key, reach, box, radius, grid):
    """Numbers (k,) of the centres nearer than `radius` to a box, in the cells within `reach`."""
    run_start, run_end = np.empty(MAX_RUNS, np.int64), np.empty(MAX_RUNS, np.int64)
    runs, total = neighbour_runs(key, reach, grid, run_start, run_end)
    found, squared = np.empty(total + 1, np.int32), np.empty(total)
    X, Y, Z = grid[-1][0], grid[-1][1], grid[-1][2]
    ox, oy, oz = middle(box, 0), middle(box, 1), middle(box, 2)
    hx, hy, hz = box[1, 0] - ox, box[1, 1] - oy, box[1, 2] - oz
    count = UNSIGNED(0)
    for run in range(runs):
        start = UNSIGNED(run_start[run])
        length = UNSIGNED(run_end[run] - run_start[run])
        for j in range(length):
            dx = max(abs(X[start + j] - ox) - hx, 0.0)
            dy = max(abs(Y[start + j] - oy) - hy, 0.0)
            dz = max(abs(Z[start + j] - oz) - hz, 0.0)
            squared[j] = dx * dx + dy * dy + dz * dz
        for j in range(length):
            # written in any case and overwritten if too far: cheaper than a branch
            found[count] = start + j
            count += UNSIGNED(squared[j] < radius * radius)
    return found[:count]


@njit(**OPTIONS)
def gather(chosen, box, centres):
    """Copy centres, relative to the middle of a box, in rows.

    Returns
    -------
    near : (7, m) float array
        m is a multiple of LANES: the last ones may have weight 0 and lie far away.
    """
    size = chosen.size
    padded = (size + LANES - 1) // LANES * LANES
    near = np.empty((7, padded))
    ox, oy, oz = middle(box, 0), middle(box, 1), middle(box, 2)
    for k in range(size):
        j = UNSIGNED(chosen[k])
        near[0, k], near[1, k] = centres[j, 0] - ox, centres[j, 1] - oy
        near[2, k], near[3, k] = centres[j, 2] - oz, centres[j, 3]
        near[4, k], near[5, k], near[6, k] = centres[j, 4], centres[j, 5], centres[j, 6]
    for k in range(size, padded):
        near[0, k] = near[1, k] = near[2, k] = FAR
        near[3, k] = near[4, k] = near[5, k] = near[6, k] = 0.0
    return near


@njit(parallel=True, **OPTIONS)
def list_cells(points, order, keys, starts, grid, list_start, lists):
    """`list_near` of all cells; parameters as in `evaluate`.

    To be called twice: with empty `lists` it writes how many centres cell i has into
    list_start[i + 1]; with `lists` it fills lists[list_start[i]:list_start[i + 1]].
    """
    for cell in prange(keys.size):
        box = np.empty((2, 3))
        bounding_box(points, order, starts[cell], starts[cell + 1], box)
        found = list_near(keys[cell], np.int64(REACH), box, 1.0, grid)
        if lists.size == 0:
            list_start[cell + 1] = found.size
        else:
            lists[list_start[cell] : list_start[cell + 1]] = found


@njit(parallel=True, **OPTIONS)
def evaluate(
    points,
    order,
    keys,
    starts,
    centres,
    grid,
    list_start,
    lists,
    kernel,
    hermite,
    values,
    gradients,
):
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
    list_start, lists : int64 and int32 arrays
        From `list_cells`, or empty: then the centres near a cell are looked for.
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
        if lists.size > 0:
            chosen = lists[list_start[cell] : list_start[cell + 1]]
        else:
            chosen = list_near(keys[cell], np.int64(REACH), box, 1.0, grid)
        near = gather(chosen, box, centres)
        ox, oy, oz = middle(box, 0), middle(box, 1), middle(box, 2)
        for q in range(first, last):
            p = order[q]
            x, y, z = points[p, 0] - ox, points[p, 1] - oy, points[p, 2] - oz
            v, gx, gy, gz, support = value_and_gradient(
                kernel, hermite, near.shape[1], near, x, y, z
            )
            if support > 0.0:
                values[p] = v
                gradients[p, 0], gradients[p, 1], gradients[p, 2] = gx, gy, gz
            else:
                values[p] = np.nan
                gradients[p, :] = np.nan
