"""The input's own triangles as a reference surface: closest point, Phong normals."""

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from remesh.carrier import carrier_on
from remesh.layout import Layout, averaged, make_layout, row_normals


class TriangleSurface:
    """The triangles of a mesh as an ImplicitSurface, all labels at once.

    S is the distance to the nearest triangle, negative inside; its gradient is the interpolated
    normal there. Fidelity to the input as it is, where an interpolant would round or overshoot.

    Parameters
    ----------
    mesh : TriMesh or Layout
        Manifold and oriented outward.
    normal_smoothing : int
        How often the normals are averaged with their neighbours' (for jagged input).

    Raises
    ------
    InvalidMesh
        When first used, if the mesh has no faces, NaN points, or is not an oriented manifold.
    """

    def __init__(self, mesh, normal_smoothing=0):
        self.source, self.normal_smoothing = mesh, normal_smoothing

    @cached_property
    def layout(self):
        """The Layout of the triangles."""
        return self.source if isinstance(self.source, Layout) else make_layout(self.source)

    @cached_property
    def row_normals(self):
        """Unit normal of every row (k, 3)."""
        layout = self.layout
        return averaged(layout.group, row_normals(layout), self.normal_smoothing)

    @cached_property
    def carrier(self):
        """The Carrier that the triangles are."""
        return carrier_on(self.layout, self.row_normals[self.layout.group])

    @cached_property
    def _tree(self):
        """The points in a tree, and a face at each."""
        faces = self.carrier.mesh.faces
        face_of = np.zeros(len(self.carrier.mesh.points), np.int64)
        face_of[faces.ravel()] = np.repeat(np.arange(len(faces), dtype=np.int64), 3)
        return cKDTree(self.carrier.mesh.points), face_of

    def _nearest(self, points):
        """Closest points (n, 3) and interpolated unit normals there (n, 3)."""
        points = np.ascontiguousarray(points, float)
        tree, face_of = self._tree
        _, vertex = tree.query(points)
        faces, barycentric = self.carrier.locate(points, face_of[vertex])
        v, w = barycentric[:, 0], barycentric[:, 1]
        weights = np.stack([1.0 - v - w, v, w], axis=1)
        corners = self.carrier.mesh.points[self.carrier.mesh.faces[faces]]
        normals = np.einsum("nk,nkd->nd", weights, self.carrier.normals[faces])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        return np.einsum("nk,nkd->nd", weights, corners), normals

    def value(self, points):
        """Signed distance (n,) to the triangles."""
        return self.value_and_gradient(points)[0]

    def gradient(self, points):
        """Interpolated unit normals (n, 3) at the nearest points."""
        return self._nearest(points)[1]

    def value_and_gradient(self, points):
        """Signed distance (n,) and interpolated normals (n, 3)."""
        foot, normals = self._nearest(points)
        away = np.asarray(points) - foot
        side = np.where(np.einsum("ij,ij->i", away, normals) < 0.0, -1.0, 1.0)
        return side * np.linalg.norm(away, axis=1), normals

    def project(self, points):
        """Nearest points (n, 3) and interpolated unit normals (n, 3)."""
        return self._nearest(points)
