"""Quadratics fitted to nodal values around points: how a field bends between the nodes."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

NEIGHBOURS = 16
COEFFICIENTS = 10
# Weight of the second derivatives' own size beside the fit: where the nodes around lie in a layer
# so thin that they do not tell a second derivative, it stays small.
RIDGE = 1e-4
CHUNK = 4000
# Second derivatives of the quadratic's six last coefficients: rows and columns of the Hessian.
ROWS, COLUMNS = np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])


class Quadratics(NamedTuple):
    """Quadratics around k places.

    Parameters
    ----------
    values : (k,) float array
    gradients : (k, 3) float array
    hessians : (k, 3, 3) float array
    reach : (k,) float array
        Distance of the farthest point that was used.
    misfit : (k,) float array
        Standard deviation of the points' values from the quadratic, from the residuals that the
        ten coefficients leave (infinite where no more than ten points are used).
    """

    values: np.ndarray
    gradients: np.ndarray
    hessians: np.ndarray
    reach: np.ndarray
    misfit: np.ndarray


def local_quadratics(points, values, at, neighbours=NEIGHBOURS):
    """Fit a quadratic to the nearest points' values around every place.

    Parameters
    ----------
    points : (n, 3) float array
    values : (n,) float array
    at : (k, 3) float array
    neighbours : int
        How many points a quadratic is fitted to, n at most.

    Returns
    -------
    Quadratics

    Notes
    -----
    Weighted least squares; the weight falls to 0 at the farthest point.
    """
    fits, misfit = np.empty((len(at), COEFFICIENTS)), np.empty(len(at))
    distance, near = cKDTree(points).query(at, k=min(neighbours, len(points)))
    distance, near = distance.reshape(len(at), -1), near.reshape(len(at), -1)
    reach = np.maximum(distance[:, -1], np.finfo(float).tiny)
    for start in range(0, len(at), CHUNK):
        part = slice(start, start + CHUNK)
        offsets = points[near[part]] - at[part][:, None]
        fits[part], misfit[part] = _fit(offsets / reach[part, None, None], values[near[part]])
    hessians = np.empty((len(at), 3, 3))
    hessians[:, ROWS, COLUMNS] = hessians[:, COLUMNS, ROWS] = fits[:, 4:] / reach[:, None] ** 2
    return Quadratics(fits[:, 0], fits[:, 1:4] / reach[:, None], hessians, reach, misfit)


def _fit(offsets, values):
    """Quadratics in the unit ball: offsets (k, q, 3), values (k, q).

    Returns
    -------
    coefficients : (k, 10) float array
    misfit : (k,) float array
    """
    x, y, z = np.moveaxis(offsets, 2, 0)
    one = np.ones_like(x)
    basis = [one, x, y, z, 0.5 * x * x, 0.5 * y * y, 0.5 * z * z, y * z, x * z, x * y]
    basis = np.stack(basis, axis=2)
    weight = np.maximum(1.0 - x * x - y * y - z * z, 0.0) + 1e-3
    weighted = (basis * weight[:, :, None]).transpose(0, 2, 1)
    ridge = np.diag([1e-12] * 4 + [RIDGE] * 6) * weight.sum(axis=1)[:, None, None]
    right = weighted @ values[:, :, None]
    fitted = np.linalg.solve(weighted @ basis + ridge, right)[:, :, 0]
    residual = values - np.einsum("kqc,kc->kq", basis, fitted)
    square = (weight * residual**2).sum(axis=1) / weight.sum(axis=1)
    left = values.shape[1] - COEFFICIENTS
    if left <= 0:
        return fitted, np.full(len(values), np.inf)
    return fitted, np.sqrt(square * (values.shape[1] / left))
