"""Projection onto the box and the volume in a diagonal metric: the cheap half of every step."""

import numpy as np

from meshes.errors import InvalidCase
from topopt.projection_kernels import projected_volume

VOLUME_TOLERANCE = 1e-15


def check_volume(mass, volume, lower, upper):
    """Raise InvalidCase unless some field within the bounds has the volume."""
    least, most = float(mass @ lower), float(mass @ upper)
    slack = 1e-12 * (abs(least) + abs(most))
    if not least - slack <= volume <= most + slack:
        raise InvalidCase(
            f"a volume of {volume:g} m^3 cannot be met: the bounds (passive regions) allow "
            f"{least:g} to {most:g} m^3; change volume_fraction or the regions."
        )


def project_in_metric(linear, diagonal, mass, volume, lower, upper):
    """Minimise 1/2 x^T diag(D) x - b^T x over lower <= x <= upper, m^T x = volume.

    Parameters
    ----------
    linear, diagonal, mass : (n,) float arrays
        b, D > 0 and m > 0.
    volume : float [m^3]
    lower, upper : (n,) float arrays

    Returns
    -------
    x : (n,) float array
    kappa : float
        The multiplier: x = clip((b - kappa m) / D, lower, upper).

    Raises
    ------
    InvalidCase
        If the bounds do not allow the volume.
    """
    check_volume(mass, volume, lower, upper)
    x = np.empty(len(mass))
    low = float(np.min((linear - diagonal * upper) / mass))  # everything at its upper bound
    high = float(np.max((linear - diagonal * lower) / mass))
    kappa, last = 0.5 * (low + high), np.inf
    for _ in range(200):
        value, slope = projected_volume(kappa, linear, diagonal, mass, lower, upper, x)
        excess = value - volume
        if abs(excess) <= VOLUME_TOLERANCE * volume:
            break
        low, high = (max(low, kappa), high) if excess > 0 else (low, min(high, kappa))
        newton = kappa + excess / slope if slope > 0 else np.nan
        slow = abs(excess) > 0.5 * last
        best, kappa = kappa, newton if low < newton < high and not slow else 0.5 * (low + high)
        last = abs(excess)
        if kappa in (best, low, high):
            break
    return x, kappa


def project_volume(values, mass, volume, lower, upper):
    """Field nearest to `values` (n,) in the lumped L2 metric, within the bounds, at the volume."""
    return project_in_metric(mass * values, mass, mass, volume, lower, upper)[0]
