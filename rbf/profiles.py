"""Wendland's functions inside kernels: chosen by the type of an argument.

With t = max(1 - r, 0) every phi_{3,k} and its chain (see `kernels`) is

    phi = u B t^2 p,    f1 = u B t q,    f2 = u B s,

u a number, B a power of t. A profile is an empty value whose type says which k is meant, so that
only the formulas in use are compiled; they work on numbers and on `lanes.Lanes` alike.
"""

from math import sqrt
from typing import NamedTuple

from numba import njit
from numba.extending import overload

OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
# For functions that make no arrays: without reference counts, which every call would change.
LEAN = OPTIONS | {"_nrt": False}
TINY = 1e-30  # added to r^2: where r is smaller, d vanishes as well


class WendlandC0(NamedTuple):
    """phi_{3,0}; only its values and first derivatives exist."""

    k: int = 0


class WendlandC2(NamedTuple):
    """phi_{3,1}."""

    k: int = 1


class WendlandC4(NamedTuple):
    """phi_{3,2}."""

    k: int = 2


class WendlandC6(NamedTuple):
    """phi_{3,3}."""

    k: int = 3


PROFILES = (WendlandC0(), WendlandC2(), WendlandC4(), WendlandC6())  # by k


def unit(profile):
    """The factor u."""
    raise NotImplementedError


def parts(profile, t, inverse):
    """B, p, q, s, where `inverse` is 1 / r (formulas in t: they hold for r < 1)."""
    raise NotImplementedError


def third(profile, t, inverse):
    """f3; that of C2, which is unbounded at r = 0, is left out."""
    raise NotImplementedError


def _parts_c0(profile, t, inverse):
    return 1.0, 1.0, -2.0 * inverse, 0.0


def _parts_c2(profile, t, inverse):
    return t * t, 0.2 * t - 0.25, 1.0, -3.0 * inverse


def _parts_c4(profile, t, inverse):
    t2, r = t * t, 1.0 - t
    p = ((35.0 / 3.0) * r + 6.0) * r + 1.0
    return t2 * t2, p, (-280.0 / 3.0) * r - 56.0 / 3.0, 560.0


def _parts_c6(profile, t, inverse):
    t2, r = t * t, 1.0 - t
    p = ((32.0 * r + 25.0) * r + 8.0) * r + 1.0
    return t2 * t2 * t2, p, (-352.0 * r - 154.0) * r - 22.0, 3168.0 * r + 528.0


def _third_c2(profile, t, inverse):
    return 0.0


def _third_c4(profile, t, inverse):
    return -2240.0 * (t * t * t) * inverse


def _third_c6(profile, t, inverse):
    t2 = t * t
    return -22176.0 * (t2 * t2 * t)


_UNIT = {WendlandC2: lambda profile: -20.0}
_PARTS = {
    WendlandC0: _parts_c0,
    WendlandC2: _parts_c2,
    WendlandC4: _parts_c4,
    WendlandC6: _parts_c6,
}
_THIRD = {WendlandC2: _third_c2, WendlandC4: _third_c4, WendlandC6: _third_c6}


@overload(unit)
def _unit(profile):
    return _UNIT.get(profile.instance_class, lambda profile: 1.0)


@overload(parts)
def _parts(profile, t, inverse):
    return _PARTS[profile.instance_class]


@overload(third)
def _third(profile, t, inverse):
    return _THIRD[profile.instance_class]


@njit(**LEAN)
def wendland_value(profile, r):
    """phi: compiled, one number."""
    t = max(1.0 - r, 0.0)
    base, p, _, _ = parts(profile, t, 0.0)
    return unit(profile) * base * t * t * p


@njit(**LEAN)
def wendland_chain(profile, squared):
    """phi, f1, f2 at r = sqrt(squared): compiled; finite at r = 0, where d = 0 too."""
    inverse = 1.0 / sqrt(squared + TINY)
    t = max(1.0 - squared * inverse, 0.0)
    base, p, q, s = parts(profile, t, inverse)
    base *= unit(profile)
    return base * t * t * p, base * t * q, base * s
