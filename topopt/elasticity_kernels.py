"""Loops over tets that turn displacements into energies and stresses."""

from numba import njit, prange


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


@njit(cache=True, error_model="numpy")
def stress_forces(displacement, tets, gradients, lame_lambda, lame_mu, volumes, result):
    """result[i] += the forces at node i of the stress lambda tr(eps) + 2 mu eps on each tet.

    The tets count with the given volumes (m,).
    """
    for e in range(tets.shape[0]):
        xx, yy, zz, xy, yz, zx = _strain(displacement, tets, gradients, e)
        trace = lame_lambda * volumes[e] * (xx + yy + zz)
        twice = 2.0 * lame_mu * volumes[e]
        for a in range(4):
            node = tets[e, a]
            gx, gy, gz = gradients[e, a, 0], gradients[e, a, 1], gradients[e, a, 2]
            result[node, 0] += trace * gx + twice * (xx * gx + xy * gy + zx * gz)
            result[node, 1] += trace * gy + twice * (xy * gx + yy * gy + yz * gz)
            result[node, 2] += trace * gz + twice * (zx * gx + yz * gy + zz * gz)


@njit(cache=True, parallel=True, error_model="numpy")
def von_mises(displacement, tets, gradients, shear_modulus, result):
    """result[e] = sqrt(3/2 s : s), s the deviator 2 mu dev(eps), with mu = shear_modulus[e]."""
    for e in prange(tets.shape[0]):
        xx, yy, zz, xy, yz, zx = _strain(displacement, tets, gradients, e)
        mean = (xx + yy + zz) / 3.0
        xx, yy, zz = xx - mean, yy - mean, zz - mean
        square = xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + yz * yz + zx * zx)
        result[e] = 2.0 * shear_modulus[e] * (1.5 * square) ** 0.5
