"""How the stiffness depends on the phase field: C(phi) = C_mat [r + (1 - r) t(phi)], t = phi^3.

phi is P1, so t(phi) is a cubic on each tet and its mean there is known exactly. With the power
sums p_k = sum over the four corners of phi_i^k,

    mean(phi^3) = h3 / 20,   h3 = (p1^3 + 3 p1 p2 + 2 p3) / 6,

h3 being the complete homogeneous polynomial of degree 3 of the four corner values.
"""

import numpy as np

from topopt import interpolation_kernels as kernels


def mean_cube(phi, tets):
    """Return the mean (m,) of phi^3 on each tet, for nodal values phi (n,) and tets (m, 4)."""
    result = np.empty(len(tets))
    kernels.mean_cube(np.ascontiguousarray(phi, dtype=float), tets, result)
    return result


def stiffness_factor(phi, tets, void_ratio):
    """Return r + (1 - r) mean(phi^3) on each tet: (m,), 1 in material and r in void."""
    return void_ratio + (1.0 - void_ratio) * mean_cube(phi, tets)


def stiffness_slope(phi, direction, tets, void_ratio):
    """Derivative (m,) of `stiffness_factor` at phi (n,) along a direction (n,)."""
    forward, backward = mean_cube(phi + direction, tets), mean_cube(phi - direction, tets)
    return (1.0 - void_ratio) * (0.5 * (forward - backward) - mean_cube(direction, tets))


def mean_cube_pullback(phi, tets, weights):
    """Return sum over tets e of weights[e] * d mean(phi^3)_e / d phi_i at every node i: (n,).

    With weights (m,) = -(1 - r) volume w this is the elastic part of the gradient of the
    compliance.
    """
    result = np.zeros(len(phi))
    phi = np.ascontiguousarray(phi, dtype=float)
    kernels.mean_cube_pullback(phi, tets, np.ascontiguousarray(weights, dtype=float), result)
    return result
