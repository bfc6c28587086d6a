"""Compiled second derivatives of a sum of kernels, from phi_{3,2} on (and of values for C2).

H = sum_j (a f1 + f2 b.d) I + f2 (b d^T + d b^T) + (a f2 + f3 b.d) d d^T
"""

import numpy as np
from numba import njit

from rbf.cell_kernels import MAX_RUNS, OUTSIDE, REACH, neighbour_runs
from rbf.evaluate_kernels import bounds, gather, room
from rbf.lanes import load, spread, total
from rbf.profiles import LEAN, OPTIONS, parts, third, unit
from rbf.sum_kernels import begin_centres, continue_centres


@njit(**LEAN)
def _hessian(profile, near, begin, end, px, py, pz, out):
    """Second derivatives (3, 3) at one point, from rows x, y, z, a, b; returns the support."""
    xx = yy = zz = xy = xz = yz = support = spread(0.0)
    for j in range(begin, end, 8):
        dx, dy, dz, t, inverse = continue_centres(begin_centres(near, j, px, py, pz))
        base, _, q, s = parts(profile, t, inverse)
        f1, f2, f3 = base * (t * q), base * s, third(profile, t, inverse)
        a, bx, by, bz = load(near, 3, j), load(near, 4, j), load(near, 5, j), load(near, 6, j)
        slope = bx * dx + (by * dy + bz * dz)
        diagonal = a * f1 + f2 * slope
        outer = a * f2 + slope * f3
        xx = xx + (diagonal + (outer * dx + 2.0 * (f2 * bx)) * dx)
        yy = yy + (diagonal + (outer * dy + 2.0 * (f2 * by)) * dy)
        zz = zz + (diagonal + (outer * dz + 2.0 * (f2 * bz)) * dz)
        xy = xy + (outer * (dx * dy) + f2 * (bx * dy + by * dx))
        xz = xz + (outer * (dx * dz) + f2 * (bx * dz + bz * dx))
        yz = yz + (outer * (dy * dz) + f2 * (by * dz + bz * dy))
        support = support + t
    u = unit(profile)
    out[0, 0], out[1, 1], out[2, 2] = u * total(xx), u * total(yy), u * total(zz)
    out[0, 1] = out[1, 0] = u * total(xy)
    out[0, 2] = out[2, 0] = u * total(xz)
    out[1, 2] = out[2, 1] = u * total(yz)
    return total(support)


@njit(**OPTIONS)
def hessians(first_cell, last_cell, profile, points, order, keys, starts, centres, grid, results):
    """Second derivatives (n, 3, 3); parameters as in `evaluate_kernels.evaluate`.

    `profile` is that of the form. Centres of values alone have rows of zeros for b.
    """
    found, box = np.empty((MAX_RUNS, 2), np.int64), np.empty((2, 3))
    near, around = np.empty((centres.shape[0], 512)), np.full((MAX_RUNS + 1, 2), -1)
    for cell in range(first_cell, last_cell):
        first, last = starts[cell], starts[cell + 1]
        if keys[cell] == OUTSIDE:
            for place in range(first, last):
                results[order[place]] = np.nan
            continue
        runs = found[: neighbour_runs(keys[cell], REACH, grid, around, found)]
        bounds(points, order, first, last, box)
        near = room(runs, near)
        begin, end = gather(runs, box, 1.0, centres, near)
        for place in range(first, last):
            p = order[place]
            x, y, z = points[p, 0], points[p, 1], points[p, 2]
            if not _hessian(profile, near, begin, end, x, y, z, results[p]) > 0.0:
                results[p] = np.nan
