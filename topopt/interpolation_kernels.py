"""Loops over tets for the material interpolation t(phi) = phi^3."""

from numba import njit, prange


@njit(cache=True, parallel=True, error_model="numpy")
def mean_cube(phi, tets, result):
    """result[e] = mean of phi^3 on tet e, exact for P1 phi."""
    for e in prange(tets.shape[0]):
        p1 = p2 = p3 = 0.0
        for a in range(4):
            value = phi[tets[e, a]]
            p1 += value
            p2 += value * value
            p3 += value * value * value
        result[e] = (p1 * p1 * p1 + 3.0 * p1 * p2 + 2.0 * p3) / 120.0


@njit(cache=True, error_model="numpy")
def mean_cube_pullback(phi, tets, weights, result):
    """result[i] += sum over tets e of weights[e] * d mean(phi^3)_e / d phi_i."""
    for e in range(tets.shape[0]):
        p1 = p2 = 0.0
        for a in range(4):
            value = phi[tets[e, a]]
            p1 += value
            p2 += value * value
        common = 3.0 * (p1 * p1 + p2)
        for a in range(4):
            value = phi[tets[e, a]]
            slope = common + 6.0 * value * (p1 + value)
            result[tets[e, a]] += weights[e] * slope / 120.0
