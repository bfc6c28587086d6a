"""Curvature-adapted remeshing of surfaces given by their interpolant or their own triangles.

The names below are imported when they are first asked for, so that `python -m remesh` starts at
once and Ctrl-C counts from its beginning.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from remesh.remesher import RemeshResult, RemeshStatistics, remesh
    from remesh.settings import RemeshSettings, ThesisRules
    from remesh.triangle_surface import TriangleSurface

_MODULES = {
    "RemeshResult": "remesh.remesher",
    "RemeshSettings": "remesh.settings",
    "RemeshStatistics": "remesh.remesher",
    "ThesisRules": "remesh.settings",
    "TriangleSurface": "remesh.triangle_surface",
    "remesh": "remesh.remesher",
}

__all__ = [
    "RemeshResult",
    "RemeshSettings",
    "RemeshStatistics",
    "ThesisRules",
    "TriangleSurface",
    "remesh",
]


def __getattr__(name):
    if name not in _MODULES:
        raise AttributeError(f"module 'remesh' has no attribute {name!r}")
    globals()[name] = getattr(importlib.import_module(_MODULES[name]), name)
    return globals()[name]
