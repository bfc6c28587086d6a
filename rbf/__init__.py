"""Radial basis functions: implicit surfaces through points, and scattered values."""

from rbf.curvature import principal_curvatures
from rbf.dense import GlobalInterpolant, fit_global
from rbf.greedy import GreedyFit, fit_greedy
from rbf.hermite import HermiteInterpolant, fit_hermite
from rbf.interpolant import CompactInterpolant, FitReport
from rbf.kernels import KERNELS, Kernel
from rbf.levels import LevelsInterpolant, fit_levels
from rbf.local import LocalInterpolant, fit_local
from rbf.normals import pca_normals, vertex_normals
from rbf.offsets import OffsetInterpolant, fit_offsets
from rbf.scattered import ValueInterpolant, fit_values
from rbf.surfaces import fit_surface, fit_surfaces

__all__ = [
    "KERNELS",
    "CompactInterpolant",
    "FitReport",
    "GlobalInterpolant",
    "GreedyFit",
    "HermiteInterpolant",
    "Kernel",
    "LevelsInterpolant",
    "LocalInterpolant",
    "OffsetInterpolant",
    "ValueInterpolant",
    "fit_global",
    "fit_greedy",
    "fit_hermite",
    "fit_levels",
    "fit_local",
    "fit_offsets",
    "fit_surface",
    "fit_surfaces",
    "fit_values",
    "pca_normals",
    "principal_curvatures",
    "vertex_normals",
]
