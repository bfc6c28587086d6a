"""What `python -m remesh` does with its files, and the table it prints."""

import logging
from pathlib import Path

import numpy as np

from cases.targets import ALGORITHMS, Target, sigma_length
from meshes import InvalidMesh
from meshes.closest_point import two_sided_distance
from meshes.features import find_features
from meshes.io import SURFACE_SUFFIXES, read_surface, write_surface
from meshes.quality import surface_quality
from meshes.topology import require_valid
from rbf import fit_surfaces
from remesh import RemeshSettings, remesh

LOG = logging.getLogger("phasemesh")

SMOOTHING_PAIRS = 8


def remesh_file(request, sigma, parse_length, reporter):
    """Remesh `request.source` into `request.destination`.

    Parameters
    ----------
    request : cases.remesh_command.Request
    sigma : float or str
        In diagonals, or with a unit.
    parse_length : callable
        Makes a length in file units of a text with a unit.
    reporter : Reporter

    Returns
    -------
    before, after : dict
        Figures of both surfaces, for `table`.
    """
    _check_suffix(request.destination)
    surface = read_surface(request.source)
    require_valid(surface, closed=False, name=str(request.source))
    reporter.begin("remesh")
    surface = find_features(surface)
    sigma = sigma_length(sigma, surface.diagonal, parse_length)
    surfaces = None  # the input's own triangles, smoothed
    if not request.smooth:
        reporter.update("fitting the interpolant")
        surfaces = fit_surfaces(surface)
    settings = RemeshSettings(
        **Target(request.vertices, request.edge_length).for_surface(surface),
        sigma=sigma,
        iterations=request.iterations,
        algorithm=ALGORITHMS[request.algorithm],
        smoothing=SMOOTHING_PAIRS if request.smooth else 0,
    )
    result = remesh(
        surface,
        surfaces,
        settings,
        rng=np.random.default_rng(request.seed),
        progress=lambda stage, share: reporter.update(stage, round(100 * share), 100),
    )
    write_surface(request.destination, result.mesh)
    reporter.update("measuring")
    measured = sigma if sigma > 0.0 else 0.05 * surface.diagonal
    before, after = _figures(surface, measured), _figures(result.mesh, measured, surface)
    reporter.end(str(request.destination))
    return before, after


def _check_suffix(path):
    if Path(path).suffix.lower() not in SURFACE_SUFFIXES:
        raise InvalidMesh(
            f"{path}: the suffix {Path(path).suffix!r} is unknown; "
            f"use one of {', '.join(SURFACE_SUFFIXES)}"
        )


def _figures(surface, sigma, reference=None):
    quality = surface_quality(surface, sigma=sigma).as_dict()
    if reference is not None:
        rms, largest = two_sided_distance(reference, surface)
        quality["distance_rms"] = 100.0 * rms / reference.diagonal
        quality["distance_max"] = 100.0 * largest / reference.diagonal
    return quality


_ROWS = (
    ("vertices", "vertices", ",d"),
    ("triangles", "faces", ",d"),
    ("closed", "watertight", ""),
    ("genus", "genus", ""),
    ("self-intersecting triangles", "self_intersecting_faces", ",d"),
    ("smallest angle, mean [deg]", "min_angle_mean", ".1f"),
    ("smallest angle, worst [deg]", "min_angle_worst", ".1f"),
    ("triangles below 20 deg [%]", "pct_below_20", ".2f"),
    ("smallest angle in 6D, mean [deg]", "min_angle_6d_mean", ".1f"),
    ("longest over shortest edge", "edge_ratio", ".3g"),
    ("volume", "volume", ".6g"),
    ("distance, rms [% of diagonal]", "distance_rms", ".4f"),
    ("distance, largest [% of diagonal]", "distance_max", ".3f"),
)


def table(before, after, seconds):
    """Both surfaces side by side."""
    lines = [f"{'':<34}{'before':>14}{'after':>14}"]
    for name, key, form in _ROWS:
        cells = "".join(f"{_cell(figures.get(key), form):>14}" for figures in (before, after))
        lines.append(f"{name:<34}{cells}")
    lines.append(f"{'time [s]':<34}{'':>14}{seconds:>14.1f}")
    return "\n".join(lines)


def _cell(value, form):
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return format(value, form)
