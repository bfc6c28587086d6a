"""The input's own triangles as a reference surface: closest point, Phong normals."""

import numpy as np
from scipy.spatial import cKDTree

from meshes.quality import corner_normals
from meshes.topology import corner_groups, edge_table, feature_mask
from remesh.carrier import make_carrier


class TriangleSurface:
    """The triangles of a mesh as an ImplicitSurface, all labels at once.

    S is the distance to the nearest triangle, negative inside; its gradient is the interpolated
    normal there. Fidelity to the input as it is, where an interpolant would round or overshoot.

    Parameters
    ----------
    mesh : TriMesh
        Manifold and oriented outward.
    normal_smoothing : int
        How often the normals are averaged with their neighbours' (for jagged input).
    """

    def __init__(self, mesh, normal_smoothing=0):
        self.carrier = make_carrier(mesh, smoothed_corner_normals(mesh, normal_smoothing))
        faces = self.carrier.mesh.faces
        self._tree = cKDTree(self.carrier.mesh.points)
        self._face_of = np.zeros(len(self.carrier.mesh.points), np.int64)
        self._face_of[faces.ravel()] = np.repeat(np.arange(len(faces), dtype=np.int64), 3)

    def _nearest(self, points):
        """Closest points (n, 3) and interpolated unit normals there (n, 3)."""
        points = np.ascontiguousarray(points, float)
        _, vertex = self._tree.query(points)
        faces, barycentric = self.carrier.locate(points, self._face_of[vertex])
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


def smoothed_corner_normals(mesh, rounds):
    """Corner normals (m, 3, 3), averaged `rounds` times with the neighbours within each patch."""
    normals = corner_normals(mesh)
    if rounds == 0:
        return normals
    return averaged(normals, *sectors(mesh), rounds)


def sectors(mesh):
    """Number (m, 3) of the smooth sector at each face corner, and how many there are."""
    table = edge_table(mesh.faces)
    return corner_groups(mesh.faces, ~feature_mask(mesh, table), table)


def averaged(normals, group, count, rounds):
    """Corner normals (m, 3, 3) averaged over the triangles around each corner group."""
    flat = group.ravel()
    for _ in range(rounds):
        per_face = normals.sum(axis=1)
        total = np.stack(
            [np.bincount(flat, np.repeat(per_face[:, k], 3), minlength=count) for k in range(3)], 1
        )
        total += np.stack(
            [np.bincount(flat, normals[..., k].ravel(), minlength=count) for k in range(3)], 1
        )
        total /= np.linalg.norm(total, axis=1)[:, None]
        normals = total[group]
    return normals
