"""The volume of the modelled part, and the uniform normal offset that sets it."""

import numpy as np

from isosurface.normals import smooth_area_vectors
from isosurface.volume_kernels import volume_coefficients
from meshes import NotConverged
from meshes.quality import face_areas, normalised

# Where a curve's plane meets the surface at a small angle, a vertex would have to run far within
# the plane to follow the offset: the square of that slope is bounded.
LEAST_SLOPE_SQUARED = 0.25


def modelled_volume(surface, symmetry=()):
    """Volume [m^3] enclosed by a surface and the symmetry planes on which it is open.

    Parameters
    ----------
    surface : TriMesh
    symmetry : sequence of SymmetryPlane
    """
    points = surface.points
    still = np.zeros(points.shape)
    return float(_polynomial(points, still, surface.faces, _origin(points, symmetry))[0])


def _origin(points, symmetry):
    """A point on all symmetry planes, else in the middle of the box: open planes add nothing."""
    origin = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for plane in symmetry:
        origin[plane.axis] = plane.offset
    return origin


def _polynomial(points, directions, faces, origin):
    """Volume as a cubic polynomial (4,) of the offset, exactly."""
    coefficients = np.empty(4)
    volume_coefficients(points, directions, faces, origin, coefficients)
    return coefficients


def offset_directions(surface, structure):
    """Displacements (n, 3) that offset the smooth faces by 1 along their normals.

    Vertices of curves and symmetry planes move within their planes, so far that their smooth faces
    are offset by 1 too; corners, vertices inside planar labels and those on curved pieces of the
    domain's boundary do not move.
    """
    normals = normalised(smooth_area_vectors(surface, structure))
    allowed = structure.constraints.apply(normals.copy())
    allowed[structure.on_domain] = 0.0
    slope = np.einsum("ij,ij->i", allowed, allowed)
    return allowed / np.maximum(slope, LEAST_SLOPE_SQUARED)[:, None]


def offset_to_volume(surface, directions, volume, symmetry=(), tolerance=1e-12):
    """Move vertices along their directions, all by the same amount, until the volume is met.

    Parameters
    ----------
    surface : TriMesh
    directions : (n, 3) float array
        Displacements for a unit offset.
    volume : float [m^3]
        Of the modelled part.
    symmetry : sequence of SymmetryPlane
    tolerance : float
        Relative to the volume.

    Returns
    -------
    points : (n, 3) float array
    offset : float [m]

    Raises
    ------
    NotConverged
        If the offset would exceed a mean edge length, or does not settle.
    """
    points, faces = surface.points, surface.faces
    cubic = _polynomial(points, directions, faces, _origin(points, symmetry))
    limit = np.sqrt(4.0 / np.sqrt(3.0) * face_areas(points, faces).mean())
    offset, history = 0.0, []
    for _ in range(50):
        miss = volume - np.polynomial.polynomial.polyval(offset, cubic)
        history.append(miss / volume)
        if abs(miss) <= tolerance * abs(volume):
            return points + offset * directions, offset
        gain = cubic[1] + offset * (2.0 * cubic[2] + 3.0 * offset * cubic[3])
        if gain <= 0.0 or abs(offset + miss / gain) > limit:
            break
        offset += miss / gain
    raise NotConverged(
        f"no normal offset below a mean edge ({limit:g} m) gives the volume {volume:g} m^3 "
        f"(relative miss {history[-1]:.3g}): smooth less, or check the volume asked for",
        history,
    )
