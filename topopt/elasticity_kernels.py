"""Loops over tets that turn displacements into energies and stresses.

Indices are unsigned (`topopt.geometry.unsigned`).
"""

import numpy as np
from numba import njit, prange

TWO, THREE = np.uint32(2), np.uint32(3)


@njit(cache=True, forceinline=True, error_model="numpy")
def _strain(displacement, tets, gradients, e):
    """The six components xx, yy, zz, xy, yz, zx of the symmetric gradient on tet e."""
    xx = yy = zz = xy = yz = zx = 0.0
    for a in range(4):
        node = tets[e, a]
        u, v, w = displacement[node, 0], displacement[node, 1], displacement[node, 2]
        gx, gy, gz = gradients[e, a, 0], gradients[e, a, 1], gradients[e, a, 2]
        xx += u * gx
        yy += v * gy
        zz += w * gz
        xy += 0.5 * (u * gy + v * gx)
        yz += 0.5 * (v * gz + w * gy)
        zx += 0.5 * (w * gx + u * gz)
    return xx, yy, zz, xy, yz, zx


@njit(cache=True, parallel=True, error_model="numpy")
def energy_density(displacement, tets, gradients, lame_lambda, lame_mu, result):
    """result[e] = lambda tr(eps)^2 + 2 mu eps : eps."""
    for e in prange(tets.shape[0]):
        xx, yy, zz, xy, yz, zx = _strain(displacement, tets, gradients, e)
        trace = xx + yy + zz
        square = xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + yz * yz + zx * zx)
        result[e] = lame_lambda * trace * trace + 2.0 * lame_mu * square


@njit(cache=True, parallel=True, error_model="numpy")
def stresses(displacement, tets, gradients, lame_lambda, lame_mu, result):
    """result[e] = lambda tr(eps) + 2 mu eps, as xx, yy, zz, xy, yz, zx (m, 6)."""
    for e in prange(tets.shape[0]):
        xx, yy, zz, xy, yz, zx = _strain(displacement, tets, gradients, e)
        trace, twice = lame_lambda * (xx + yy + zz), 2.0 * lame_mu
        result[e, 0], result[e, 1], result[e, 2] = (
            trace + twice * xx,
            trace + twice * yy,
            trace + twice * zz,
        )
        result[e, 3], result[e, 4], result[e, 5] = twice * xy, twice * yz, twice * zx


@njit(cache=True, parallel=True, error_model="numpy")
def stress_work(stress, displacement, tets, gradients, result):
    """result[e] = the stress (m, 6) on tet e times the strain there."""
    for e in prange(tets.shape[0]):
        xx, yy, zz, xy, yz, zx = _strain(displacement, tets, gradients, e)
        normal = stress[e, 0] * xx + stress[e, 1] * yy + stress[e, 2] * zz
        result[e] = normal + 2.0 * (stress[e, 3] * xy + stress[e, 4] * yz + stress[e, 5] * zx)


@njit(cache=True, parallel=True, error_model="numpy")
def stress_forces(start, corners, gradients, weights, stress, result):
    """result[i] = the forces at node i of weights[e] times the stresses (m, 6) on the tets around.

    corners[start[i]:start[i + 1]] = 4 e + a: node i is corner a of tet e.
    """
    for i in prange(result.shape[0]):
        x = y = z = 0.0
        for k in range(start[i], start[i + 1]):
            e, a = corners[k] >> TWO, corners[k] & THREE
            w = weights[e]
            gx, gy, gz = w * gradients[e, a, 0], w * gradients[e, a, 1], w * gradients[e, a, 2]
            x += stress[e, 0] * gx + stress[e, 3] * gy + stress[e, 5] * gz
            y += stress[e, 3] * gx + stress[e, 1] * gy + stress[e, 4] * gz
            z += stress[e, 5] * gx + stress[e, 4] * gy + stress[e, 2] * gz
        result[i, 0], result[i, 1], result[i, 2] = x, y, z


@njit(cache=True, parallel=True, error_model="numpy")
def von_mises(displacement, tets, gradients, shear_modulus, result):
    """result[e] = sqrt(3/2 s : s), s the deviator 2 mu dev(eps), with mu = shear_modulus[e]."""
    for e in prange(tets.shape[0]):
        xx, yy, zz, xy, yz, zx = _strain(displacement, tets, gradients, e)
        mean = (xx + yy + zz) / 3.0
        xx, yy, zz = xx - mean, yy - mean, zz - mean
        square = xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + yz * yz + zx * zx)
        result[e] = 2.0 * shear_modulus[e] * (1.5 * square) ** 0.5
