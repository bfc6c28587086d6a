"""Where the level is crossed along the edges of the tetrahedral mesh.

The angle asin(2 phi - 1) of the obstacle potential's profile (1 + sin(d sqrt(2) / eps)) / 2 is
proportional to the distance d from the surface as long as 0 < phi < 1.
"""

from dataclasses import dataclass

import numpy as np

from isosurface.local_quadratics import NEIGHBOURS, local_quadratics
from meshes.errors import InvalidCase

CROSSINGS = ("linear", "sine", "quadratic")
# Angle [radians] by which nodes that lie off a quadratic halve the trust in it: fields of a known
# profile lie within 0.001 to 0.03 of theirs, optimised ones on coarse meshes within 0.07 to 0.2.
MISFIT = 0.1
# A quadratic whose farthest node lies more than this many mean cut edges away says nothing.
LARGEST_REACH = 3.0


@dataclass(frozen=True)
class AngleFits:
    """Quadratics of the angle around a first guess of each crossing.

    Parameters
    ----------
    at : (k, 3) float array [m]
    gradients : (k, 3) float array [1/m]
    hessians : (k, 3, 3) float array [1/m^2]
    valid : (k,) bool array
        False where too few nodes within the interface are near.
    trust : (k,) float array
        1 where the nodes lie on the quadratic, 1/2 where they are off by MISFIT, 0 where it is not
        valid.
    """

    at: np.ndarray
    gradients: np.ndarray
    hessians: np.ndarray
    valid: np.ndarray
    trust: np.ndarray


def edge_crossings(field, edges, level, crossing="linear", clearance=0.01, fits=None):
    """Return t (k,) in (0, 1): the level is met at (1 - t) x_first + t x_second.

    Parameters
    ----------
    field : PhaseField
    edges : (k, 2) int array
        With ends on different sides of the level.
    level : float
    crossing : "linear", "sine" or "quadratic"
        "linear" takes phi as linear along the edge, "sine" the angle of its profile. "quadratic"
        takes the angle as quadratic, with a second derivative fitted to the nodes around, and
        goes on with the angle where a node lies beyond the interface (phi is 0 or 1 there, and
        says nothing of its distance).
    clearance : float
        The crossing stays at least this share of the edge away from both of its ends, so that
        no two crossings coincide (a node that lies exactly on the level counts as inside).
    fits : AngleFits, optional
        If they are at hand.

    Raises
    ------
    InvalidCase
        If the crossing is unknown or the clearance is not in (0, 0.5).
    """
    if crossing not in CROSSINGS:
        raise InvalidCase(f"crossing must be one of {', '.join(CROSSINGS)}, got {crossing!r}")
    if not 0.0 < clearance < 0.5:
        raise InvalidCase(f"clearance must lie in (0, 0.5), got {clearance}")
    if crossing == "linear":
        first, second = field.values[edges].T
        t = (level - first) / (second - first)
    else:
        t = _sine_crossings(field, edges, level)
        if crossing == "quadratic" and len(edges):
            fits = angle_fits(field, edges, level) if fits is None else fits
            t = _quadratic_crossings(field, edges, t, profile_angle(level), fits)
    return np.clip(t, clearance, 1.0 - clearance)


def _sine_crossings(field, edges, level):
    """Crossings (k,) of an angle that is linear along the edges."""
    first, second = profile_angle(field.values[edges]).T
    return (profile_angle(level) - first) / (second - first)


def angle_fits(field, edges, level):
    """Quadratics of the angle around the crossings of edges (k, 2) with the level."""
    points = field.mesh.points
    along = points[edges[:, 1]] - points[edges[:, 0]]
    at = points[edges[:, 0]] + _sine_crossings(field, edges, level)[:, None] * along
    telling = (field.values > 0.0) & (field.values < 1.0)
    if np.count_nonzero(telling) < NEIGHBOURS:
        count = len(edges)
        none = np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count, bool)
        return AngleFits(at, *none, np.zeros(count))
    size = np.linalg.norm(along, axis=1).mean()
    angle = profile_angle(field.values[telling])
    nodes, angles = _with_images(points[telling], angle, field.mesh.symmetry, size)
    found = local_quadratics(nodes, angles, at)
    valid = found.reach <= LARGEST_REACH * size
    trust = valid / (1.0 + (found.misfit / MISFIT) ** 4)
    return AngleFits(at, found.gradients, found.hessians, valid, trust)


def profile_angle(values):
    """The argument of the sine profile, asin(2 phi - 1), with phi clipped to [0, 1]."""
    return np.arcsin(np.clip(2.0 * np.asarray(values) - 1.0, -1.0, 1.0))


def _quadratic_crossings(field, edges, t, level, fits):
    """Crossings (k,) of the angle as a quadratic along the edges; t (k,) is where it was fitted.

    Where the nodes do not lie on the quadratic it is drawn towards the linear angle: half way where
    they are off by MISFIT.
    """
    along = field.mesh.points[edges[:, 1]] - field.mesh.points[edges[:, 0]]
    slope = np.einsum("ki,ki->k", fits.gradients, along)
    bend = np.einsum("ki,kij,kj->k", along, fits.hessians, along)
    first, second = profile_angle(field.values[edges]).T
    known = ((field.values > 0.0) & (field.values < 1.0))[edges].T
    usable = fits.valid & known.any(axis=0)
    ends = (
        _continued(first, second, -t, 1.0 - t, slope, bend, level, known[0] | ~usable),
        _continued(second, first, 1.0 - t, -t, slope, bend, level, known[1] | ~usable),
    )
    first = first + fits.trust * (ends[0] - first)
    second = second + fits.trust * (ends[1] - second)
    return _root(first - level, second - level, fits.trust * bend)


def _continued(end, other, place, other_place, slope, bend, level, known):
    """The angle at one end (k,), where it is not known continued from the other end.

    `place` and `other_place` are the ends' places, in edge lengths from where slope and bend are.
    Where the continued angle would not be on its side of the level it is left as it is.
    """
    angle = other + slope * (place - other_place) + 0.5 * bend * (place**2 - other_place**2)
    across = (angle - level) * (other - level) < 0.0
    return np.where(~known & across, angle, end)


def _root(first, second, bend):
    """Where (1 - t) first + t second - t (1 - t) bend / 2 vanishes; the ends differ in sign."""
    linear = second - first - 0.5 * bend
    root = np.sqrt(np.maximum(linear**2 - 2.0 * bend * first, 0.0))
    below = -linear - np.sign(second - first) * root  # 0 only where the first end is the root
    return np.divide(2.0 * first, below, out=np.zeros(len(first)), where=below != 0.0)


def _with_images(points, values, symmetry, size):
    """Points and values, with their mirror images beyond the symmetry planes near these."""
    for plane in symmetry:
        near = np.abs(points[:, plane.axis] - plane.offset) <= LARGEST_REACH * size
        off = near & (np.abs(points[:, plane.axis] - plane.offset) > 1e-9 * size)
        points = np.concatenate([points, plane.reflect(points[off])])
        values = np.concatenate([values, values[off]])
    return points, values
