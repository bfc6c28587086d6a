"""Radial basis functions: implicit surfaces through points, and scattered values."""

from rbf.hermite import HermiteInterpolant, fit_hermite
from rbf.interpolant import CompactInterpolant, FitReport
from rbf.kernels import KERNELS, Kernel
from rbf.normals import pca_normals, vertex_normals

__all__ = [
    "KERNELS",
    "CompactInterpolant",
    "FitReport",
    "HermiteInterpolant",
    "Kernel",
    "fit_hermite",
    "pca_normals",
    "vertex_normals",
]
