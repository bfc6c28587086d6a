"""The innermost loops: value and gradient of one sum of kernels at one point.

    S = sum_j a_j phi(r_j) + f1(r_j) b_j.d_j,      d_j = x - x_j in units of the support radius
    grad S = sum_j (a_j f1 + f2 b_j.d_j) d_j + f1 b_j

All loops are free of branches, so that they run in vector registers; sums may be reassociated
(always in the same way, in one build), NaN stays NaN. `near` returns the sum of max(1 - r, 0): it
is positive exactly if some centre lies within the support.
"""

from math import sqrt

from numba import njit

from rbf.kernels import C0, C2, C4

OPTIONS = {
    "cache": True,
    "error_model": "numpy",
    "fastmath": {"contract", "nsz", "reassoc"},
}
TINY = 1e-60  # guards 1 / r: where r is smaller, d vanishes as well


@njit(**OPTIONS)
def _hermite_c2(m, centres, px, py, pz):
    X, Y, Z, A = centres[0], centres[1], centres[2], centres[3]
    BX, BY, BZ = centres[4], centres[5], centres[6]
    v = gx = gy = gz = near = 0.0  # v and g as shares of f1 / t^3 = -20
    for j in range(m):
        dx, dy, dz = px - X[j], py - Y[j], pz - Z[j]
        r = sqrt(dx * dx + dy * dy + (dz * dz + TINY))
        t = max(1.0 - r, 0.0)
        t2 = t * t
        t3 = t2 * t
        at = A[j] * t
        nd = BX[j] * dx + BY[j] * dy + BZ[j] * dz
        v += t3 * (nd - at * (0.2 * r + 0.05))
        w = t2 * (at - 3.0 * (nd / r))
        gx += w * dx + t3 * BX[j]
        gy += w * dy + t3 * BY[j]
        gz += w * dz + t3 * BZ[j]
        near += t
    return -20.0 * v, -20.0 * gx, -20.0 * gy, -20.0 * gz, near


@njit(**OPTIONS)
def _hermite_c4(m, centres, px, py, pz):
    X, Y, Z, A = centres[0], centres[1], centres[2], centres[3]
    BX, BY, BZ = centres[4], centres[5], centres[6]
    v = gx = gy = gz = near = 0.0
    for j in range(m):
        dx, dy, dz = px - X[j], py - Y[j], pz - Z[j]
        r = sqrt(dx * dx + dy * dy + dz * dz)
        t = max(1.0 - r, 0.0)
        t2 = t * t
        t4 = t2 * t2
        f1 = (-56.0 / 3.0) * t4 * t * (5.0 * r + 1.0)
        nd = BX[j] * dx + BY[j] * dy + BZ[j] * dz
        v += A[j] * t4 * t2 * ((35.0 * r + 18.0) * r + 3.0) * (1.0 / 3.0) + f1 * nd
        w = A[j] * f1 + 560.0 * t4 * nd
        gx += w * dx + f1 * BX[j]
        gy += w * dy + f1 * BY[j]
        gz += w * dz + f1 * BZ[j]
        near += t
    return v, gx, gy, gz, near


@njit(**OPTIONS)
def _hermite_c6(m, centres, px, py, pz):
    X, Y, Z, A = centres[0], centres[1], centres[2], centres[3]
    BX, BY, BZ = centres[4], centres[5], centres[6]
    v = gx = gy = gz = near = 0.0
    for j in range(m):
        dx, dy, dz = px - X[j], py - Y[j], pz - Z[j]
        r = sqrt(dx * dx + dy * dy + dz * dz)
        t = max(1.0 - r, 0.0)
        t2 = t * t
        t6 = t2 * t2 * t2
        f1 = -22.0 * t6 * t * ((16.0 * r + 7.0) * r + 1.0)
        nd = BX[j] * dx + BY[j] * dy + BZ[j] * dz
        v += A[j] * t6 * t2 * (((32.0 * r + 25.0) * r + 8.0) * r + 1.0) + f1 * nd
        w = A[j] * f1 + 528.0 * t6 * (6.0 * r + 1.0) * nd
        gx += w * dx + f1 * BX[j]
        gy += w * dy + f1 * BY[j]
        gz += w * dz + f1 * BZ[j]
        near += t
    return v, gx, gy, gz, near


@njit(**OPTIONS)
def _values_c0(m, centres, px, py, pz):
    X, Y, Z, A = centres[0], centres[1], centres[2], centres[3]
    v = gx = gy = gz = near = 0.0
    for j in range(m):
        dx, dy, dz = px - X[j], py - Y[j], pz - Z[j]
        r2 = max(dx * dx + dy * dy + dz * dz, TINY)
        ri = 1.0 / sqrt(r2)
        t = max(1.0 - r2 * ri, 0.0)
        v += A[j] * t * t
        w = -2.0 * A[j] * t * ri
        gx += w * dx
        gy += w * dy
        gz += w * dz
        near += t
    return v, gx, gy, gz, near


@njit(**OPTIONS)
def _values_c2(m, centres, px, py, pz):
    X, Y, Z, A = centres[0], centres[1], centres[2], centres[3]
    v = gx = gy = gz = near = 0.0
    for j in range(m):
        dx, dy, dz = px - X[j], py - Y[j], pz - Z[j]
        r = sqrt(dx * dx + dy * dy + dz * dz)
        t = max(1.0 - r, 0.0)
        at3 = A[j] * t * t * t
        v += at3 * t * (4.0 * r + 1.0)
        w = -20.0 * at3
        gx += w * dx
        gy += w * dy
        gz += w * dz
        near += t
    return v, gx, gy, gz, near


@njit(**OPTIONS)
def value_and_gradient(order, hermite, m, centres, px, py, pz):
    """S and its gradient at one point.

    Parameters
    ----------
    order : int
        k of Wendland's phi_{3,k}.
    hermite : bool
        Whether the centres carry b.
    m : int
        Number of centres.
    centres : (7, m or more) float array
        x, y, z, a, b_x, b_y, b_z of each centre.
    px, py, pz : float

    Returns
    -------
    value, gx, gy, gz, near : float
    """
    if order == C2:
        if hermite:
            return _hermite_c2(m, centres, px, py, pz)
        return _values_c2(m, centres, px, py, pz)
    if order == C4:
        return _hermite_c4(m, centres, px, py, pz)
    if order == C0:
        return _values_c0(m, centres, px, py, pz)
    return _hermite_c6(m, centres, px, py, pz)
