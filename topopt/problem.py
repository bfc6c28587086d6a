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
class Slab:
    """All points within half a thickness of the plane through `point` with normal `normal`.

    Parameters
    ----------
    point : (3,) [m]
    normal : (3,)
        Of any length but zero.
    thickness : float [m]
        0: the plane itself.
    """

    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    thickness: float = 0.0


@dataclass(frozen=True)
class Sphere:
    """The closed ball around `center` [m] with `radius` [m]."""

    center: tuple[float, float, float]
    radius: float


@dataclass(frozen=True)
class Cylinder:
    """The closed circular cylinder with the axis from `start` to `end` [m] and `radius` [m]."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


@dataclass(frozen=True, eq=False)
class SurfaceRegion:
    """The inside of a closed surface [m], its outside moved out by `margin` [m].

    `name` is what messages call it.
    """

    surface: TriMesh
    margin: float = 0.0
    name: str = "a surface"


Region = Box | Slab | Sphere | Cylinder | SurfaceRegion


@dataclass(frozen=True)
class Support:
    """How the part of the domain's boundary within a region is held.

    Parameters
    ----------
    name : str
    region : Region
    fixed : tuple of int
        The directions (0, 1, 2 for x, y, z) that are held.
    displacement : (3,) [m]
        Where the held directions are moved to, in the load cases that name the support.
    stiffness : float or None [N/m^3]
        None holds the nodes inside the region rigidly; a number holds the area inside it by
        springs: the traction is minus the stiffness times the displacement.
    """

    name: str
    region: Region
    fixed: tuple[int, ...] = (0, 1, 2)
    displacement: tuple[float, float, float] = (0.0, 0.0, 0.0)
    stiffness: float | None = None


@dataclass(frozen=True)
class Load:
    """A constant traction (3,) [Pa] on the part of the boundary inside `region`."""

    name: str
    region: Region
    traction: tuple[float, float, float]


@dataclass(frozen=True)
class LoadCase:
    """What acts at the same time, and how much it counts.

    Parameters
    ----------
    name : str
    loads : tuple of str
        Names of the loads that act.
    weight : float
        Of this case's compliance in the objective; positive.
    gravity : bool
        Whether the problem's gravity acts.
    displacements : tuple of str
        Names of the supports whose displacement is imposed; the others stay at zero.
    """

    name: str
    loads: tuple[str, ...] = ()
    weight: float = 1.0
    gravity: bool = True
    displacements: tuple[str, ...] = ()


@dataclass(frozen=True)
class Passive:
    """Nodes within `region` keep phi = 1 (`solid`) or phi = 0 (else)."""

    name: str
    region: Region
    solid: bool


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
    """Minimise the weighted compliances + gamma * Ginzburg-Landau energy at a given volume.

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
    load_cases : tuple of LoadCase
        None: everything acts at once, with weight 1.
    passive : tuple of Passive
        Their volume counts: `volume_fraction` is that of the whole domain.
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
    load_cases: tuple[LoadCase, ...] = ()
    passive: tuple[Passive, ...] = ()

    @property
    def cases(self):
        """The load cases; the one in which everything acts where none are given."""
        if self.load_cases:
            return self.load_cases
        loads = tuple(load.name for load in self.loads)
        return (LoadCase("all", loads, displacements=tuple(s.name for s in moved(self.supports))),)


def moved(supports):
    """The supports that have a displacement."""
    return tuple(support for support in supports if any(support.displacement))


@dataclass(frozen=True, eq=False)
class CaseConditions:
    """What acts in one load case on one mesh.

    Parameters
    ----------
    name : str
    weight : float
    forces : (n, 3) float array [N]
        Consistent nodal forces of the tractions (gravity not included).
    gravity : bool
        Whether the weight of the material acts.
    displacement : (n, 3) float array [m] or None
        Imposed at the held degrees of freedom, 0 elsewhere; None: 0 everywhere.
    """

    name: str
    weight: float
    forces: np.ndarray
    gravity: bool = True
    displacement: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Springs:
    """The stiffness matrix of elastic supports, whose blocks are diagonal.

    Parameters
    ----------
    rows, columns : (k,) int arrays
        Nodes i and j of each block; every pair once, both (i, j) and (j, i).
    blocks : (k, 3) float array [N/m]
        int stiffness N_i N_j in x, y and z.
    """

    rows: np.ndarray
    columns: np.ndarray
    blocks: np.ndarray

    def forces(self, displacement):
        """Return the product (n, 3) [N] with displacements (n, 3) [m]."""
        result = np.zeros_like(displacement)
        np.add.at(result, self.rows, self.blocks * displacement[self.columns])
        return result


@dataclass(frozen=True, eq=False)
class BoundaryConditions:
    """A problem's supports and loads on one mesh.

    Parameters
    ----------
    fixed : (n, 3) bool array
        Degrees of freedom that are held (supports and symmetry planes).
    forces : (n, 3) float array [N]
        Consistent nodal forces of all tractions (gravity not included).
    load_forces : mapping of str to (n, 3) float array [N]
        The same, load by load.
    cases : tuple of CaseConditions
        One, in which all forces act, if not given.
    springs : Springs or None
    """

    fixed: np.ndarray
    forces: np.ndarray
    load_forces: Mapping[str, np.ndarray]
    cases: tuple[CaseConditions, ...] = ()
    springs: Springs | None = None

    def __post_init__(self):
        if not self.cases:
            object.__setattr__(self, "cases", (CaseConditions("all", 1.0, self.forces),))
