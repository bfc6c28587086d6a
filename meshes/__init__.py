"""What the stages hand to each other: meshes, fields, implicit surfaces, and checks on them."""

from meshes.errors import InvalidCase, InvalidMesh, NotConverged
from meshes.kernel_cache import drop_stale_kernels
from meshes.patch import Patch, Plane, SymmetryPlane
from meshes.phase_field import PhaseField
from meshes.surface import ImplicitSurface, PlaneSurface
from meshes.tet_mesh import TetMesh
from meshes.tri_mesh import TriMesh

__all__ = [
    "ImplicitSurface",
    "InvalidCase",
    "InvalidMesh",
    "NotConverged",
    "Patch",
    "PhaseField",
    "Plane",
    "PlaneSurface",
    "SymmetryPlane",
    "TetMesh",
    "TriMesh",
]

drop_stale_kernels()  # before the first kernel is loaded
