"""Radial basis functions: implicit surfaces through points, and scattered values."""

from rbf.hermite import HermiteInterpolant, fit_hermite
from rbf.interpolant import CompactInterpolant, FitReport
from rbf.kernels import KERNELS, Kernel
from rbf.normals import pca_normals, vertex_normals
from rbf.offsets import OffsetInterpolant, fit_offsets
from rbf.scattered import ValueInterpolant, fit_values
from rbf.surfaces import fit_surface, fit_surfaces

__all__ = [
    "KERNELS",
    "CompactInterpolant",
    "FitReport",
    "HermiteInterpolant",
    "Kernel",
    "OffsetInterpolant",
    "ValueInterpolant",
    "fit_hermite",
    "fit_offsets",
    "fit_surface",
    "fit_surfaces",
    "fit_values",
    "pca_normals",
    "vertex_normals",
]
