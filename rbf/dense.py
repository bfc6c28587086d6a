"""Interpolation with global kernels: a dense matrix, with a polynomial tail where it is needed."""

from numbers import Real

import numpy as np
from scipy.linalg import lu_factor, lu_solve
from scipy.linalg.lapack import dgecon

from meshes import InvalidCase, NotConverged
from rbf.kernels import find_kernel
from rbf.scattered import average_duplicates, check_values
from rbf.spacing import WELD_PER_SPACING, point_spacing

LARGEST = 5000  # points: a matrix of 200 MB and its factors
SCALE_PER_SPACING = 2.0
LARGEST_CONDITION = 1e15
CHUNK = 2**21  # distances held at once


class GlobalInterpolant:
    """S(x) = sum_j a_j phi(|x - x_j| / c) + polynomial, defined everywhere.

    Attributes
    ----------
    points : (n, 3) float array
        Centres.
    kernel : Kernel
    scale : float
        c, in the unit of the points.
    condition : float
        Condition number of the dense matrix (1-norm, estimated).
    residual : float
        Largest deviation from the data relative to the largest value (ridge included).
    welded : int
        Points that were averaged with another.
    """

    def __init__(self, points, kernel, scale, coefficients, condition, residual, welded):
        self.points, self.kernel, self.scale = points, kernel, scale
        self.condition, self.residual, self.welded = condition, residual, welded
        self._origin = points.mean(axis=0)
        self._centres = (points - self._origin) / scale
        self._weights = coefficients[: len(points)]
        self._polynomial = np.zeros(4)
        tail = coefficients[len(points) :]
        self._polynomial[: len(tail)] = tail

    def value(self, points):
        """S at points (n, 3): (n,)."""
        return self._collect(points, self._values)

    def gradient(self, points):
        """Gradient of S at points (n, 3): (n, 3)."""
        return self._collect(points, self._gradients) / self.scale

    def value_and_gradient(self, points):
        """Both."""
        return self.value(points), self.gradient(points)

    def hessian(self, points):
        """Second derivatives of S at points (n, 3): (n, 3, 3)."""
        return self._collect(points, self._hessians) / self.scale**2

    def _collect(self, points, part):
        scaled = (np.asarray(points, dtype=float) - self._origin) / self.scale
        step = max(CHUNK // len(self.points), 1)
        pieces = [part(scaled[k : k + step]) for k in range(0, max(len(scaled), 1), step)]
        return np.concatenate(pieces)

    def _chain(self, x):
        d = x[:, None] - self._centres
        return d, self.kernel.chain(np.maximum(np.linalg.norm(d, axis=2), 1e-150))

    def _values(self, x):
        value = self.kernel.chain(np.linalg.norm(x[:, None] - self._centres, axis=2))[0]
        return value @ self._weights + self._polynomial[0] + x @ self._polynomial[1:]

    def _gradients(self, x):
        d, (_, f1, _, _) = self._chain(x)
        return np.einsum("qj,qjk->qk", f1 * self._weights, d) + self._polynomial[1:]

    def _hessians(self, x):
        d, (_, f1, f2, _) = self._chain(x)
        outer = np.einsum("qj,qjk,qjl->qkl", f2 * self._weights, d, d)
        return outer + (f1 @ self._weights)[:, None, None] * np.eye(3)


def fit_global(points, values, kernel="cubic", scale=None, ridge=0.0):
    """Interpolate values at scattered points with a global kernel.

    Parameters
    ----------
    points : (n, 3) float array
        At most 5000.
    values : (n,) float array
    kernel : str
        "gaussian", "multiquadric", "inverse_multiquadric" or "cubic" (polyharmonic r^3). The
        conditionally positive definite ones get a polynomial: a constant for the multiquadric,
        a linear one for r^3.
    scale : float, optional
        c in phi(r / c), in the unit of the points; two spacings if not given. The larger, the
        more accurate and the worse conditioned; r^3 does not depend on it.
    ridge : float
        Added to the diagonal (relative to phi at a distance of one scale): smooths noisy values.

    Returns
    -------
    GlobalInterpolant

    Raises
    ------
    InvalidMesh, InvalidCase
        If the input is not finite, too large, or does not determine the polynomial.
    NotConverged
        If the matrix is numerically singular.

    Notes
    -----
    Thesis table 2.1 and eq. (5.1).
    """
    kernel = find_kernel(kernel, compact=False)
    points, values = check_values(points, values)
    if len(points) > LARGEST:
        raise InvalidCase(
            f"kernel {kernel.name!r} is global and needs a dense matrix, which is limited to "
            f"{LARGEST} points, got {len(points)}: use a Wendland kernel (fit_values), or let "
            "fit_greedy choose centres"
        )
    if not (isinstance(ridge, Real) and 0.0 <= ridge < np.inf):
        raise InvalidCase(f"ridge must be at least 0 and finite, got {ridge!r}")
    scale, spacing = choose_scale(points, scale)
    welded = len(points)
    points, values = average_duplicates(points, values, WELD_PER_SPACING * spacing)
    welded -= len(points)
    centres = (points - points.mean(axis=0)) / scale
    matrix = _matrix(centres, kernel, ridge)
    right = np.zeros(len(matrix))
    right[: len(points)] = values
    coefficients, condition = _solve(matrix, right, kernel)
    deviation = np.abs(matrix @ coefficients - right).max() / (np.abs(values).max() or 1.0)
    return GlobalInterpolant(
        points, kernel, scale, coefficients, condition, float(deviation), welded
    )


def choose_scale(points, scale=None):
    """The scale asked for, or two spacings; (scale, spacing).

    Raises
    ------
    InvalidCase
        If the scale is not positive, or there is no spacing to take it from.
    """
    if scale is None:
        spacing = point_spacing(points, instead="scale")
        return SCALE_PER_SPACING * spacing, spacing
    if not (np.isfinite(scale) and scale > 0.0):
        raise InvalidCase(f"scale must be positive and finite, got {scale}")
    distinct = (points != points[0]).any()
    return float(scale), point_spacing(points) if distinct else float(scale)


def _matrix(centres, kernel, ridge):
    """The matrix of (5.1): kernels, and polynomials of degree < m beside and below."""
    n = len(centres)
    tail = np.hstack([np.ones((n, 1)), centres])[:, : (0, 1, 4)[kernel.polynomial_order]]
    if np.linalg.matrix_rank(tail) < tail.shape[1]:
        raise InvalidCase(
            f"{n} points that lie in a plane (or fewer than 4) do not determine the linear "
            f"polynomial of kernel {kernel.name!r}: choose wendland_c2 or inverse_multiquadric"
        )
    matrix = np.zeros((n + tail.shape[1],) * 2)
    for row in range(n):  # one row at a time: differences, not the expanded square
        distance = np.sqrt(((centres - centres[row]) ** 2).sum(axis=1))
        matrix[row, :n] = kernel.chain(distance)[0]
    matrix[np.arange(n), np.arange(n)] += kernel.sign * ridge * abs(float(kernel(1.0)))
    matrix[:n, n:], matrix[n:, :n] = tail, tail.T
    return matrix


def _solve(matrix, right, kernel):
    norm = np.abs(matrix).sum(axis=0).max()
    factors = lu_factor(matrix)
    reciprocal, _ = dgecon(factors[0], norm)
    condition = 1.0 / reciprocal if reciprocal > 0.0 else np.inf
    if not condition < LARGEST_CONDITION:
        raise NotConverged(
            f"the dense matrix of kernel {kernel.name!r} is numerically singular (condition "
            f"{condition:.1e}): reduce scale, allow a ridge of 1e-10 or more, or use a Wendland "
            "kernel"
        )
    coefficients = lu_solve(factors, right)
    coefficients += lu_solve(factors, right - matrix @ coefficients)  # one refinement
    return coefficients, float(condition)
