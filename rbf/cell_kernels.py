"""Compiled loops over hashed cells: keys, and the runs of points around a cell.

Lengths are in units of the support radius. The cells are cubes of half a support radius; a cell's
index is a triple of integers, packed into one 63-bit key (21 bits each). Only occupied cells
exist. Cells that differ in z alone form a column, whose points lie one after the other in memory,
so that a neighbourhood is a few runs of points.
"""

import numpy as np
from numba import njit

from rbf.profiles import OPTIONS

CELLS_PER_SUPPORT = 2.0  # cells of half a support radius
# A support ends within this many cells; the projection looks one farther. (Typed: a plain number
# would be a type of its own to the compiler, and every function compiled for each.)
REACH, ONE = np.int64(2), np.int64(1)
MARGIN = 2 * REACH + 2  # empty cells kept around the points, so that indices stay positive
LARGEST_INDEX = 2**21 - 1
OUTSIDE = -1  # key of a query farther than REACH cells from every point, or not finite
MAX_RUNS = (2 * REACH + 3) ** 2

_HASH = np.uint64(0x9E3779B97F4A7C15)


@njit(**OPTIONS)
def cell_keys(first, last, points, origin, unit, lower, upper_index, scaled, keys):
    """Points first to last in units of the grid, and their packed cell keys.

    Parameters
    ----------
    points : (n, 3) float array
    origin, unit : (3,) float array, float
        What is 0 and what is 1 in `scaled`.
    lower, upper_index : (3,) arrays
        Of the `CellGrid`.
    scaled : (n, 3) float array
        Result.
    keys : (n,) int64 array
        Result; OUTSIDE where too far.
    """
    for p in range(first, last):
        key = np.int64(0)
        for axis in range(3):
            scaled[p, axis] = (points[p, axis] - origin[axis]) / unit
            place = (scaled[p, axis] - lower[axis]) * CELLS_PER_SUPPORT + MARGIN
            if not (place >= MARGIN - REACH and place < upper_index[axis] + REACH + 1):
                key = np.int64(OUTSIDE)
            if key != OUTSIDE:
                key = (key << 21) | np.int64(place)
        keys[p] = key


@njit(**OPTIONS)
def fill_table(column_keys, table_keys, table_columns):
    """Enter columns by key into an open-addressing table (size a power of two, filled with -1)."""
    mask = table_keys.size - 1
    for column in range(column_keys.size):
        slot = _slot(column_keys[column], mask)
        while table_keys[slot] != -1:
            slot = (slot + 1) & mask
        table_keys[slot] = column_keys[column]
        table_columns[slot] = column


@njit(inline="always", **OPTIONS)
def _slot(key, mask):
    return np.int64((np.uint64(key) * _HASH) >> np.uint64(32)) & mask


@njit(**OPTIONS)
def find_column(key, table_keys, table_columns):
    """Index of the column with this key, -1 if it is empty."""
    mask = table_keys.size - 1
    slot = _slot(key, mask)
    while table_keys[slot] != -1:
        if table_keys[slot] == key:
            return table_columns[slot]
        slot = (slot + 1) & mask
    return -1


@njit(**OPTIONS)
def neighbour_runs(key, reach, grid, runs):
    """Runs of points in the cells at most `reach` away from cell `key`.

    Parameters
    ----------
    key : int
        Packed cell index.
    grid : tuple
        The arrays of a `CellGrid` (its `arrays`).
    runs : (MAX_RUNS, 2) int64 array
        Filled with the points [start, end) of each run, in increasing order.

    Returns
    -------
    count : int
        Number of runs.
    """
    table_keys, table_columns, column_start, cell_z, cell_start = grid
    x, y, z = key >> 42, (key >> 21) & LARGEST_INDEX, key & LARGEST_INDEX
    count = 0
    for i in range(x - reach, x + reach + 1):
        for j in range(y - reach, y + reach + 1):
            column = find_column((i << 21) | j, table_keys, table_columns)
            if column < 0:
                continue
            first, last = column_start[column], column_start[column + 1]
            end = last
            while first < end:  # first cell of the column at or above z - reach
                middle = (first + end) >> 1
                if cell_z[middle] < z - reach:
                    first = middle + 1
                else:
                    end = middle
            beyond = first
            while beyond < last and cell_z[beyond] <= z + reach:
                beyond += 1
            if beyond > first:
                runs[count, 0], runs[count, 1] = cell_start[first], cell_start[beyond]
                count += 1
    return count
