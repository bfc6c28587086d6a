"""A topology optimisation problem in words: material, regions, supports, loads.

All quantities are SI: metres, pascals, kilograms.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from meshes.patch import SymmetryPlane
from meshes.tri_mesh import TriMesh

GRAVITY = (0.0, 0.0, -9.81)  # m/s^2; the thesis has +z


@dataclass(frozen=True)
class Material:
    """Isotropic linear elasticity and the mass density.

    Parameters
    ----------
    lame_lambda, lame_mu : float [Pa]
        The thesis's values: E = 1.850 GPa, nu = 0.350.
    density : float [kg/m^3]
        PLA unless said otherwise.
    void_ratio : float
        r = C_void / C_mat.
    """

    lame_lambda: float = 1599e6
    lame_mu: float = 685e6
    density: float = 1240.0
    void_ratio: float = 1e-4


@dataclass(frozen=True)
class Box:
    """The closed axis-parallel box [lower, upper] [m]; infinite bounds are allowed."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


@dataclass(frozen=True)
class Support:
    """Nodes on the domain's boundary within `region` are held in the directions `fixed`."""

    name: str
    region: Box
    fixed: tuple[int, ...] = (0, 1, 2)


@dataclass(frozen=True)
class Load:
    """A constant traction (3,) [Pa] on the part of the boundary inside `region`."""

    name: str
    region: Box
    traction: tuple[float, float, float]


@dataclass(frozen=True)
class BoxDomain:
    """The design domain [lower, upper] [m]."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


@dataclass(frozen=True)
class SurfaceDomain:
    """The design domain inside a closed surface [m]."""

    surface: TriMesh


@dataclass(frozen=True)
class Problem:
    """Minimise compliance + gamma * Ginzburg-Landau energy at a given volume.

    Parameters
    ----------
    domain : BoxDomain or SurfaceDomain
    supports, loads : tuples of Support and Load
    volume_fraction : float
        m, the share of the modelled domain that is material.
    gamma : float [J/m^2] or None
        Weight of the interface energy; None chooses it from the elastic energy density.
    eps : float [m] or None
        Interface parameter; the interface is pi eps / sqrt(2) wide. None takes it from the mesh.
    material : Material
    symmetry : tuple of SymmetryPlane
        On each plane the normal displacement is zero.
    gravity : (3,) [m/s^2]
        Acceleration of the body force phi rho G; zero switches it off.
    """

    domain: BoxDomain | SurfaceDomain
    supports: tuple[Support, ...]
    loads: tuple[Load, ...]
    volume_fraction: float
    gamma: float | None = None
    eps: float | None = None
    material: Material = field(default_factory=Material)
    symmetry: tuple[SymmetryPlane, ...] = ()
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class BoundaryConditions:
    """A problem's supports and loads on one mesh.

    Parameters
    ----------
    fixed : (n, 3) bool array
        Degrees of freedom that are held at zero (supports and symmetry planes).
    forces : (n, 3) float array [N]
        Consistent nodal forces of the tractions (gravity not included).
    load_forces : mapping of str to (n, 3) float array [N]
        The same, load by load.
    """

    fixed: np.ndarray
    forces: np.ndarray
    load_forces: Mapping[str, np.ndarray]
