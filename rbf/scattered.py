"""Interpolation of values at scattered points."""

import numpy as np

from meshes import InvalidMesh
from rbf.fit import NEIGHBOURS, TOLERANCE, check_parameters, fit_system, make_report
from rbf.interpolant import CompactInterpolant
from rbf.kernels import find_kernel
from rbf.spacing import WELD_PER_SPACING, check_finite, choose_support, weld
from rbf.system import PointSystem


class ValueInterpolant(CompactInterpolant):
    """S = `data` (n,) at `points`."""

    def __init__(self, points, data, fit):
        super().__init__(points, fit)
        self.data = data


def fit_values(
    points,
    values,
    support_radius=None,
    kernel="wendland_c2",
    tolerance=TOLERANCE,
    neighbours=NEIGHBOURS,
    ridge=0.0,
    noise=None,
    weld_distance=None,
):
    """Interpolate values at scattered points with a compactly supported kernel.

    Parameters
    ----------
    points : (n, 3) float array
    values : (n,) float array
    support_radius : float, optional
        In the unit of the points; six spacings if not given (`spacing.point_spacing`, which is
        meant for points of a surface; give the radius for points that fill a volume).
    kernel : str
        One of Wendland's: "wendland_c0" to "wendland_c6".
    tolerance, neighbours, ridge, noise, weld_distance
        See `fit_hermite`; the noise is that of the values. The values of welded points are
        averaged.

    Returns
    -------
    ValueInterpolant

    Raises
    ------
    InvalidMesh, InvalidCase, NotConverged
        See `fit_hermite`.

    Notes
    -----
    Thesis eqs. (2.21)-(2.23).
    """
    kernel = find_kernel(kernel, compact=True)
    points, values = check_values(points, values)
    check_parameters(tolerance, neighbours, ridge, noise)
    support_radius, spacing = choose_support(points, support_radius)
    distance = WELD_PER_SPACING * spacing if weld_distance is None else weld_distance
    welded = len(points)
    points, values = average_duplicates(points, values, distance)
    welded -= len(points)
    origin = points.min(axis=0)
    sites = (points - origin) / support_radius

    def make_system(ridge):
        return PointSystem(sites, sites[:, None], kernel.order, ridge)

    # the order of the sites is the same for every ridge
    right = np.ascontiguousarray(values[make_system(0.0).site_order, None])
    system, solution, ridge, errors = fit_system(
        make_system, right, tolerance, neighbours, ridge, noise
    )
    report = make_report(system, solution, ridge, errors, 1.0, welded=welded)
    fit = (system, kernel, support_radius, spacing, origin, 1.0, report)
    return ValueInterpolant(points, values, fit)


def check_values(points, values):
    """Finite points (n, 3) and as many finite values (n,).

    Raises
    ------
    InvalidMesh
    """
    points, values = check_finite(points, "points"), check_finite(values, "values", width=1)
    if len(points) != len(values):
        raise InvalidMesh(f"{len(points)} points need as many values, got {len(values)}")
    return points, values


def average_duplicates(points, values, distance):
    """Weld points that nearly coincide and average their values: (points, values)."""
    kept, cluster = weld(points, distance)
    if len(kept) == len(points):
        return points, values
    count = np.bincount(cluster)
    return points[kept], np.bincount(cluster, values) / count
