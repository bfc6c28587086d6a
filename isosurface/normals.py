"""Normals of the smooth faces at the vertices, and the worst angle of all faces."""

import numpy as np

from meshes.quality import area_vectors, normalised


def smooth_area_vectors(surface, structure):
    """Sum (n, 3) of the area vectors of the smooth faces around every vertex.

    On a symmetry plane the mirror image counts too: nothing is left along the plane's normal.
    """
    faces = surface.faces[structure.smooth_faces]
    area = area_vectors(surface.points, faces)
    index = faces.ravel(order="F")
    sums = np.empty(surface.points.shape)
    for k in range(3):
        sums[:, k] = np.bincount(index, np.tile(area[:, k], 3), minlength=len(sums))
    return _without_mirrored(sums, structure)


def averaged_normals(surface, structure, rounds=2):
    """Unit normals (n, 3) of the smooth faces, averaged with those of the neighbours."""
    normals = normalised(smooth_area_vectors(surface, structure))
    for _ in range(rounds):
        normals = _without_mirrored(normals + structure.average @ normals, structure)
        normals = normalised(normals)
    return normals


def _without_mirrored(vectors, structure):
    """Vectors (n, 3), in place, without the components that their mirror images cancel."""
    count = structure.on_symmetry.shape[1]
    for k, normal in enumerate(structure.normals[len(structure.normals) - count :]):
        vectors[structure.on_symmetry[:, k], np.argmax(np.abs(normal))] = 0.0
    return vectors


def worst_angle(surface):
    """Smallest angle [degrees] of all triangles: the one opposite to a shortest edge."""
    if len(surface.faces) == 0:
        return 60.0
    a, b, c = (surface.points[surface.faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    squares = np.stack([np.einsum("ij,ij->i", e, e) for e in (b - a, c - b, a - c)])
    tangent = 2.0 * np.sqrt(np.einsum("ij,ij->i", area, area))
    cotangent = squares.sum(axis=0) - 2.0 * squares.min(axis=0)
    least = np.min(tangent / np.where(cotangent > 0.0, cotangent, 1.0))
    return float(np.degrees(np.arctan(least)))
