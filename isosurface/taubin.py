"""Taubin's low-pass filter on a surface (Taubin 1995; thesis section 3.3).

A pair of steps multiplies a part of the surface with eigenvalue k of the uniform Laplacian (0 for
constants, about (wave number times edge length)^2 / 4 for long waves, at most 2) by
(1 - lambda k)(1 - mu k). With lambda > 0 > mu that is 1 at k = 0 and at the pass band
k = 1/lambda + 1/mu; below the band it is above 1, beyond it the wave is damped.
"""

import numpy as np

from isosurface.structure import surface_structure
from meshes import InvalidCase

THESIS_FACTORS = (0.40, -0.50)
THESIS_PAIRS = 40
# The mean of a curve's two neighbours pulls twice as hard on a wave along the curve as the mean of
# six around a vertex of the surface; so both let pass the same waves.
CURVE_WEIGHT = 0.5


def pass_band_factors(shrink=0.63, pass_band=0.1):
    """Return (lambda, mu) whose pair of steps leaves waves with eigenvalue `pass_band` as they are.

    Raises
    ------
    InvalidCase
        If not 0 < lambda < 1, or not 0 <= pass_band < 1/lambda.
    """
    if not 0.0 < shrink < 1.0 or not 0.0 <= pass_band < 1.0 / shrink:
        raise InvalidCase(
            f"Taubin smoothing needs 0 < lambda < 1 and 0 <= pass_band < 1/lambda, "
            f"got lambda {shrink:g} and pass_band {pass_band:g}"
        )
    return shrink, -1.0 / (1.0 / shrink - pass_band)


def taubin_filter(surface, factors, pairs, symmetry=(), structure=None):
    """Return the positions (n, 3) of the vertices after pairs of Taubin steps, uniform weights.

    Parameters
    ----------
    surface : TriMesh
    factors : (lambda, mu)
    pairs : int
    symmetry : sequence of SymmetryPlane
        Planes on which the surface is open and will be mirrored.
    structure : Structure, optional
        Of this surface, if it is at hand.

    Notes
    -----
    Vertices of symmetry planes stay in them; vertices of curves are filtered along their curve
    alone, between its two neighbours, and so stay in the planes beside it; corners do not move.
    Vertices inside planar labels have no noise to lose: they follow their rim.
    """
    structure = surface_structure(surface, symmetry) if structure is None else structure
    average = structure.average
    constraints = structure.constraints
    weight = np.where(structure.on_curve, CURVE_WEIGHT, 1.0)[:, None]
    weight[structure.within_plane] = 0.0
    points = np.array(surface.points)
    for _ in range(pairs):
        for factor in factors:
            points += constraints.apply(factor * weight * (average @ points - points))
    return surface.points + follow_rims(structure, points - surface.points)


def follow_rims(structure, displacement, sweeps=30):
    """Carry the displacements (n, 3) of rims into the planar labels inside them.

    Every vertex inside a planar label moves by the mean of its neighbours' displacements (a
    harmonic function, from Jacobi sweeps), so that its triangles deform little.
    """
    within = np.flatnonzero(structure.within_plane)
    if len(within) == 0:
        return displacement
    average = structure.average[within]
    constraints = structure.constraints
    displacement = np.array(displacement)
    for _ in range(sweeps):
        displacement[within] = average @ displacement
        constraints.apply(displacement)
    return displacement
