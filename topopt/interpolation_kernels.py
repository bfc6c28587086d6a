"""Loops over tets for the material interpolation t(phi) = phi^3.

With the power sums p_k of a tet's corner values, mean(phi^3) = h3 / 20, and its derivative by
corner a is s_a / 120, s_a = 3 (p1^2 + p2) + 6 phi_a (p1 + phi_a).
"""

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


@njit(cache=True, parallel=True, error_model="numpy")
def mean_cube_slope(phi, direction, tets, still, moving, slope, local):
    """slope[e] = sum_a s_a d_a / 120, how mean(phi^3) changes on tet e along the direction d.

    local[e, a] = (still[e] s'_a + moving[e] s_a) / 120 with s'_a the change of s_a along d; left
    out if it is empty.
    """
    slope_only = local.shape[0] == 0
    for e in prange(tets.shape[0]):
        p1 = p2 = d1 = d2 = 0.0
        for a in range(4):
            value, change = phi[tets[e, a]], direction[tets[e, a]]
            p1 += value
            p2 += value * value
            d1 += change
            d2 += value * change
        along = 0.0
        for a in range(4):
            value, change = phi[tets[e, a]], direction[tets[e, a]]
            here = 3.0 * (p1 * p1 + p2) + 6.0 * value * (p1 + value)
            along += here * change
            if not slope_only:
                bend = 6.0 * (p1 * d1 + d2 + change * (p1 + value) + value * (d1 + change))
                local[e, a] = (still[e] * bend + moving[e] * here) / 120.0
        slope[e] = along / 120.0
