"""How the stiffness depends on the phase field: C(phi) = C_mat [r + (1 - r) t(phi)], t = phi^3.

phi is P1, so t(phi) is a cubic on each tet and its mean there is known exactly. With the power
sums p_k = sum over the four corners of phi_i^k,

    mean(phi^3) = h3 / 20,   h3 = (p1^3 + 3 p1 p2 + 2 p3) / 6,

h3 being the complete homogeneous polynomial of degree 3 of the four corner values.
"""

import numpy as np

from topopt import interpolation_kernels as kernels
from topopt.geometry import NodeCorners, unsigned


def mean_cube(phi, tets):
    """Return the mean (m,) of phi^3 on each tet, for nodal values phi (n,) and tets (m, 4)."""
    result = np.empty(len(tets))
    kernels.mean_cube(np.ascontiguousarray(phi, dtype=float), unsigned(tets), result)
    return result


def stiffness_factor(phi, tets, void_ratio):
    """Return r + (1 - r) mean(phi^3) on each tet: (m,), 1 in material and r in void."""
    return void_ratio + (1.0 - void_ratio) * mean_cube(phi, tets)


def stiffness_slope(phi, direction, tets, void_ratio):
    """Derivative (m,) of `stiffness_factor` at phi (n,) along a direction (n,)."""
    none = np.zeros(0)
    return (1.0 - void_ratio) * _slopes(phi, direction, tets, none, none)[0]


def mean_cube_pullback(phi, tets, weights, corners=None):
    """Return sum over tets e of weights[e] * d mean(phi^3)_e / d phi_i at every node i: (n,).

    With weights (m,) = -(1 - r) volume w this is the elastic part of the gradient of the
    compliance. `corners` are the mesh's NodeCorners, if they are at hand.
    """
    return mean_cube_bend(phi, np.zeros(len(phi)), tets, np.zeros(len(tets)), weights, corners)


def mean_cube_bend(phi, direction, tets, still, moving, corners=None):
    """How the pullback of weights changes with phi along a direction, and that of more weights.

    sum over tets e of still[e] * d^2 mean(phi^3)_e / d phi_i d phi_j direction_j, summed over j,
    + moving[e] * d mean(phi^3)_e / d phi_i at every node i: (n,).

    Parameters
    ----------
    phi, direction : (n,) float arrays
    tets : (m, 4) int array
    still, moving : (m,) float arrays
    corners : NodeCorners, optional
    """
    corners = NodeCorners(tets, len(phi)) if corners is None else corners
    return corners.sums(_slopes(phi, direction, tets, still, moving)[1])


def _slopes(phi, direction, tets, still, moving):
    """Slope (m,) and local (m, 4) of the kernel `mean_cube_slope`; no local without weights."""
    slope, local = np.empty(len(tets)), np.empty((len(still), 4))
    fields = (np.ascontiguousarray(values, dtype=float) for values in (phi, direction))
    weights = (np.ascontiguousarray(values, dtype=float) for values in (still, moving))
    kernels.mean_cube_slope(*fields, unsigned(tets), *weights, slope, local)
    return slope, local
