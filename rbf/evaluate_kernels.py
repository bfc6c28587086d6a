"""Compiled loops of the evaluator: cells of queries against the centres around them.

The centres within a support radius of a cell's queries are copied into a contiguous array once;
then each query runs over them without a branch. The iterations of a fit keep the
runs of centres that each cell looks through. A cell writes to its own queries only, so that the
result does not depend on the number of threads.
"""

import numpy as np
from numba import njit

from rbf.cell_kernels import MAX_RUNS, OUTSIDE, REACH, neighbour_runs
from rbf.lanes import below, compress, count_bits, load, magnitude, positive, spread, store
from rbf.profiles import LEAN, OPTIONS
from rbf.sum_kernels import line_start, value_and_gradient

LANES = 8  # centres at a time; arrays of centres are longer by as many
# Queries in a cell from which its parts (2^3, 4^3) are worth a closer choice of centres each.
DENSE, VERY_DENSE = 64, 600
FAR = 1e3  # where padding centres lie, in support radii


@njit(**LEAN)
def bounds(points, order, first, last, box):
    """Middle and half width of the box around points order[first:last], into box (2, 3)."""
    for axis in range(3):
        low = high = points[order[first], axis]
        for q in range(first + 1, last):
            low = min(low, points[order[q], axis])
            high = max(high, points[order[q], axis])
        box[0, axis], box[1, axis] = 0.5 * (low + high), 0.5 * (high - low)


