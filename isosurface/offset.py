"""The volume of the modelled part, and the uniform normal offset that sets it."""

import numpy as np

from meshes import NotConverged
from meshes.quality import area_vectors, face_areas, normalised

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
    return _volume(surface.points, surface.faces, _origin(surface.points, symmetry))


def _origin(points, symmetry):
    """A point on all symmetry planes, else in the middle of the box: open planes add nothing."""
    origin = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for plane in symmetry:
        origin[plane.axis] = plane.offset
    return origin


def _volume(points, faces, origin):
    """Sum of the tetrahedra between the faces and the origin."""
    a, b, c = (points[faces[:, k]] - origin for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def offset_directions(surface, structure):
    """Displacements (n, 3) that offset the smooth faces by 1 along their normals.

    Vertices of curves and symmetry planes move within their planes, so far that their smooth faces
    are offset by 1 too; corners, and vertices inside planar labels, do not move.
    """
    area = area_vectors(surface.points, surface.faces)
    normals = np.zeros(surface.points.shape)
    for corner in range(3):
        vertices = surface.faces[structure.smooth_faces, corner]
        np.add.at(normals, vertices, area[structure.smooth_faces])
    constraints = structure.constraints
    on_symmetry = structure.on_symmetry.any(axis=1)
    normals[on_symmetry] = _without_symmetry(normals, structure)[on_symmetry]
    normals = normalised(normals)
    allowed = constraints.apply(normals.copy())
    slope = np.einsum("ij,ij->i", allowed, allowed)
    return allowed / np.maximum(slope, LEAST_SLOPE_SQUARED)[:, None]


def _without_symmetry(vectors, structure):
    """Vectors (n, 3) with the components that their mirror images cancel set to zero."""
    result = vectors.copy()
    count = structure.on_symmetry.shape[1]
    for k, normal in enumerate(structure.normals[len(structure.normals) - count :]):
        result[structure.on_symmetry[:, k], np.argmax(np.abs(normal))] = 0.0
    return result


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
    origin = _origin(points, symmetry)
    limit = np.sqrt(4.0 / np.sqrt(3.0) * face_areas(points, faces).mean())
    offset, history = 0.0, []
    for _ in range(50):
        moved = points + offset * directions
        miss = volume - _volume(moved, faces, origin)
        history.append(miss / volume)
        if abs(miss) <= tolerance * abs(volume):
            return moved, offset
        gain = np.einsum("ij,ij->", area_vectors(moved, faces), directions[faces].mean(axis=1))
        if gain <= 0.0 or abs(offset + miss / gain) > limit:
            break
        offset += miss / gain
    raise NotConverged(
        f"no normal offset below a mean edge ({limit:g} m) gives the volume {volume:g} m^3 "
        f"(relative miss {history[-1]:.3g}): smooth less, or check the volume asked for",
        history,
    )
