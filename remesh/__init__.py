"""Curvature-adapted remeshing of surfaces given by their interpolant or their own triangles."""

from remesh.remesh import RemeshResult, RemeshStatistics, remesh
from remesh.settings import RemeshSettings, ThesisRules
from remesh.triangle_surface import TriangleSurface

__all__ = [
    "RemeshResult",
    "RemeshSettings",
    "RemeshStatistics",
    "ThesisRules",
    "TriangleSurface",
    "remesh",
]