@njit(**OPTIONS)
def room(runs, near):
    """`near`, or a longer array if the centres of the runs (k, 2) might not fit into it."""
    needed = 4 * LANES
    for run in range(runs.shape[0]):
        needed += runs[run, 1] - runs[run, 0]
    if near.shape[1] < needed:
        return np.empty((near.shape[0], 2 * needed // LANES * LANES))
    return near


@njit(**LEAN)
def gather(runs, box, radius, centres, near):
    """Copy the centres of some runs that are nearer than `radius` to a box.

    Parameters
    ----------
    runs : (k, 2) int64 array
    box : (2, 3) float array
        From `bounds`.
    centres : (7 or 4, n + LANES) float array
    near : (7 or 4, m) float array
        Filled; see `room`.

    Returns
    -------
    begin, end : int
        The columns filled, a multiple of LANES: the last ones may have weight 0 and lie far away.
    """
    begin = line_start(near)
    free = begin
    limit = radius * radius
    for run in range(runs.shape[0]):
        start, end = runs[run, 0], runs[run, 1]
        for j in range(start, end, LANES):
            dx = positive(magnitude(load(centres, 0, j) - box[0, 0]) - box[1, 0])
            dy = positive(magnitude(load(centres, 1, j) - box[0, 1]) - box[1, 1])
            dz = positive(magnitude(load(centres, 2, j) - box[0, 2]) - box[1, 2])
            inside = below(dx * dx + (dy * dy + dz * dz), limit)
            inside &= (1 << min(end - j, LANES)) - 1
            for row in range(near.shape[0]):
                store(compress(load(centres, row, j), inside), near, row, free)
            free += count_bits(inside)
    for row in range(near.shape[0]):
        store(spread(FAR + box[0, row] if row < 3 else 0.0), near, row, free)
    return begin, begin + (free - begin + LANES - 1) // LANES * LANES


@njit(**OPTIONS)
def list_runs(first, last, keys, grid, run_start, stored):
    """The runs of centres around cells first to last.

    To be called twice: with empty `stored` it writes how many runs cell i has into
    run_start[i + 1]; with `stored` (k, 2) it fills stored[run_start[i]:run_start[i + 1]].
    """
    runs, around = np.empty((MAX_RUNS, 2), np.int64), np.full((MAX_RUNS + 1, 2), -1)
    for cell in range(first, last):
        count = neighbour_runs(keys[cell], REACH, grid, around, runs)
        if stored.size == 0:
            run_start[cell + 1] = count
        else:
            for run in range(count):
                stored[run_start[cell] + run, 0] = runs[run, 0]
                stored[run_start[cell] + run, 1] = runs[run, 1]


@njit(**LEAN)
def _write(v, gx, gy, gz, p, units, values, gradients):
    """Value and gradient of query p, the gradient where there is room for it."""
    values[p] = v * units[0]
    if gradients.shape[0] > 0:
        gradients[p, 0], gradients[p, 1] = gx * units[1], gy * units[1]
        gradients[p, 2] = gz * units[1]


@njit(**LEAN)
def sum_up(form, near, begin, end, points, order, first, last, units, values, gradients):
    """Values and gradients at points order[first:last] from the centres that were gathered."""
    for place in range(first, last):
        p = order[place]
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        v, gx, gy, gz, supported = value_and_gradient(form, near, begin, end, x, y, z)
        if not supported:
            v = gx = gy = gz = np.nan
        _write(v, gx, gy, gz, p, units, values, gradients)


@njit(**LEAN)
def divide(points, order, first, last, box, sides, places, part_start):
    """Sort queries by the sides^3 equal parts of the box around them.

    Parameters
    ----------
    order, first, last
        The queries are order[first:last].
    box : (2, 3) float array
        From `bounds`.
    places : (last - first,) int64 array
        Filled with the queries, those of one part after those of another.
    part_start : (sides^3 + 1,) int64 array
        Filled with where in `places` each part starts.
    """
    part_start[:] = 0
    for place in range(first, last):
        part_start[_part(points, order[place], box, sides) + 1] += 1
    for part in range(part_start.size - 1):
        part_start[part + 1] += part_start[part]
    for place in range(last - 1, first - 1, -1):
        part = _part(points, order[place], box, sides) + 1
        part_start[part] -= 1
        places[part_start[part]] = order[place]
    for part in range(part_start.size - 1):
        part_start[part] = part_start[part + 1]
    part_start[part_start.size - 1] = last - first


@njit(**LEAN)
def _part(points, query, box, sides):
    part = 0
    for axis in range(3):
        inside = points[query, axis] - (box[0, axis] - box[1, axis])
        place = inside * sides / (2.0 * box[1, axis]) if box[1, axis] > 0.0 else 0.0
        part = part * sides + min(max(int(place), 0), sides - 1)
    return part


@njit(**OPTIONS)
def evaluate(
    first_cell,
    last_cell,
    form,
    points,
    order,
    keys,
    starts,
    centres,
    grid,
    run_start,
    stored,
    units,
    values,
    gradients,
):
    """S and its gradient at the queries of some cells; NaN outside the support.

    Parameters
    ----------
    first_cell, last_cell : int
        The cells to do.
    form : HermiteSum, ValueSum or ValueOnly
    points : (n, 3) float array
        Queries in units of the support radius.
    order, keys, starts : arrays
        The queries' cells, from `CellGrid.bin_queries`.
    centres : (7 or 4, n + LANES) float array
        See the form; in the grid's order.
    grid : tuple
        `CellGrid.arrays` of the centres.
    run_start, stored : int64 arrays
        From `list_runs`, or empty: then the centres near a cell are looked for.
    units : tuple
        By which values and gradients are multiplied.
    values, gradients : (n,) and (n, 3) float arrays
        Results; gradients of shape (0, 3) are left out.
    """
    found, box = np.empty((MAX_RUNS, 2), np.int64), np.empty((2, 3))
    near, around = np.empty((centres.shape[0], 512)), np.full((MAX_RUNS + 1, 2), -1)
    whole = np.empty((1, 2), np.int64)
    part_start = np.empty(4**3 + 1, np.int64)
    for cell in range(first_cell, last_cell):
        first, last = starts[cell], starts[cell + 1]
        if keys[cell] == OUTSIDE:
            for place in range(first, last):
                _write(np.nan, np.nan, np.nan, np.nan, order[place], units, values, gradients)
            continue
        if run_start.size > 0:
            runs = stored[run_start[cell] : run_start[cell + 1]]
        else:
            runs = found[: neighbour_runs(keys[cell], REACH, grid, around, found)]
        bounds(points, order, first, last, box)
        near = room(runs, near)
        begin, end = gather(runs, box, 1.0, centres, near)
        sides = 1 if last - first < DENSE else (2 if last - first < VERY_DENSE else 4)
        if sides == 1:
            places, part_start[0], part_start[1], nearer = order, first, last, near
        else:
            places, nearer = np.empty(last - first, np.int64), np.empty_like(near)
            divide(points, order, first, last, box, sides, places, part_start[: sides**3 + 1])
            whole[0, 0], whole[0, 1] = begin, end
        for part in range(sides**3):
            start, stop = part_start[part], part_start[part + 1]
            if sides > 1 and start < stop:
                bounds(points, places, start, stop, box)
                begin, end = gather(whole, box, 1.0, near, nearer)
            sum_up(form, nearer, begin, end, points, places, start, stop, units, values, gradients)
