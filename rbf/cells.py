"""Points binned in hashed cells: what finds neighbours without a grid over the whole box."""

import numpy as np

from meshes import InvalidCase
from rbf import cell_kernels as kernels
from rbf.threads import in_parts

POINTS = 10_000  # whose keys are worth a thread


class CellGrid:
    """Points of a cloud sorted by cells of half a support radius.

    Parameters
    ----------
    points : (n, 3) float array
        In units of the support radius, finite, n >= 1.

    Attributes
    ----------
    order : (n,) int array
        Points in the order of the cells; within a cell by octants, then as they came.
    keys : (m,) int64 array
        Packed indices of the occupied cells, increasing.
    starts : (m + 1,) int64 array
        The points [starts[i], starts[i + 1]), in cell order, lie in cell i.
    arrays : tuple
        What the compiled loops need: the hash table of the columns, and their cells.

    Raises
    ------
    InvalidCase
        If the points spread over more cells than an index can count (a million supports).
    """

    def __init__(self, points):
        self.lower = points.min(axis=0)
        spread = (points.max(axis=0) - self.lower) * kernels.CELLS_PER_SUPPORT
        if spread.max() > kernels.LARGEST_INDEX - 4 * kernels.MARGIN:
            raise InvalidCase(
                f"the points spread over {spread.max() / kernels.CELLS_PER_SUPPORT:.2g} support "
                "radii, and at most 1e6 can be handled: remove far outliers, or enlarge "
                "support_radius"
            )
        self.upper_index = np.floor(spread).astype(np.int64) + kernels.MARGIN
        _, keys, ranks = self._keys(points, np.zeros(3), 1.0)
        self.order = self._sorted(keys, ranks, self._octants(points), 8)
        self.keys, self.starts = _runs(keys[self.order])
        columns, column_start = _runs(self.keys >> 21)
        size = 1 << max(int(2 * len(columns)).bit_length(), 3)
        table_keys, table_columns = np.full(size, -1, np.int64), np.zeros(size, np.int64)
        kernels.fill_table(columns, table_keys, table_columns)
        cell_z = self.keys & kernels.LARGEST_INDEX
        self.arrays = (table_keys, table_columns, column_start, cell_z, self.starts)

    def _octants(self, points):
        """Which eighth of its cell each point lies in: neighbours stay together in the order."""
        half = np.floor((points - self.lower) * (2.0 * kernels.CELLS_PER_SUPPORT)).astype(np.int64)
        return (half & 1) @ np.array([4, 2, 1])

    def bin_queries(self, points, origin=(0.0, 0.0, 0.0), unit=1.0):
        """Bin query points (n, 3) for this grid's cells.

        Returns
        -------
        scaled : (n, 3) float array
            (points - origin) / unit, the queries in units of the grid.
        order, keys, starts : arrays
            As those of the grid's points. Queries out of reach of every point are collected under
            the key OUTSIDE, which comes first.
        """
        scaled, keys, ranks = self._keys(points, np.array(origin), unit)
        order = self._sorted(keys, ranks, np.zeros(1, np.int64), 1)
        cells, starts = _runs(keys[order])
        return scaled, order, cells, starts

    def _keys(self, points, origin, unit):
        scaled = np.empty((len(points), 3))
        keys, ranks = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
        place = points, origin, float(unit), self.lower, self.upper_index
        in_parts(kernels.cell_keys, len(points), *place, scaled, keys, ranks, least=POINTS)
        return scaled, keys, ranks

    def _sorted(self, keys, ranks, minor, minors):
        """The order of the points by keys, then by `minor` (0 to minors - 1), then as they came."""
        limit = minors * np.prod(self.upper_index + kernels.MARGIN, dtype=float)
        if limit >= 2.0**63:
            return np.lexsort((np.broadcast_to(minor, keys.shape), keys))
        return sorting_order(ranks * minors + minor, limit)


def sorting_order(numbers, limit):
    """The order (n,) that sorts integers (n,) of [0, limit); equal ones stay as they are.

    Sorting each together with its place, as one number, takes a third of the time of `argsort`; it
    is done if both fit into one.
    """
    bits = len(numbers).bit_length()
    if limit * 2.0**bits >= 2.0**63:
        return np.argsort(numbers, kind="stable")
    packed = (numbers << bits) | np.arange(len(numbers))
    packed.sort()
    return packed & ((1 << bits) - 1)


def _runs(values):
    """Distinct values of a sorted array, and where each starts (with the end appended)."""
    if not len(values):
        return values, np.zeros(1, np.int64)
    starts = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1, [len(values)]])
    return values[starts[:-1]], starts
