"""From a phase field to a smooth, labelled, closed surface of the part.

The order is: `drop_islands` (field), `extract_surface`, `repair_slivers`, `smooth` (all of the
modelled part, with its symmetry planes), `mirror` (the whole part, exactly symmetric).
"""

from isosurface.diffusion import diffused
from isosurface.islands import IslandReport, drop_islands
from isosurface.marching_tets import extract_surface
from isosurface.mirror import mirror
from isosurface.offset import modelled_volume
from isosurface.repair import RepairReport, RepairSettings, repair_slivers
from isosurface.smooth import SmoothingReport, SmoothingSettings, smooth
from isosurface.solid_volume import solid_volume, surface_level, volume_level

__all__ = [
    "IslandReport",
    "RepairReport",
    "RepairSettings",
    "SmoothingReport",
    "SmoothingSettings",
    "diffused",
    "drop_islands",
    "extract_surface",
    "mirror",
    "modelled_volume",
    "repair_slivers",
    "smooth",
    "solid_volume",
    "surface_level",
    "volume_level",
]
