"""How far a field is from a stationary point of J under box and volume.

With G = M^-1 grad J [Pa], multiplier kappa of the volume and g = G + kappa, the conditions are
g = 0 where lower < phi < upper, g <= 0 on the upper bound, g >= 0 on the lower one. Everything is
measured in the lumped L2 norm over the domain, divided by s = max(gamma / eps, |kappa|) and
sqrt|Omega|, so that no figure depends on the mesh size or on units.
"""

from dataclasses import asdict, dataclass

import numpy as np

from topopt.projection import project_volume


@dataclass(frozen=True)
class KKT:
    """The optimality of a field.

    Parameters
    ----------
    residual : float
        || phi - P(phi - G / s) ||_M / sqrt|Omega|, P the projection onto box and volume: 0 exactly
        at stationary points, and all four conditions in one.
    stationarity : float
        || g ||_M on the nodes between the bounds.
    complementarity : float
        int g+ (phi - lower) + g- (upper - phi), over s |Omega|: with g+ and g- for multipliers
        this is the slackness left, and the most that J could fall to first order within the box.
    sign : float
        || the part of g with the wrong sign ||_M on the nodes at the bounds.
    volume_error : float
        |int phi - V| / V.
    kappa : float [Pa]
        Multiplier of the volume, the mean of -G over the nodes between the bounds.
    scale : float [Pa]
        s.
    """

    residual: float
    stationarity: float
    complementarity: float
    sign: float
    volume_error: float
    kappa: float
    scale: float

    def as_dict(self):
        """The figures by name, for JSON."""
        return asdict(self)


def kkt_conditions(phi, gradient, mass, volume, pressure, lower, upper):
    """Measure the conditions.

    Parameters
    ----------
    phi, gradient, mass : (n,) float arrays
        The field, the nodal derivatives of J [J], and the lumped mass [m^3].
    volume : float or None [m^3]
        None leaves the volume free: kappa = 0.
    pressure : float [Pa]
        gamma / eps.
    lower, upper : (n,) float arrays

    Returns
    -------
    KKT
    """
    density = gradient / mass
    inactive = (phi > lower) & (phi < upper)
    free = volume is None
    kappa = 0.0 if free else volume_multiplier(phi, density, mass, inactive, lower, upper)
    g = density + kappa
    scale = max(pressure, abs(kappa))
    total = float(mass.sum())

    def norm(values):
        return float(np.sqrt(mass @ (values * values) / total))

    moved = phi - density / scale
    bounds = (lower, upper)
    moved = np.clip(moved, *bounds) if free else project_volume(moved, mass, volume, *bounds)
    wrong = np.where(phi >= upper, np.maximum(g, 0.0), np.minimum(g, 0.0))
    slack = np.maximum(g, 0.0) * (phi - lower) + np.maximum(-g, 0.0) * (upper - phi)
    return KKT(
        residual=norm(moved - phi),
        stationarity=norm(np.where(inactive, g, 0.0)) / scale,
        complementarity=float(mass @ slack) / (scale * total),
        sign=norm(np.where(inactive | (lower == upper), 0.0, wrong)) / scale,
        volume_error=0.0 if free else abs(float(mass @ phi) / volume - 1.0),
        kappa=kappa,
        scale=scale,
    )


def volume_multiplier(phi, density, mass, inactive, lower, upper):
    """kappa [Pa] by least squares on the inactive nodes.

    With no inactive node: midway between what the upper and the lower bounds allow.
    """
    if np.any(inactive):
        weight = mass[inactive]
        return -float(weight @ density[inactive] / weight.sum())
    at_upper, at_lower = (phi >= upper) & (upper > lower), (phi <= lower) & (upper > lower)
    limits = []
    if np.any(at_upper):
        limits.append(-density[at_upper].max())
    if np.any(at_lower):
        limits.append(-density[at_lower].min())
    return float(np.mean(limits)) if limits else 0.0
