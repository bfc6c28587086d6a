"""The Hermite form: value 0 and normal derivative 1 at every vertex of a surface.

Two unknowns per vertex instead of the thesis's three, no offset to choose, and a slope of exactly
one at the vertices.
"""

import numpy as np

from meshes import InvalidCase, InvalidMesh
from rbf.interpolant import CompactInterpolant, FitReport
from rbf.kernels import find_kernel
from rbf.solve import solve
from rbf.spacing import WELD_PER_SPACING, check_finite, choose_support, damping, weld
from rbf.system import DERIVATIVE_SCALE, HermiteSystem

NEIGHBOURS = 24
TOLERANCE = 1e-8


class HermiteInterpolant(CompactInterpolant):
    """S = 0 and dS/dn = 1 at `points`, with unit `normals` (n, 3)."""

    def __init__(self, points, normals, fit):
        super().__init__(points, fit)
        self.normals = normals


def fit_hermite(
    points,
    normals,
    support_radius=None,
    tolerance=TOLERANCE,
    neighbours=NEIGHBOURS,
    ridge=0.0,
    kernel="wendland_c2",
    weld_distance=None,
):
    """Interpolate a surface given by points and normals.

    Parameters
    ----------
    points : (n, 3) float array
    normals : (n, 3) float array
        Outward; normalised here.
    support_radius : float, optional
        In the unit of the points; six spacings (`spacing.point_spacing`) if not given.
    tolerance : float
        Relative residual of the linear system.
    neighbours : int
        Earlier sites that each row of the preconditioner sees: more make it stronger.
    ridge : float
        Added to the diagonal of the values (which is 1): 0 interpolates, 1e-4 to 1e-2 smooths.
    kernel : str
        "wendland_c2", "wendland_c4" or "wendland_c6".
    weld_distance : float, optional
        Points nearer than this are one (the first is kept); 1e-4 spacings if not given.

    Returns
    -------
    HermiteInterpolant

    Raises
    ------
    InvalidMesh
        If points or normals are not finite, or a normal is zero.
    InvalidCase
        If a parameter makes no sense.
    NotConverged
        If the system cannot be solved to the tolerance.
    """
    kernel = find_kernel(kernel, compact=True, least_smoothness=2)
    points, normals = check_finite(points, "points"), check_unit_normals(points, normals)
    check_parameters(tolerance, neighbours, ridge)
    support_radius, spacing = choose_support(points, support_radius)
    kept, _ = weld(points, WELD_PER_SPACING * spacing if weld_distance is None else weld_distance)
    welded = len(points) - len(kept)
    points, normals = points[kept], normals[kept]
    origin = points.min(axis=0)
    damped = damping(points, normals, spacing, support_radius)
    system = HermiteSystem(
        (points - origin) / support_radius, normals, kernel.order, np.maximum(ridge, damped)
    )
    right = np.zeros((len(points), 2))
    right[:, 1] = DERIVATIVE_SCALE
    solution, error = solve_system(system, right, tolerance, neighbours)
    report = make_report(
        solution,
        welded,
        np.count_nonzero(damped),
        ridge,
        value_error=error[0] * support_radius,
        slope_error=error[1] / DERIVATIVE_SCALE,
    )
    return HermiteInterpolant(
        points,
        normals,
        (system, kernel, support_radius, spacing, origin, support_radius, report),
    )


def solve_system(system, right, tolerance, neighbours):
    """Solve, and leave the coefficients in the system: (Solution, largest errors (m,))."""
    solution = solve(system, right, tolerance, neighbours)
    product = np.empty_like(right)
    system.multiply(solution.x, product)
    columns = slice(0, system.ridge_columns)
    product[:, columns] -= system.ridge[:, None] * solution.x[:, columns]
    return solution, np.abs(product - right).max(axis=0)


def make_report(solution, welded, damped, ridge, value_error, slope_error=np.nan):
    """The report of a fit from its solution."""
    return FitReport(
        solution.iterations,
        solution.residual,
        float(value_error),
        float(slope_error),
        solution.condition,
        solution.bad_pivots,
        welded,
        int(damped),
        ridge=ridge,
    )


def check_parameters(tolerance, neighbours, ridge):
    """Raise InvalidCase where a parameter of a fit makes no sense."""
    if not 0.0 < tolerance < 1.0:
        raise InvalidCase(f"tolerance must lie in (0, 1), got {tolerance}")
    if neighbours < 1:
        raise InvalidCase(f"neighbours must be at least 1, got {neighbours}")
    if not (np.isfinite(ridge) and ridge >= 0.0):
        raise InvalidCase(f"ridge must be at least 0 and finite, got {ridge}")


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
