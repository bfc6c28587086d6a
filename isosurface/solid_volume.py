"""Volume of {phi >= level} for a field that is linear on every tetrahedron, in closed form."""

import numpy as np

from meshes import InvalidCase
from meshes.tet_mesh import tet_volumes

SECANTS = 6  # steps at most


def solid_volumes(field, level=0.5):
    """Volume (m,) [m^3] of the part of every tetrahedron where the P1 field reaches the level.

    Parameters
    ----------
    field : PhaseField
    level : float
    """
    values = field.values[field.mesh.tets]
    order = np.argsort(-values, axis=1)
    values = np.take_along_axis(values, order, axis=1) - level
    count = (values >= 0).sum(axis=1)
    share = np.where(count == 4, 1.0, 0.0)
    for k, part in ((1, _corner), (2, _wedge), (3, _all_but_corner)):
        rows = count == k
        share[rows] = part(values[rows].T)
    return share * tet_volumes(field.mesh.points, field.mesh.tets)


def solid_volume(field, level=0.5):
    """Volume [m^3] of {phi >= level}: that of the modelled part, and of its extracted surface."""
    return float(solid_volumes(field, level).sum())


def _fraction(a, b):
    """Share of an edge from the end with value a >= 0 to the crossing before value b < 0."""
    return a / (a - b)


def _corner(v):
    """Share of a tetrahedron around its one inside node (values v0 >= 0 > v1, v2, v3)."""
    return _fraction(v[0], v[1]) * _fraction(v[0], v[2]) * _fraction(v[0], v[3])


def _all_but_corner(v):
    """Share that remains when the corner of the one outside node is cut off."""
    return 1.0 - _fraction(-v[3], -v[0]) * _fraction(-v[3], -v[1]) * _fraction(-v[3], -v[2])


def _wedge(v):
    """Share around the edge of two inside nodes 0, 1: three tetrahedra between six points."""
    p, q = _fraction(v[0], v[2]), _fraction(v[0], v[3])
    r, s = _fraction(v[1], v[2]), _fraction(v[1], v[3])
    return p * q + q * r * (1.0 - p) + r * s * (1.0 - q)


def volume_level(field, volume, tolerance=1e-10):
    """Return the level whose solid has the volume asked for, by bisection.

    Parameters
    ----------
    field : PhaseField
    volume : float [m^3]
        Of the modelled part.
    tolerance : float
        Relative to `volume`.

    Raises
    ------
    InvalidCase
        If no level strictly between the field's least and largest values gives it (where the
        field is constant over some volume, not every volume can be met).
    """
    low, high = float(field.values.min()), float(field.values.max())
    for _ in range(100):
        level = 0.5 * (low + high)
        found = solid_volume(field, level)
        if abs(found - volume) <= tolerance * abs(volume):
            return level
        low, high = (level, high) if found > volume else (low, level)
    raise InvalidCase(
        f"no level gives a solid of {volume:g} m^3: nearest is {found:g} m^3 at {level:g}"
    )


def surface_level(field, volume, enclosed, tolerance=1e-6):
    """Return the level whose extracted surface encloses the volume asked for, by secants.

    Parameters
    ----------
    field : PhaseField
    volume : float [m^3]
        Of the modelled part.
    enclosed : callable
        level -> volume [m^3] that the surface at this level encloses.
    tolerance : float
        Relative to `volume`.

    Returns
    -------
    level : float
        The best found in a few steps from `volume_level`, which takes the field as linear.

    Raises
    ------
    InvalidCase
        As `volume_level`.
    """
    level = volume_level(field, volume)
    first, miss = level, enclosed(level) / volume - 1.0
    tried = [(abs(miss), level)]
    if abs(miss) <= tolerance:
        return level
    second = np.clip(level + 0.05 * np.sign(miss), 0.02, 0.98)
    for _ in range(SECANTS):
        next_miss = enclosed(second) / volume - 1.0
        tried.append((abs(next_miss), second))
        if abs(next_miss) <= tolerance or next_miss == miss:
            break
        first, miss, second = (
            second,
            next_miss,
            second - next_miss * (second - first) / (next_miss - miss),
        )
        if not 0.0 < second < 1.0:
            break
    return float(min(tried)[1])
