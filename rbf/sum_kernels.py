"""The innermost loops: value and gradient of one sum of kernels at one point.

    S = sum_j a_j phi(r_j) + f1(r_j) b_j.d_j,      d_j = x - x_j in units of the support radius
    grad S = sum_j (a_j f1 + f2 b_j.d_j) d_j + f1 b_j

Eight centres at a time run through the vector registers. They should begin at a cache line (see
`line_start`): loads that straddle two lines cost a third of the speed. Each operation
waits for the one before; so three groups of eight are under way at a time: the sums over one, the
distances of the next, the estimates of those of the one after. That saves a sixth of the time.
"""

from typing import NamedTuple

from numba import njit
from numba.extending import overload

from rbf.lanes import below, improved_root, load, positive, root_estimate, spread, total
from rbf.profiles import LEAN, PROFILES, TINY, parts, unit


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


@njit(**LEAN)
def begin_centres(near, j, x, y, z):
    """Centres j to j + 7 seen from (x, y, z): d, r^2 and the estimate of 1 / r."""
    dx, dy, dz = x - load(near, 0, j), y - load(near, 1, j), z - load(near, 2, j)
    squared = dx * dx + (dy * dy + (dz * dz + TINY))
    return dx, dy, dz, squared, root_estimate(squared)


@njit(**LEAN)
def continue_centres(begun):
    """d, t = max(1 - r, 0) and 1 / r of centres from `begin_centres`."""
    dx, dy, dz, squared, estimate = begun
    inverse = improved_root(squared, estimate)
    return dx, dy, dz, positive(1.0 - squared * inverse), inverse


def add_centres(form, near, j, seen, sums):
    """Sums of v, g_x, g_y and g_z with centres j to j + 7 added."""
    raise NotImplementedError


def _add_hermite(form, near, j, seen, sums):
    v, gx, gy, gz = sums
    dx, dy, dz, t, inverse = seen
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
    return v, gx, gy, gz


def _add_values(form, near, j, seen, sums):
    v, gx, gy, gz = sums
    dx, dy, dz, t, inverse = seen
    base, p, q, _ = parts(form.profile, t, inverse)
    at = base * (load(near, 3, j) * t)
    v = v + at * (t * p)
    w = at * q
    return v, gx + w * dx, gy + w * dy, gz + w * dz


def _add_only_values(form, near, j, seen, sums):
    v, gx, gy, gz = sums
    _, _, _, t, inverse = seen
    base, p, _, _ = parts(form.profile, t, inverse)
    v = v + (base * (load(near, 3, j) * t)) * (t * p)
    return v, gx, gy, gz


_ADD = {HermiteSum: _add_hermite, ValueSum: _add_values, ValueOnly: _add_only_values}


@overload(add_centres)
def _add_centres(form, near, j, seen, sums):
    return _ADD[form.instance_class]


@njit(**LEAN)
def value_and_gradient(form, near, begin, end, x, y, z):
    """S and its gradient at one point.

    Parameters
    ----------
    form : HermiteSum, ValueSum or ValueOnly
    near : (7 or 4, m) float array
        See the form; m >= end + 16.
    begin, end : int
        The columns of the centres, a multiple of 8 of them.
    x, y, z : float

    Returns
    -------
    value, g_x, g_y, g_z : float
    supported : bool
        Whether any centre is within reach.
    """
    zero = spread(0.0)
    sums = zero, zero, zero, zero
    following = continue_centres(begin_centres(near, begin, x, y, z))
    ahead = begin_centres(near, begin + 8, x, y, z)
    for j in range(begin, end, 8):
        seen = following
        following = continue_centres(ahead)
        ahead = begin_centres(near, j + 16, x, y, z)
        sums = add_centres(form, near, j, seen, sums)
    u = unit(form.profile)
    v, gx, gy, gz = u * total(sums[0]), u * total(sums[1]), u * total(sums[2]), u * total(sums[3])
    nothing = v == 0.0 and gx == 0.0 and gy == 0.0 and gz == 0.0
    return v, gx, gy, gz, not nothing or reaches(near, begin, end, x, y, z)


@njit(**LEAN)
def reaches(near, begin, end, x, y, z):
    """Whether any centre of some columns is nearer to a point than the support."""
    for j in range(begin, end, 8):
        _, _, _, squared, _ = begin_centres(near, j, x, y, z)
        if below(squared, 1.0):
            return True
    return False


@njit(**LEAN)
def line_start(near):
    """The first column of an array at which a cache line begins (its rows a multiple of 8)."""
    return -(near.ctypes.data // 8) % 8
