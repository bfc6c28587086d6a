"""The stages that make the surface: isosurface and smoothing.

Every stage has `run` (make the product and write its files; returns what to tell) and `load`
(read them again for --from).
"""

import logging

from isosurface import (
    SmoothingSettings,
    diffused,
    drop_islands,
    extract_surface,
    mirror,
    modelled_volume,
    smooth,
    surface_level,
    volume_level,
)
from isosurface.repair import repair_slivers
from meshes.io import read_surface, write_surface
from meshes.quality import signed_volume
from meshes.tet_mesh import tet_volumes

LOG = logging.getLogger("phasemesh")


class IsosurfaceStage:
    """The surface of {phi >= level}: of the modelled part, and mirrored of the whole one."""

    def run(self, run):
        text = self._extract(run)
        write_surface(run.folder / "isosurface.ply", run.isosurface)
        return text

    def load(self, run):
        self._extract(run)  # a second's work; smoothing needs the modelled part
        run.isosurface = read_surface(run.folder / "isosurface.ply")

    def _extract(self, run):
        section, design = run.case.isosurface, run.design
        if section.diffusion > 0.0:
            design = diffused(design, section.diffusion * _edge_length(design.mesh))
        level = self._level(run, design)
        figures = {"level": level, "islands_dropped": 0}
        if section.islands == "drop":
            design, report = drop_islands(design, level)
            figures["islands_dropped"] = report.islands
            figures["cavities"] = report.cavities
            _tell_islands(report)
        run.modelled = extract_surface(design, level, section.crossing, spread=section.spread)
        run.isosurface = mirror(run.modelled, run.problem.symmetry)
        figures["modelled_volume_m3"] = modelled_volume(run.modelled, run.problem.symmetry)
        run.figures["isosurface"] = figures
        return _counted(run.isosurface)

    def _level(self, run, design):
        """The level asked for, or the one whose surface encloses the material's volume."""
        section = run.case.isosurface
        if section.level != "volume":
            return section.level
        volume = run.figures["topopt"]["material_volume_m3"]
        if section.crossing == "linear" and section.spread == 0.0:
            return volume_level(design, volume)

        def enclosed(level):
            surface = extract_surface(design, level, section.crossing, spread=section.spread)
            return modelled_volume(surface, run.problem.symmetry)

        return surface_level(design, volume, enclosed)


def _edge_length(mesh):
    """Edge [m] of a regular tetrahedron of the mesh's mean volume."""
    volume = tet_volumes(mesh.points, mesh.tets).mean()
    return float((6.0 * 2.0**0.5 * volume) ** (1.0 / 3.0))


def _tell_islands(report):
    if report.islands:
        LOG.warning(
            "%d of %d pieces of the solid touch no load or no support and were dropped "
            "(%.3g m^3 in all)",
            *(report.islands, report.components, sum(report.island_volumes)),
        )
    if report.cavities:
        LOG.warning(
            "the solid has %d closed cavities (%.3g m^3 in all), which no printer can empty",
            *(report.cavities, sum(report.cavity_volumes)),
        )


class SmoothStage:
    """The isosurface without the mesh's jags: slivers repaired, Taubin, the volume restored."""

    def run(self, run):
        section, symmetry = run.case.smooth, run.problem.symmetry
        surface = run.modelled
        figures = run.figures["smooth"] = {}
        if section.repair:
            surface, repaired = repair_slivers(surface, symmetry)
            LOG.info("slivers: %s", repaired)
        target = None
        if section.volume == "fraction":
            target = run.figures["topopt"]["material_volume_m3"]
        elif section.volume == "isosurface":
            target = run.figures["isosurface"]["modelled_volume_m3"]
        settings = SmoothingSettings(
            taubin=section.taubin,
            iterations=section.iterations,
            restore_volume=section.volume != "free",
            target_volume=target,
        )
        surface, report = smooth(surface, settings, symmetry)
        LOG.info("smoothing: %s", report)
        if section.repair:
            surface = _repaired_again(surface, report, symmetry)
        figures["drift_of_filter"] = report.drift_filtered
        figures["normal_offset_m"] = report.offset
        figures["largest_move_m"] = report.largest_move
        run.smoothed = mirror(surface, symmetry)
        write_surface(run.folder / "smoothed.ply", run.smoothed)
        drift = signed_volume(run.smoothed) / signed_volume(run.isosurface) - 1.0
        return f"{_counted(run.smoothed)}, volume {100 * drift:+.2f} %"

    def load(self, run):
        run.smoothed = read_surface(run.folder / "smoothed.ply")
        run.figures["smooth"] = {}


def _repaired_again(surface, report, symmetry):
    """Repair what smoothing has left, or made, of slivers; the volume stays as smoothing set it."""
    repaired, second = repair_slivers(surface, symmetry)
    LOG.info("slivers after smoothing: %s", second)
    if second.min_angle_after <= second.min_angle_before or report.volume_after is None:
        return surface
    settings = SmoothingSettings(taubin="off", target_volume=report.volume_after)
    repaired, restored = smooth(repaired, settings, symmetry)
    LOG.info("volume after repair: %s", restored)
    return repaired


def _counted(surface):
    return f"{len(surface.faces):,} triangles, {len(surface.points):,} vertices"
