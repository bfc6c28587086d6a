"""The innermost loops: value and gradient of one sum of kernels at one point.

    S = sum_j a_j phi(r_j) + f1(r_j) b_j.d_j,      d_j = x - x_j in units of the support radius
    grad S = sum_j (a_j f1 + f2 b_j.d_j) d_j + f1 b_j

Eight centres at a time run through the vector registers. They should begin at a cache line (see
`line_start`): loads that straddle two lines cost a third of the speed.
"""

from typing import NamedTuple

from numba import njit
from numba.extending import overload

from rbf.lanes import inverse_root, load, positive, spread, total
from rbf.profiles import OPTIONS, PROFILES, TINY, parts, unit


class HermiteSum(NamedTuple):
    """Centres with a and b: rows x, y, z, a, b_x, b_y, b_z."""

    profile: NamedTuple


class ValueSum(NamedTuple):
    """Centres with a alone: rows x, y, z, a."""

    profile: NamedTuple


class ValueOnly(NamedTuple):
    """As ValueSum, for its value alone; the gradient is 0."""

    profile: NamedTuple


ROWS = {HermiteSum: 7, ValueSum: 4, ValueOnly: 4}


def sum_form(order, hermite):
    """The form of a sum with Wendland's phi_{3,order}, whose type the compiled loops go by."""
    return (HermiteSum if hermite else ValueSum)(PROFILES[order])


def add_centres(form, near, j, x, y, z, sums):
    """Sums of v, g_x, g_y, g_z and t with centres j to j + 7 added, at (x, y, z)."""
    raise NotImplementedError


def _add_hermite(form, near, j, x, y, z, sums):
    v, gx, gy, gz, support = sums
    dx, dy, dz = x - load(near, 0, j), y - load(near, 1, j), z - load(near, 2, j)
    squared = dx * dx + (dy * dy + (dz * dz + TINY))
    inverse = inverse_root(squared)
    t = positive(1.0 - squared * inverse)
    base, p, q, s = parts(form.profile, t, inverse)
    bx, by, bz = load(near, 4, j), load(near, 5, j), load(near, 6, j)
    slope = bx * dx + (by * dy + bz * dz)
    at, bt = load(near, 3, j) * t, base * t
    v = v + bt * (at * p + slope * q)
    w = base * (at * q + slope * s)
    f = bt * q
    gx = (gx + w * dx) + f * bx
    gy = (gy + w * dy) + f * by
    gz = (gz + w * dz) + f * bz
    return v, gx, gy, gz, support + t


def _add_values(form, near, j, x, y, z, sums):
    v, gx, gy, gz, support = sums
    dx, dy, dz = x - load(near, 0, j), y - load(near, 1, j), z - load(near, 2, j)
    squared = dx * dx + (dy * dy + (dz * dz + TINY))
    inverse = inverse_root(squared)
    t = positive(1.0 - squared * inverse)
    base, p, q, _ = parts(form.profile, t, inverse)
    at = base * (load(near, 3, j) * t)
    v = v + at * (t * p)
    w = at * q
    return v, gx + w * dx, gy + w * dy, gz + w * dz, support + t


def _add_only_values(form, near, j, x, y, z, sums):
    v, gx, gy, gz, support = sums
    dx, dy, dz = x - load(near, 0, j), y - load(near, 1, j), z - load(near, 2, j)
    squared = dx * dx + (dy * dy + (dz * dz + TINY))
    inverse = inverse_root(squared)
    t = positive(1.0 - squared * inverse)
    base, p, _, _ = parts(form.profile, t, inverse)
    v = v + (base * (load(near, 3, j) * t)) * (t * p)
    return v, gx, gy, gz, support + t


_ADD = {HermiteSum: _add_hermite, ValueSum: _add_values, ValueOnly: _add_only_values}


@overload(add_centres)
def _add_centres(form, near, j, x, y, z, sums):
    return _ADD[form.instance_class]


@njit(**OPTIONS)
def value_and_gradient(form, near, begin, end, x, y, z):
    """S and its gradient at one point.

    Parameters
    ----------
    form : HermiteSum or ValueSum
    near : (7 or 4, m) float array
        See the form.
    begin, end : int
        The columns of the centres, a multiple of 8 of them.
    x, y, z : float

    Returns
    -------
    value, g_x, g_y, g_z, support : float
        The support, the sum of max(1 - r, 0), is positive if any centre is within reach.
    """
    zero = spread(0.0)
    sums = zero, zero, zero, zero, zero
    for j in range(begin, end, 8):
        sums = add_centres(form, near, j, x, y, z, sums)
    v, gx, gy, gz, support = sums
    u = unit(form.profile)
    return u * total(v), u * total(gx), u * total(gy), u * total(gz), total(support)


@njit(**OPTIONS)
def line_start(near):
    """The first column of an array at which a cache line begins (its rows a multiple of 8)."""
    return -(near.ctypes.data // 8) % 8
