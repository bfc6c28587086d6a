"""Taubin's low-pass filter on a surface (Taubin 1995; thesis section 3.3).

A pair of steps multiplies a part of the surface with eigenvalue k of the uniform Laplacian (0 for
constants, about (wave number times edge length)^2 / 4 for long waves, at most 2) by
(1 - lambda k)(1 - mu k). With lambda > 0 > mu that is 1 at k = 0 and at the pass band
k = 1/lambda + 1/mu; below the band it is above 1, beyond it the wave is damped.
"""

import numpy as np

from isosurface.structure import surface_structure
from meshes import InvalidCase
from meshes.quality import face_normals

THESIS_FACTORS = (0.40, -0.50)
THESIS_PAIRS = 40
# The mean of a curve's two neighbours pulls twice as hard on a wave along the curve as the mean of
# six around a vertex of the surface; so both let pass the same waves.
CURVE_WEIGHT = 0.5
FIRST_PAIRS = 5


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
    Vertices inside planar labels have no noise to lose: they follow their rim. Those inside curved
    pieces of the domain's boundary stay.
    """
    structure = surface_structure(surface, symmetry) if structure is None else structure
    points = _filtered(np.array(surface.points), structure, factors, pairs)
    return surface.points + follow_rims(structure, points - surface.points)


def filter_until_smooth(surface, factors, structure, most=80, gain=0.03):
    """Filter with 5, 10, 20, ... pairs, as long as doubling them still takes out roughness.

    Parameters
    ----------
    surface : TriMesh
    factors : (lambda, mu)
    structure : Structure
    most : int
        Pairs at most.
    gain : float
        Doubling the pairs is worth while if the mean angle between neighbouring smooth faces falls
        by this share: on a surface from a well resolved field it stays after 5 or 10 pairs, on the
        terraces of an interface sharper than the mesh it falls further.

    Returns
    -------
    points : (n, 3) float array
    pairs : int
    """
    neighbours = _smooth_pairs(structure)
    pairs = FIRST_PAIRS
    points = _filtered(np.array(surface.points), structure, factors, pairs)
    rough = _roughness(points, surface.faces, neighbours)
    while 2 * pairs <= most:
        further = _filtered(points.copy(), structure, factors, pairs)
        less = _roughness(further, surface.faces, neighbours)
        if less > (1.0 - gain) * rough:
            break
        points, rough, pairs = further, less, 2 * pairs
    return surface.points + follow_rims(structure, points - surface.points), pairs


def _filtered(points, structure, factors, pairs):
    """Take pairs of Taubin steps with points (n, 3), in place."""
    average, constraints = structure.average, structure.constraints
    weight = np.where(structure.on_curve, CURVE_WEIGHT, 1.0)[:, None]
    weight[structure.within_plane | (structure.on_domain & ~structure.on_curve)] = 0.0
    for _ in range(pairs):
        for factor in factors:
            points += constraints.apply(factor * weight * (average @ points - points))
    return points


def _smooth_pairs(structure):
    """Pairs (p, 2) of smooth faces that share an edge of no curve."""
    inner, pairs = structure.table.face_pairs()
    return pairs[structure.smooth_faces[pairs].all(axis=1) & ~structure.curve[inner]]


def _roughness(points, faces, pairs):
    """Mean angle [radians] between the normals of pairs (p, 2) of faces."""
    if len(pairs) == 0:
        return 0.0
    first, second = np.moveaxis(face_normals(points, faces)[pairs], 1, 0)
    half = 0.5 * np.linalg.norm(first - second, axis=1)
    return float(2.0 * np.arcsin(np.minimum(half, 1.0)).mean())


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
