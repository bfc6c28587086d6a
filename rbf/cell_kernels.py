"""Compiled loops over hashed cells: keys, and the runs of points around a cell.

Lengths are in units of the support radius. The cells are cubes of half a support radius; a cell's
index is a triple of integers, packed into one 63-bit key (21 bits each). Only occupied cells
exist. Cells that differ in z alone form a column, whose points lie one after the other in memory,
so that a neighbourhood is a few runs of points.
"""

import numpy as np
from numba import njit

from rbf.profiles import LEAN

CELLS_PER_SUPPORT = 2.0  # cells of half a support radius
# A support ends within this many cells; the projection looks one farther. (Typed: a plain number
# would be a type of its own to the compiler, and every function compiled for each.)
REACH, ONE = np.int64(2), np.int64(1)
MARGIN = 2 * REACH + 2  # empty cells kept around the points, so that indices stay positive
LARGEST_INDEX = 2**21 - 1
OUTSIDE = -1  # key of a query farther than REACH cells from every point, or not finite
MAX_RUNS = (2 * REACH + 3) ** 2
STRIDE = 8  # from one cell to the next, in z, up to which their columns need no new search

_HASH = np.uint64(0x9E3779B97F4A7C15)


@njit(**LEAN)
def cell_keys(first, last, points, origin, unit, lower, upper_index, scaled, keys, ranks):
    """Points first to last in units of the grid, and the packed keys of their cells.

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
    ranks : (n,) int64 array
        Result: the keys' order, in numbers as small as the grid allows, but positive; 0 where
        too far. Without meaning in a grid of more than 2^63 cells.
    """
    for p in range(first, last):
        key = rank = np.int64(0)
        for axis in range(3):
            scaled[p, axis] = (points[p, axis] - origin[axis]) / unit
            place = (scaled[p, axis] - lower[axis]) * CELLS_PER_SUPPORT + MARGIN
            if not (place >= MARGIN - REACH and place < upper_index[axis] + REACH + 1):
                key = np.int64(OUTSIDE)
            if key != OUTSIDE:
                key = (key << 21) | np.int64(place)
                rank = rank * (upper_index[axis] + MARGIN) + np.int64(place)
        keys[p], ranks[p] = key, rank if key != OUTSIDE else 0


@njit(**LEAN)
def fill_table(column_keys, table_keys, table_columns):
    """Enter columns by key into an open-addressing table (size a power of two, filled with -1)."""
    mask = table_keys.size - 1
    for column in range(column_keys.size):
        slot = _slot(column_keys[column], mask)
        while table_keys[slot] != -1:
            slot = (slot + 1) & mask
        table_keys[slot] = column_keys[column]
        table_columns[slot] = column


@njit(inline="always", **LEAN)
def _slot(key, mask):
    return np.int64((np.uint64(key) * _HASH) >> np.uint64(32)) & mask


@njit(**LEAN)
def find_column(key, table_keys, table_columns):
    """Index of the column with this key, -1 if it is empty."""
    mask = table_keys.size - 1
    slot = _slot(key, mask)
    while table_keys[slot] != -1:
        if table_keys[slot] == key:
            return table_columns[slot]
        slot = (slot + 1) & mask
    return -1


@njit(**LEAN)
def find_columns(key, reach, grid, around):
    """The occupied columns at most `reach` away from that of cell `key`.

    Parameters
    ----------
    around : (MAX_RUNS + 1, 2) int64 array
        Filled with the key and the number of columns; then for each column its first cell that is
        not lower than `reach` below the key's, and where its cells end.
    """
    table_keys, table_columns, column_start, cell_z, _ = grid
    x, y, lowest = key >> 42, (key >> 21) & LARGEST_INDEX, (key & LARGEST_INDEX) - reach
    count = 0
    for i in range(x - reach, x + reach + 1):
        for j in range(y - reach, y + reach + 1):
            column = find_column((i << 21) | j, table_keys, table_columns)
            if column < 0:
                continue
            first, end = column_start[column], column_start[column + 1]
            around[count + 1, 1] = end
            while first < end:
                middle = (first + end) >> 1
                if cell_z[middle] < lowest:
                    first = middle + 1
                else:
                    end = middle
            around[count + 1, 0] = first
            count += 1
    around[0, 0], around[0, 1] = key, count


@njit(**LEAN)
def neighbour_runs(key, reach, grid, around, runs):
    """Runs of points in the cells at most `reach` away from cell `key`.

    Parameters
    ----------
    key : int
        Packed cell index.
    grid : tuple
        The arrays of a `CellGrid` (its `arrays`).
    around : (MAX_RUNS + 1, 2) int64 array
        See `find_columns`. What the last call with the same grid and reach left there shortens the
        search; to begin with, around[0, 0] = -1.
    runs : (MAX_RUNS, 2) int64 array
        Filled with the points [start, end) of each run, in increasing order.

    Returns
    -------
    count : int
        Number of runs.
    """
    if around[0, 0] < 0 or not 0 <= key - around[0, 0] <= STRIDE:
        find_columns(key, reach, grid, around)
    around[0, 0] = key
    cell_z, cell_start = grid[3], grid[4]
    z, count = key & LARGEST_INDEX, 0
    for column in range(1, around[0, 1] + 1):
        first, end = around[column, 0], around[column, 1]
        while first < end and cell_z[first] < z - reach:
            first += 1
        around[column, 0] = beyond = first
        while beyond < end and cell_z[beyond] <= z + reach:
            beyond += 1
        if beyond > first:
            runs[count, 0], runs[count, 1] = cell_start[first], cell_start[beyond]
            count += 1
    return count
