"""The linear system of an interpolant with compact support, without its matrix.

The evaluator serves as the product of the matrix with a vector: the coefficients become a sum of
kernels, which is evaluated at the sites. All lengths are in units of the support radius.
"""

import numpy as np

from rbf import evaluate_kernels
from rbf.cells import CellGrid
from rbf.evaluate_kernels import LANES
from rbf.sum_kernels import ROWS, sum_form
from rbf.threads import in_parts

# The derivative functional of the Hermite form is scaled by a fifth of the support radius, which
# makes its diagonal entry about that of the value.
DERIVATIVE_SCALE = 0.2


class HermiteSystem:
    """Values and normal derivatives at sites; unknowns (n, 2), in the order of the cells.

    Parameters
    ----------
    points, normals : (n, 3) float arrays
        Sites in units of the support radius, and unit normals.
    order : int
        k of Wendland's phi_{3,k}, at least 1.
    ridge : float or (n,) float array
        Added to the diagonal entries of the values (which are 1).
    """

    unknowns_per_site = 2
    ridge_columns = 1
    hermite = True

    def __init__(self, points, normals, order, ridge=0.0):
        self.order = order
        self.grid = CellGrid(points)
        self.sites = self.positions = np.ascontiguousarray(points[self.grid.order])
        self.normals = np.ascontiguousarray(normals[self.grid.order])
        self.site_order = self.grid.order
        self.ridge = _sorted_ridge(ridge, self.site_order)
        self.centre_grid = self.grid
        self.form = sum_form(order, self.hermite)
        self.centres = _empty_centres(self.form, self.sites)
        self._order = np.arange(len(points))
        self._value, self._gradient = np.empty(len(points)), np.empty((len(points), 3))
        self._runs = _near_runs(self.grid)

    def set_coefficients(self, x):
        """Make `centres` the sum with the coefficients x (n, 2)."""
        n = len(x)
        self.centres[3, :n] = x[:, 0]
        np.multiply(self.normals.T, -DERIVATIVE_SCALE * x[:, 1], out=self.centres[4:, :n])

    def multiply(self, x, out):
        """out = A x for arrays (n, 2)."""
        self.set_coefficients(x)
        _sum_up(self)
        np.multiply(x[:, 0], self.ridge, out=out[:, 0])
        out[:, 0] += self._value
        np.einsum("ij,ij->i", self._gradient, self.normals, out=out[:, 1])
        out[:, 1] *= DERIVATIVE_SCALE


class PointSystem:
    """Values at points, m of them to a site (1: scattered values; 3: offset triples).

    Parameters
    ----------
    sites : (n, 3) float array
        In units of the support radius.
    positions : (n, m, 3) float array
        Where the values of each site are given.
    order : int
        k of Wendland's phi_{3,k}.
    ridge : float or (n,) float array
        Added to the diagonal (whose entries are 1).
    """

    hermite = False

    def __init__(self, sites, positions, order, ridge=0.0):
        self.order = order
        self.unknowns_per_site = self.ridge_columns = positions.shape[1]
        self.grid = CellGrid(sites)
        self.site_order = self.grid.order
        self.ridge = _sorted_ridge(ridge, self.site_order)
        self.sites = np.ascontiguousarray(sites[self.site_order])
        self.positions = np.ascontiguousarray(positions[self.site_order].reshape(-1, 3))
        self.normals = np.empty((0, 3))
        self.centre_grid = self.grid
        if self.unknowns_per_site > 1:
            self.centre_grid = CellGrid(self.positions)
        self._order = self._places()
        self.form = sum_form(order, self.hermite)
        self.centres = _empty_centres(self.form, self.positions[self._order])
        self._value = np.empty(len(self.positions))
        self._gradient = np.empty((len(self.positions), 3))
        self._runs = _near_runs(self.centre_grid)

    def _places(self):
        if self.centre_grid is self.grid:
            return np.arange(len(self.positions))
        return self.centre_grid.order

    def set_coefficients(self, x):
        """Make `centres` the sum with the coefficients x (n, m)."""
        weights = self.centres[3, : len(self._order)]
        np.take(x.reshape(-1), self._order, out=weights, mode="clip")

    def multiply(self, x, out):
        """out = A x for arrays (n, m)."""
        self.set_coefficients(x)
        _sum_up(self)
        np.multiply(x, self.ridge[:, None], out=out)
        out += self._value.reshape(out.shape)


def _empty_centres(form, points):
    """Centres at points (n, 3) without weights, one row per coordinate and weight."""
    centres = np.zeros((ROWS[type(form)], len(points) + LANES))
    centres[:3, : len(points)] = points.T
    return centres


def _near_runs(grid):
    """The runs of centres around each cell, which all products share: starts and runs."""
    starts = np.zeros(len(grid.keys) + 1, np.int64)
    place = len(grid.keys), grid.keys, grid.arrays, starts
    in_parts(evaluate_kernels.list_runs, *place, np.empty((0, 2), np.int64))
    np.cumsum(starts, out=starts)
    runs = np.empty((starts[-1], 2), np.int64)
    in_parts(evaluate_kernels.list_runs, *place, runs)
    return starts, runs


def _sum_up(system):
    """The sum of a system's kernels, and its gradient, at its positions."""
    grid = system.centre_grid
    in_parts(
        evaluate_kernels.evaluate,
        len(grid.keys),
        system.form,
        system.positions,
        system._order,
        grid.keys,
        grid.starts,
        system.centres,
        grid.arrays,
        *system._runs,
        (1.0, 1.0),
        system._value,
        system._gradient,
    )


def _sorted_ridge(ridge, order):
    return np.ascontiguousarray(np.broadcast_to(np.asarray(ridge, dtype=float), order.shape)[order])
