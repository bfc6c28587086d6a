"""Scattered values on several levels: coarse ones with a wide support, fine ones correct them.

One support tied to the spacing misses slowly varying parts between the points (it does not even
reproduce constants), and a wide one makes the system dense and ill-conditioned. A few levels of
thinned points, each interpolating what the coarser ones left over, cost no more than one fit and
are more accurate by an order of magnitude.
"""

import numpy as np

from meshes import InvalidCase
from rbf.scattered import check_values, fit_values
from rbf.spacing import point_spacing

LEVELS = 4
SUPPORT_PER_SPACING = 5.0
LEAST_SUPPORT = 2.0  # in spacings: a cube of thinned points is sqrt(3) across
LEAST_POINTS = 20


class LevelsInterpolant:
    """A sum of interpolants, coarse to fine; defined where the finest one is.

    Attributes
    ----------
    levels : tuple of ValueInterpolant
    points : (n, 3) float array
        Of the finest level.
    """

    def __init__(self, levels):
        self.levels = tuple(levels)
        self.points = self.levels[-1].points

    def value(self, points):
        """S at points (n, 3): (n,), NaN outside the support."""
        return sum(level.value(points) for level in self.levels)

    def gradient(self, points):
        """Gradient of S at points (n, 3): (n, 3), NaN outside the support."""
        return sum(level.gradient(points) for level in self.levels)

    def value_and_gradient(self, points):
        """Both at once."""
        parts = [level.value_and_gradient(points) for level in self.levels]
        return sum(part[0] for part in parts), sum(part[1] for part in parts)

    def hessian(self, points):
        """Second derivatives of S at points (n, 3): (n, 3, 3); errors as `ValueInterpolant`."""
        return sum(level.hessian(points) for level in self.levels)


def fit_levels(
    points, values, levels=LEVELS, support_per_spacing=SUPPORT_PER_SPACING, spacing=None, **options
):
    """Interpolate scattered values on several levels.

    Parameters
    ----------
    points : (n, 3) float array
    values : (n,) float array
    levels : int
        Each coarser level has points twice as far apart; levels of fewer than 20 points are left
        out.
    support_per_spacing : float
        Support radius of every level in its own spacings.
    spacing : float, optional
        Of the points, in their unit; measured if not given.
    **options
        For `fit_values`: kernel, tolerance, neighbours.

    Returns
    -------
    LevelsInterpolant

    Raises
    ------
    InvalidCase, InvalidMesh, NotConverged
        If a parameter makes no sense, and as `fit_values`.

    Notes
    -----
    Floater and Iske 1996.
    """
    if levels < 1 or not support_per_spacing > 0.0:
        raise InvalidCase(
            f"levels must be at least 1 and support_per_spacing positive, got {levels} and "
            f"{support_per_spacing}"
        )
    if levels > 1 and support_per_spacing < LEAST_SUPPORT:
        raise InvalidCase(
            f"support_per_spacing must be at least {LEAST_SUPPORT:g} where there are several "
            f"levels, or thinned points do not reach all others, got {support_per_spacing}"
        )
    points, values = check_values(points, values)
    spacing = point_spacing(points, instead="spacing") if spacing is None else float(spacing)
    if not (np.isfinite(spacing) and spacing > 0.0):
        raise InvalidCase(f"spacing must be positive and finite, got {spacing}")
    rest, fitted = values, []
    for level in range(levels - 1, -1, -1):
        distance = spacing * 2.0**level
        chosen = thin_out(points, distance) if level else np.arange(len(points))
        if level and len(chosen) < LEAST_POINTS:
            continue
        radius = support_per_spacing * distance
        fitted.append(fit_values(points[chosen], rest[chosen], radius, **options))
        if level:
            rest = rest - fitted[-1].value(points)
    return LevelsInterpolant(fitted)


def thin_out(points, distance):
    """The first point in each cube of a side `distance`: (k,) increasing indices."""
    cells = np.floor((points - points.min(axis=0)) / distance).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return np.sort(first)
