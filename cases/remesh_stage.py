"""The last stage: an interpolant of the smoothed surface, remeshed adaptively."""

import logging

import numpy as np

from cases.surface_files import write_stl_checked
from cases.targets import ALGORITHMS, Target, longest_edge, sigma_length
from meshes.io import read_surface, write_surface
from rbf import fit_surfaces
from remesh import RemeshSettings, remesh

LOG = logging.getLogger("phasemesh")


class RemeshStage:
    """The final surface, as PLY in metres and as a checked STL in millimetres."""

    def run(self, run):
        case, surface = run.case, run.smoothed
        run.reporter.update("fitting the interpolant")
        surfaces = fit_surfaces(
            surface,
            support_radius=self._support(case.rbf, surface),
            form=case.rbf.form,
            tolerance=case.rbf.tolerance,
        )
        fits = [fit_figures(fit) for fit in surfaces if hasattr(fit, "report")]
        target = Target(
            None if case.remesh.vertices == "input" else case.remesh.vertices,
            case.remesh.edge_length,
            case.remesh.edge_factor,
        ).for_surface(surface)
        settings = RemeshSettings(
            **target,
            **length_limits(case.remesh),
            sigma=sigma_length(case.remesh.sigma, surface.diagonal),
            quality=case.remesh.quality,
            iterations=case.remesh.iterations,
            algorithm=ALGORITHMS[case.remesh.algorithm],
        )
        LOG.info("remeshing: %s", settings)
        result = remesh(
            surface,
            surfaces,
            settings,
            rng=np.random.default_rng(case.seed),
            progress=lambda stage, share: run.reporter.update(stage, round(100 * share), 100),
        )
        LOG.info("remeshing: %s", result.statistics)
        run.surface = result.mesh
        run.figures["remesh"] = {"fits": fits, **target, "sigma_m": settings.sigma}
        write_surface(run.folder / "surface.ply", run.surface)
        write_stl_checked(run.folder / "surface.stl", run.surface)
        return f"{len(run.surface.faces):,} triangles, {len(run.surface.points):,} vertices"

    def load(self, run):
        run.surface = read_surface(run.folder / "surface.ply")

    def _support(self, section, surface):
        if section.support_factor is not None:
            return section.support_factor * longest_edge(surface)
        return None if section.support_radius == "auto" else section.support_radius


def length_limits(section):
    """The settings of the remesher for the limits and the gradation that a case gives."""
    return {
        "min_length": section.min_length or 0.0,
        "max_length": section.max_length or float("inf"),
        "gradation": section.gradation,
    }


def fit_figures(fit):
    """What manifest.json tells of a fit."""
    report = fit.report
    return {
        "centres": len(fit.points),
        "support_radius": fit.support_radius,
        "iterations": report.iterations,
        "residual": report.residual,
        "condition": report.condition,
        "welded": report.welded,
        "added": report.added,
    }
