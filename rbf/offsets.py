"""The thesis's form: values 0, +e, -e at every vertex and its two offsets along the normal."""

import numpy as np

from meshes import InvalidCase
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
from rbf.system import PointSystem

OFFSET_PER_SPACING = 0.1


class OffsetInterpolant(CompactInterpolant):
    """S = 0, +e, -e at `points`, points + e n and points - e n; e is `offset`."""

    def __init__(self, points, normals, offset, fit):
        super().__init__(points, fit)
        self.normals, self.offset = normals, offset


def thesis_offset(edge_lengths):
    """The thesis's e: a tenth of the mean of the longest and the shortest edge.

    Notes
    -----
    Thesis section 3.1.
    """
    return (np.max(edge_lengths) + np.min(edge_lengths)) / 20.0


def fit_offsets(
    points,
    normals,
    offset=None,
    support_radius=None,
    tolerance=TOLERANCE,
    neighbours=NEIGHBOURS,
    ridge=0.0,
    noise=None,
    kernel="wendland_c2",
    weld_distance=None,
):
    """Interpolate a surface by offset triples.

    Parameters
    ----------
    points, normals : (n, 3) float arrays
    offset : float, optional
        e, in the unit of the points; a tenth of the spacing if not given (`thesis_offset` has
        the thesis's formula).
    support_radius, tolerance, neighbours, ridge, noise, kernel, weld_distance
        See `fit_hermite`.

    Returns
    -------
    OffsetInterpolant

    Raises
    ------
    InvalidMesh, InvalidCase, NotConverged
        See `fit_hermite`.

    Notes
    -----
    Thesis eqs. (2.24) and (3.1).
    """
    kernel = find_kernel(kernel, compact=True)
    points = check_finite(points, "points")
    normals = check_unit_normals(points, normals)
    check_parameters(tolerance, neighbours, ridge, noise)
    support_radius, spacing = choose_support(points, support_radius)
    offset = OFFSET_PER_SPACING * spacing if offset is None else float(offset)
    if not 0.0 < offset < support_radius:
        raise InvalidCase(f"offset must lie in (0, support_radius), got {offset}")
    kept, _ = weld(points, WELD_PER_SPACING * spacing if weld_distance is None else weld_distance)
    welded = len(points) - len(kept)
    points, normals = points[kept], normals[kept]
    origin = points.min(axis=0)
    sites, step = (points - origin) / support_radius, normals * (offset / support_radius)
    damped = damping(points, normals, spacing, support_radius)
    triples = np.stack([sites, sites + step, sites - step], axis=1)

    def make_system(ridge):
        return PointSystem(sites, triples, kernel.order, np.maximum(ridge, damped))

    right = np.tile([0.0, offset / support_radius, -offset / support_radius], (len(points), 1))
    noise = None if noise is None else noise / support_radius
    system, solution, ridge, errors = fit_system(
        make_system, right, tolerance, neighbours, ridge, noise
    )
    report = make_report(
        system,
        solution,
        ridge,
        errors,
        support_radius,
        welded=welded,
        damped=(damped > 0).sum(),
    )
    fit = (system, kernel, support_radius, spacing, origin, support_radius, report)
    return OffsetInterpolant(points, normals, offset, fit)
