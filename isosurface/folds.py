"""Faces that a move has turned over, and the retreat that turns them back."""

import numpy as np

from isosurface.normals import averaged_normals
from meshes.quality import area_vectors, normalised
from meshes.self_intersection import self_intersecting_faces

# A face is folded when its normal is more than acos(0.1) = 84 degrees off the surface around it;
# in a plane, when its area seen along the plane's normal falls below this share of the square of
# its longest edge.
LEAST_COSINE = 0.1
LEAST_SHAPE = 1e-3
# Share of its distance to a plane that a vertex beside the plane must keep.
LEAST_DISTANCE = 0.05
HALVINGS = 5


class FoldCheck:
    """Knows what the normals of a surface should be, and finds the faces that left them.

    Faces of planar labels are compared with their plane; the others with the normals of the
    vertices around, averaged twice, which the jags of a raw isosurface do not disturb. Vertices
    stay on their side of symmetry planes, and of caps with which they share a face.

    Parameters
    ----------
    surface : TriMesh
    structure : Structure
        Of this surface.
    symmetry : sequence of SymmetryPlane
    """

    def __init__(self, surface, structure, symmetry=()):
        self._faces = surface.faces
        self._smooth = structure.smooth_faces
        self._reference = _reference_normals(surface, structure)
        offsets = [p.plane.offset for p in surface.labels if p.plane is not None]
        self._offsets = np.array([*offsets, *(plane.offset for plane in symmetry)], dtype=float)
        self._normals = structure.normals
        beside = _beside_planes(surface.faces, structure.on_plane, len(symmetry))
        distance = self._distances(surface.points, beside)
        self._beside = tuple(index[distance != 0.0] for index in beside)
        self._before = distance[distance != 0.0]

    def _distances(self, points, beside):
        """Signed distances (k,) of the vertices from the planes they are beside."""
        vertex, plane = beside
        along = np.einsum("ij,ij->i", points[vertex], self._normals[plane])
        return along - self._offsets[plane]

    def folded(self, points):
        """Faces (m,) bool that are folded when the vertices are at points (n, 3)."""
        area = area_vectors(points, self._faces)
        along = np.einsum("ij,ij->i", area, self._reference)
        limit = LEAST_COSINE * np.linalg.norm(area, axis=1)
        limit[~self._smooth] = LEAST_SHAPE * _longest_squared(points, self._faces[~self._smooth])
        bad = along <= limit
        kept = self._distances(points, self._beside) / self._before
        crossed = np.zeros(len(points), dtype=bool)
        crossed[self._beside[0][kept < LEAST_DISTANCE]] = True
        return bad | crossed[self._faces].any(axis=1)

    def retreat(self, before, after, intersections=False):
        """Move vertices of folded faces back towards where they were until none is left.

        A vertex goes half of the way back up to five times, then all of the way; faces whose
        vertices are all back are as good as they were, so the search ends.

        Parameters
        ----------
        before, after : (n, 3) float arrays
        intersections : bool
            Whether to draw back faces that meet other faces, too.

        Returns
        -------
        points : (n, 3) float array
        moved : (n,) bool array
            Vertices that are not where `after` has them.
        """
        share = np.ones(len(after))
        points = np.array(after)
        while True:
            movable = (share[self._faces] > 0.0).any(axis=1)
            bad = self.folded(points) & movable
            if intersections and not bad.any():
                bad = self_intersecting_faces(points, self._faces) & movable
            if not bad.any():
                return points, share < 1.0
            vertices = np.unique(self._faces[bad])
            share[vertices] *= 0.5
            share[share < 0.5**HALVINGS] = 0.0
            points = before + share[:, None] * (after - before)
            points[share == 1.0] = after[share == 1.0]


def _reference_normals(surface, structure):
    """Unit normals (m, 3) that faces should roughly have."""
    faces = surface.faces
    normals = averaged_normals(surface, structure)
    reference = normalised(normals[faces].sum(axis=1))
    for label, patch in enumerate(surface.labels):
        if patch.plane is not None:
            reference[surface.face_labels == label] = patch.plane.normal
    return reference


def _beside_planes(faces, on_plane, symmetry_count):
    """Vertices that must stay on their side of a plane: vertices (k,), planes (k,).

    Those off a plane that share a face with one on it; off symmetry planes, which come last, all.
    """
    beside = np.zeros(on_plane.shape, dtype=bool)
    for k in range(on_plane.shape[1]):
        beside[faces[on_plane[faces, k].any(axis=1)], k] = True
    beside[:, on_plane.shape[1] - symmetry_count :] = True
    return np.nonzero(beside & ~on_plane)


def _longest_squared(points, faces):
    """Square of the longest edge (m,) of faces."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    return np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
