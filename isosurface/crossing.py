"""Where the level is crossed along an edge of the tetrahedral mesh."""

import numpy as np

from meshes.errors import InvalidCase

CROSSINGS = ("linear", "sine")


def crossing_parameter(first, second, level, crossing="linear", clearance=0.01):
    """Return t (k,) in (0, 1): the level is met at (1 - t) x_first + t x_second.

    Parameters
    ----------
    first, second : (k,) float arrays
        Nodal values at the two ends, on different sides of the level.
    level : float
    crossing : "linear" or "sine"
        "linear" takes phi as linear along the edge. "sine" takes asin(2 phi - 1) as linear,
        which is exact for the profile (1 + sin(d sqrt(2) / eps)) / 2 of the obstacle potential
        as long as both ends lie within the interface.
    clearance : float
        The crossing stays at least this share of the edge away from both of its ends, so that
        no two crossings coincide (a node that lies exactly on the level counts as inside).

    Raises
    ------
    InvalidCase
        If the crossing is unknown or the clearance is not in (0, 0.5).
    """
    if crossing not in CROSSINGS:
        raise InvalidCase(f"crossing must be one of {', '.join(CROSSINGS)}, got {crossing!r}")
    if not 0.0 < clearance < 0.5:
        raise InvalidCase(f"clearance must lie in (0, 0.5), got {clearance}")
    if crossing == "sine":
        first, second, level = (profile_angle(v) for v in (first, second, level))
    t = (level - first) / (second - first)
    return np.clip(t, clearance, 1.0 - clearance)


def profile_angle(values):
    """The argument of the sine profile, asin(2 phi - 1), with phi clipped to [0, 1]."""
    return np.arcsin(np.clip(2.0 * np.asarray(values) - 1.0, -1.0, 1.0))
