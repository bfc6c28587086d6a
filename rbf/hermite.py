"""The Hermite form: value 0 and normal derivative 1 at every vertex of a surface.

Two unknowns per vertex instead of the thesis's three, no offset to choose, and a slope of exactly
one at the vertices.
"""

import numpy as np

from rbf.fit import (
    NEIGHBOURS,
    TOLERANCE,
    check_parameters,
    check_unit_normals,
    fit_system,
    make_report,
)
from rbf.interpolant import CompactInterpolant
from rbf.kernels import find_kernel
from rbf.spacing import WELD_PER_SPACING, check_finite, choose_support, damping, weld
from rbf.system import DERIVATIVE_SCALE, HermiteSystem


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
    noise=None,
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
        Earlier sites that each group of rows of the preconditioner sees: more make it stronger.
    ridge : float or "gcv"
        Added to the diagonal of the values (which is 1): 0 interpolates, 0.01 to 1 smooths;
        "gcv" chooses it by generalised cross-validation.
    noise : float, optional
        Standard deviation of the points along their normals, in their unit: the ridge is chosen
        so that the surface deviates by as much (discrepancy principle).
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
    check_parameters(tolerance, neighbours, ridge, noise)
    support_radius, spacing = choose_support(points, support_radius)
    kept, _ = weld(points, WELD_PER_SPACING * spacing if weld_distance is None else weld_distance)
    welded = len(points) - len(kept)
    points, normals = points[kept], normals[kept]
    origin = points.min(axis=0)
    sites, damped = (
        (points - origin) / support_radius,
        damping(points, normals, spacing, support_radius),
    )

    def make_system(ridge):
        return HermiteSystem(sites, normals, kernel.order, np.maximum(ridge, damped))

    right = np.zeros((len(points), 2))
    right[:, 1] = DERIVATIVE_SCALE
    noise = None if noise is None else noise / support_radius
    system, solution, ridge, errors = fit_system(
        make_system, right, tolerance, neighbours, ridge, noise
    )
    slope_error = np.abs(errors[:, 1]).max() / DERIVATIVE_SCALE
    report = make_report(
        system, solution, ridge, errors, support_radius, slope_error, welded, (damped > 0).sum()
    )
    fit = (system, kernel, support_radius, spacing, origin, support_radius, report)
    return HermiteInterpolant(points, normals, fit)
