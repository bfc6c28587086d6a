"""Passive regions: nodes whose phase is given, as bounds of the phase field."""

import numpy as np

from meshes.errors import InvalidCase
from topopt.problem import BoxDomain
from topopt.regions import contains, in_words, tolerance_of

SAMPLES = 48  # along each side of a box
UNSURE = 0.03  # of the domain: what sampling may miss


def passive_bounds(mesh, problem):
    """Lower and upper bounds (n,) of phi: 0 and 1, equal at the nodes of passive regions.

    A node in a solid and a void region is solid: regions that share a face have such nodes.

    Raises
    ------
    InvalidCase
        A region that holds no node, or a name given twice.
    """
    lower, upper = np.zeros(len(mesh.points)), np.ones(len(mesh.points))
    found = {}
    for passive in problem.passive:
        if passive.name in found:
            raise InvalidCase(
                f"passive region '{passive.name}' is given twice; give every one its own name."
            )
        found[passive.name] = _nodes(mesh, passive)
    for passive in problem.passive:
        if not passive.solid:
            upper[found[passive.name]] = 0.0
    for passive in problem.passive:
        if passive.solid:
            lower[found[passive.name]] = upper[found[passive.name]] = 1.0
    return lower, upper


def check_room(mass, lower, upper, volume_fraction):
    """Raise InvalidCase unless passive regions leave a choice at the volume fraction.

    Parameters
    ----------
    mass : (n,) float array [m^3]
    lower, upper : (n,) float arrays
    volume_fraction : float
    """
    whole = float(mass.sum())
    _check_shares(float(mass @ lower) / whole, float(mass @ upper) / whole, volume_fraction)


def _check_shares(solid, most, volume_fraction):
    if not solid < volume_fraction:
        raise InvalidCase(
            f"volume_fraction is {volume_fraction:g}, but the passive solid regions alone take at "
            f"least {solid:.2g} of the domain; raise it above that, or shrink them."
        )
    if not volume_fraction < most:
        raise InvalidCase(
            f"volume_fraction is {volume_fraction:g}, but the passive void regions leave at most "
            f"{most:.2g} of the domain; lower it below that, or shrink them."
        )


def check_passive(problem):
    """Raise InvalidCase if a box's passive regions clearly leave no room, before it is meshed.

    Their shares of the box are found by sampling, and so known to within a few per cent.
    """
    if not problem.passive or not isinstance(problem.domain, BoxDomain):
        return
    lower, upper = np.asarray(problem.domain.lower), np.asarray(problem.domain.upper)
    grid = (np.indices((SAMPLES,) * 3).reshape(3, -1).T + 0.5) / SAMPLES
    points = lower + grid * (upper - lower)
    solid, void = np.zeros(len(points), bool), np.zeros(len(points), bool)
    for passive in problem.passive:
        inside = contains(passive.region, points, 0.0)
        solid |= inside & passive.solid
        void |= inside & (not passive.solid)
    shares = np.array([solid.mean() - UNSURE, 1.0 - (void & ~solid).mean() + UNSURE])
    _check_shares(*shares, problem.volume_fraction)


def _nodes(mesh, passive):
    """Which nodes (n,) a region holds; InvalidCase if none."""
    inside = contains(passive.region, mesh.points, tolerance_of(mesh.points))
    if not inside.any():
        low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
        domain = " x ".join(f"[{a:.6g}, {b:.6g}]" for a, b in zip(low, high))
        raise InvalidCase(
            f"passive region '{passive.name}' holds no node of the mesh: it is "
            f"{in_words(passive.region)}, the domain spans {domain} m; move or enlarge it, or "
            f"refine the mesh."
        )
    return inside
