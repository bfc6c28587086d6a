"""Smoothing of an extracted surface: Taubin's filter, folds turned back, the volume restored."""

from dataclasses import dataclass

import numpy as np

from isosurface.folds import FoldCheck
from isosurface.normals import worst_angle
from isosurface.offset import modelled_volume, offset_directions, offset_to_volume
from isosurface.structure import surface_structure
from isosurface.taubin import (
    THESIS_FACTORS,
    THESIS_PAIRS,
    filter_until_smooth,
    follow_rims,
    pass_band_factors,
    taubin_filter,
)
from meshes import InvalidCase

RESTORE_ROUNDS = 8


@dataclass(frozen=True)
class SmoothingSettings:
    """How to smooth.

    Parameters
    ----------
    taubin : "default", "thesis" or "off"
        "default" has its pass band at 0.1, "thesis" is 0.40 / -0.50 x 40, which inflates.
    iterations : int or "auto"
        Pairs of Taubin steps; "auto" is the thesis's 40, or by default 5 to 80, doubled as long as
        that takes out roughness.
    restore_volume : bool
        Whether to set the volume by a uniform normal offset of the smooth part.
    target_volume : float [m^3], optional
        Volume of the modelled part to set; that before smoothing if not given.
    check_intersections : bool
        Whether to draw back vertices whose faces meet other faces.
    """

    taubin: str = "default"
    iterations: int | str = "auto"
    restore_volume: bool = True
    target_volume: float | None = None
    check_intersections: bool = True

    def __post_init__(self):
        if self.taubin not in ("default", "thesis", "off"):
            raise InvalidCase(f"taubin must be default, thesis or off, got {self.taubin!r}")
        whole = isinstance(self.iterations, int) and not isinstance(self.iterations, bool)
        if self.iterations != "auto" and not (whole and self.iterations >= 0):
            raise InvalidCase(f"iterations must be auto or not negative, got {self.iterations!r}")

    @property
    def factors(self):
        """The two Taubin factors (lambda, mu)."""
        return THESIS_FACTORS if self.taubin == "thesis" else pass_band_factors()

    @property
    def pairs(self):
        """Number of pairs of Taubin steps; None if the surface decides."""
        if self.taubin == "off":
            return 0
        if self.iterations == "auto":
            return THESIS_PAIRS if self.taubin == "thesis" else None
        return self.iterations


@dataclass(frozen=True)
class SmoothingReport:
    """What smoothing did to the modelled part.

    Parameters
    ----------
    pairs : int
        Pairs of Taubin steps.
    factors : (lambda, mu)
    volume_before, volume_filtered, volume_after : float or None [m^3]
        Before, after Taubin's filter alone, and at the end; None if the surface is not closed.
    offset : float [m]
        Normal offset of the smooth part that set the volume.
    largest_move, rms_move : float [m]
        Displacement of the vertices.
    held_back : int
        Vertices that kept short of their smoothed position so that no face folds or meets another.
    min_angle_before, min_angle_after : float [degrees]
        Worst angle of the triangles.
    """

    pairs: int
    factors: tuple[float, float]
    volume_before: float | None
    volume_filtered: float | None
    volume_after: float | None
    offset: float
    largest_move: float
    rms_move: float
    held_back: int
    min_angle_before: float
    min_angle_after: float

    @property
    def drift_filtered(self):
        """Relative change of volume by the filter alone."""
        return _drift(self.volume_before, self.volume_filtered)

    @property
    def drift(self):
        """Relative change of volume in the end."""
        return _drift(self.volume_before, self.volume_after)


def _drift(before, after):
    """Relative change, None if unknown."""
    return None if before is None else after / before - 1.0


def smooth(surface, settings=None, symmetry=()):
    """Smooth a labelled surface; connectivity, labels, planes, curves and corners stay.

    Parameters
    ----------
    surface : TriMesh
        Closed, or open on the symmetry planes given: then it is smoothed as the whole part would
        be, and its mirror image is exactly symmetric.
    settings : SmoothingSettings, optional
    symmetry : sequence of SymmetryPlane

    Returns
    -------
    surface : TriMesh
    report : SmoothingReport

    Raises
    ------
    InvalidCase
        If a volume is asked for and the surface is open elsewhere.
    NotConverged
        If no offset below an edge length meets the volume.

    Notes
    -----
    Rims (label boundaries) are smoothed along their curve in the cap's plane, vertices inside caps
    follow them in that plane, corners do not move. Thesis section 3.3.
    """
    settings = SmoothingSettings() if settings is None else settings
    structure = surface_structure(surface, symmetry)
    closed = not np.any((structure.table.count == 1) & structure.curve)
    if settings.target_volume is not None and not closed:
        raise InvalidCase("a target volume needs a closed surface: mend its holes, or do without")
    check = FoldCheck(surface, structure, symmetry)
    filtered, pairs = _filtered(surface, settings, structure)
    points, held = check.retreat(surface.points, filtered, settings.check_intersections)
    offset = 0.0
    if closed and settings.restore_volume:
        points, held, offset = _restore(surface, points, held, check, structure, settings, symmetry)
    smoothed = surface.with_points(points)
    stages = (surface, surface.with_points(filtered), smoothed)
    volumes = [modelled_volume(mesh, symmetry) if closed else None for mesh in stages]
    move = np.linalg.norm(points - surface.points, axis=1)
    return smoothed, SmoothingReport(
        pairs=pairs,
        factors=settings.factors,
        volume_before=volumes[0],
        volume_filtered=volumes[1],
        volume_after=volumes[2],
        offset=float(offset),
        largest_move=float(move.max(initial=0.0)),
        rms_move=float(np.sqrt(np.mean(move**2))) if len(move) else 0.0,
        held_back=int(held.sum()),
        min_angle_before=worst_angle(surface),
        min_angle_after=worst_angle(smoothed),
    )


def _filtered(surface, settings, structure):
    """Positions after Taubin's filter, and the pairs of steps taken."""
    if settings.pairs is None:
        return filter_until_smooth(surface, settings.factors, structure)
    points = taubin_filter(surface, settings.factors, settings.pairs, structure=structure)
    return points, settings.pairs


def _restore(surface, points, held, check, structure, settings, symmetry):
    """Offset to the volume; vertices that would fold a face stay, and the others make up for it."""
    volume = settings.target_volume
    volume = modelled_volume(surface, symmetry) if volume is None else volume
    start = surface.with_points(points)
    directions = follow_rims(structure, offset_directions(start, structure))
    for _ in range(RESTORE_ROUNDS):
        moved, offset = offset_to_volume(start, directions, volume, symmetry)
        settled, stuck = check.retreat(points, moved, settings.check_intersections)
        if not stuck.any():
            break
        directions[stuck] = 0.0
        held = held | stuck
    return settled, held, offset
