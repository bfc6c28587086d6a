"""The Ginzburg-Landau energy of a phase field: what an interface costs.

E(phi) = int eps/2 |grad phi|^2 + Psi(phi)/eps, discretised with P1 functions: the gradient term
with the stiffness matrix A, the potential with the lumped mass M (the same M that measures the
volume and the step), so that the gradient below is the exact one of the energy below.

Symbols: phi nodal values, eps interface parameter [m], Psi potential.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from topopt.geometry import tet_geometry


@dataclass(frozen=True)
class Potential:
    """A potential with minima at 0 and 1.

    Parameters
    ----------
    value, derivative : functions of phi (n,)
        Psi and Psi'.
    energy_constant : float
        int_0^1 sqrt(2 Psi): the energy of an equilibrium interface per unit area.
    """

    value: Callable[[np.ndarray], np.ndarray]
    derivative: Callable[[np.ndarray], np.ndarray]
    energy_constant: float


POTENTIALS = {
    # phi (1 - phi) within [0, 1]; the box itself is left to the optimiser
    "obstacle": Potential(
        lambda phi: phi * (1.0 - phi), lambda phi: 1.0 - 2.0 * phi, np.sqrt(2.0) * np.pi / 8.0
    ),
    # smooth: for energies and analysis only, its minimisers never reach 0 or 1
    "double_well": Potential(
        lambda phi: 0.25 * (phi * (1.0 - phi)) ** 2,
        lambda phi: 0.5 * phi * (1.0 - phi) * (1.0 - 2.0 * phi),
        1.0 / (6.0 * np.sqrt(2.0)),
    ),
}


def interface_width(eps):
    """Width [m] of the obstacle potential's unloaded interface, from 0 to 1: pi eps / sqrt(2)."""
    return np.pi * eps / np.sqrt(2.0)


class GinzburgLandau:
    """The energy on one mesh.

    Parameters
    ----------
    mesh : TetMesh
    eps : float [m]
    potential : str
        A key of `POTENTIALS`: "obstacle" or "double_well".
    geometry : TetGeometry, optional
        That of the mesh, if it is at hand.

    Attributes
    ----------
    mass : (n,) float array [m^3]
        Lumped mass.
    stiffness : (n, n) CSR matrix [m]

    Notes
    -----
    Thesis section 2.2.2.
    """

    def __init__(self, mesh, eps, potential="obstacle", geometry=None):
        geometry = tet_geometry(mesh) if geometry is None else geometry
        self.eps = float(eps)
        self.potential = POTENTIALS[potential]
        self.mass = geometry.lumped_mass
        self.stiffness = geometry.stiffness

    def energy(self, phi):
        """E(phi) [m^2] of nodal values (n,)."""
        bending = 0.5 * self.eps * (phi @ (self.stiffness @ phi))
        return float(bending + self.mass @ self.potential.value(phi) / self.eps)

    def gradient(self, phi):
        """Nodal derivatives (n,) [m^2] of E at phi (n,)."""
        potential = self.mass * self.potential.derivative(phi) / self.eps
        return self.eps * (self.stiffness @ phi) + potential
