"""Compiled second derivatives of a sum of kernels, from phi_{3,2} on (and of values for C2).

H = sum_j (a f1 + f2 b.d) I + f2 (b d^T + d b^T) + (a f2 + f3 b.d) d d^T
"""

from math import sqrt

import numpy as np
from numba import njit, prange

from rbf.cell_kernels import OUTSIDE, REACH
from rbf.evaluate_kernels import bounding_box, gather, list_near
from rbf.kernels import C2, C4

SUMS = {"cache": True, "error_model": "numpy", "fastmath": {"contract", "nsz", "reassoc"}}
OPTIONS = {"cache": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
TINY = 1e-60


@njit(inline="always", **SUMS)
def _factors(order, r, ri):
    """f1, f2, f3 of phi_{3,order}; f3 of C2 is left out, because it is unbounded."""
    t = max(1.0 - r, 0.0)
    t2 = t * t
    t4 = t2 * t2
    if order == C2:
        return t, -20.0 * t2 * t, 60.0 * t2 * ri, 0.0
    if order == C4:
        return t, (-56.0 / 3.0) * t4 * t * (5.0 * r + 1.0), 560.0 * t4, -2240.0 * t2 * t * ri
    f2 = 528.0 * t4 * t2 * (6.0 * r + 1.0)
    return t, -22.0 * t4 * t2 * t * ((16.0 * r + 7.0) * r + 1.0), f2, -22176.0 * t4 * t


@njit(**SUMS)
def _hessian(order, m, centres, px, py, pz, out):
    """Second derivatives (xx, yy, zz, xy, xz, yz) at one point; returns the support."""
    X, Y, Z, A = centres[0], centres[1], centres[2], centres[3]
    BX, BY, BZ = centres[4], centres[5], centres[6]
    xx = yy = zz = xy = xz = yz = near = 0.0
    for j in range(m):
        dx, dy, dz = px - X[j], py - Y[j], pz - Z[j]
        r2 = max(dx * dx + dy * dy + dz * dz, TINY)
        ri = 1.0 / sqrt(r2)
        t, f1, f2, f3 = _factors(order, r2 * ri, ri)
        nd = BX[j] * dx + BY[j] * dy + BZ[j] * dz
        diagonal = A[j] * f1 + f2 * nd
        outer = A[j] * f2 + f3 * nd
        xx += diagonal + (outer * dx + 2.0 * f2 * BX[j]) * dx
        yy += diagonal + (outer * dy + 2.0 * f2 * BY[j]) * dy
        zz += diagonal + (outer * dz + 2.0 * f2 * BZ[j]) * dz
        xy += outer * dx * dy + f2 * (BX[j] * dy + BY[j] * dx)
        xz += outer * dx * dz + f2 * (BX[j] * dz + BZ[j] * dx)
        yz += outer * dy * dz + f2 * (BY[j] * dz + BZ[j] * dy)
        near += t
    out[0, 0], out[1, 1], out[2, 2] = xx, yy, zz
    out[0, 1], out[1, 0] = xy, xy
    out[0, 2], out[2, 0] = xz, xz
    out[1, 2], out[2, 1] = yz, yz
    return near


@njit(parallel=True, **OPTIONS)
def hessians(points, order, keys, starts, centres, grid, kernel, results):
    """Second derivatives (n, 3, 3); parameters as in `evaluate_kernels.evaluate`."""
    for cell in prange(keys.size):
        first, last = starts[cell], starts[cell + 1]
        if keys[cell] == OUTSIDE:
            for q in range(first, last):
                results[order[q]] = np.nan
            continue
        box = np.empty((2, 3))
        bounding_box(points, order, first, last, box)
        chosen = list_near(keys[cell], np.int64(REACH), box, 1.0, grid)
        near = gather(chosen, box, centres)
        origin = 0.5 * (box[0] + box[1])
        for q in range(first, last):
            p = order[q]
            x = points[p] - origin
            if not _hessian(kernel, near.shape[1], near, x[0], x[1], x[2], results[p]) > 0.0:
                results[p] = np.nan
