"""What all fits with compact support share: checks, solve, choice of a ridge, report."""

from numbers import Real

import numpy as np

from meshes import InvalidCase, InvalidMesh
from rbf.interpolant import FitReport
from rbf.ridge import ridge_by_cross_validation, ridge_for_noise
from rbf.solve import solve
from rbf.spacing import check_finite

NEIGHBOURS = 24
TOLERANCE = 1e-8


def check_parameters(tolerance, neighbours, ridge, noise):
    """Raise InvalidCase where a parameter of a fit makes no sense."""
    if not 0.0 < tolerance < 1.0:
        raise InvalidCase(f"tolerance must lie in (0, 1), got {tolerance}")
    if neighbours < 1:
        raise InvalidCase(f"neighbours must be at least 1, got {neighbours}")
    if ridge != "gcv" and not (isinstance(ridge, Real) and 0.0 <= ridge < np.inf):
        raise InvalidCase(f'ridge must be at least 0 and finite, or "gcv", got {ridge}')
    if noise is not None and not (np.isfinite(noise) and noise > 0.0):
        raise InvalidCase(f"noise must be positive and finite, got {noise}")


def check_unit_normals(points, normals):
    """Normals (n, 3) made unit length.

    Raises
    ------
    InvalidMesh
        If they are not finite, not as many as the points, or zero.
    """
    normals = check_finite(normals, "normals")
    if len(normals) != len(points):
        raise InvalidMesh(f"{len(points)} points need as many normals, got {len(normals)}")
    length = np.linalg.norm(normals, axis=1)
    if not length.all():
        raise InvalidMesh(
            f"{int((length == 0).sum())} normals are zero (the first is row "
            f"{int((length == 0).argmax())}): leave those points out, or repair the faces there"
        )
    return normals / length[:, None]


def fit_system(make_system, right, tolerance, neighbours, ridge=0.0, noise=None):
    """Choose the ridge, solve, and leave the coefficients in the system.

    Parameters
    ----------
    make_system : callable
        ridge (float) -> system.
    right : (n, m) float array
        In the order of the system's sites.
    ridge : float or "gcv"
    noise : float, optional
        Standard deviation of the values, in the unit of `right`; chooses the ridge.

    Returns
    -------
    system, solution, ridge
    errors : (n, m) float array
        Deviation from the data.

    Raises
    ------
    NotConverged
    """
    if noise is not None:
        ridge = ridge_for_noise(make_system, right, noise, neighbours)
    elif ridge == "gcv":
        ridge = ridge_by_cross_validation(make_system, right, neighbours)
    system = make_system(ridge)
    solution = solve(system, right, tolerance, neighbours)
    errors = np.empty_like(right)
    system.multiply(solution.x, errors)
    values = slice(0, system.ridge_columns)
    errors[:, values] -= system.ridge[:, None] * solution.x[:, values]
    errors -= right
    return system, solution, ridge, errors


def make_report(system, solution, ridge, errors, unit, slope_error=np.nan, welded=0, damped=0):
    """The report of a fit; `unit` is that of a value of 1."""
    values = errors[:, : system.ridge_columns] * unit
    return FitReport(
        iterations=solution.iterations,
        residual=solution.residual,
        value_error=float(np.abs(values).max()),
        misfit=float(np.sqrt(np.mean(values**2))),
        slope_error=float(slope_error),
        condition=solution.condition,
        bad_pivots=solution.bad_pivots,
        welded=int(welded),
        damped=int(damped),
        ridge=float(ridge),
    )
