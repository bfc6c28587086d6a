"""The proof that two surfaces keep within a bound, renewed only where one of them changed."""

import numpy as np

from meshes.box_tree_kernels import mark_touching
from meshes.closest_point import ClosestPoint
from meshes.distance_bound import face_bounds
from meshes.quality import face_normals

SLACK = 1e-9  # degrees
RIGHT_ANGLE = 90.0
SIMILAR = 30.0  # degrees: bounds of normals below need not be sharp


class HeldBounds:
    """Bounds of a surface's faces by their numbers; infinite where there is none yet.

    Attributes
    ----------
    upper : (m,) float array
    angle : (m,) float array [degrees]
    place : (m, 3) float array
        As of `meshes.distance_bound.FaceBounds`.
    """

    def __init__(self, count):
        self.upper = np.full(count, np.inf)
        self.angle = np.full(count, np.inf)
        self.place = np.zeros((count, 3))

    def reserve(self, count):
        """Make room for faces up to a number."""
        more = count - len(self.upper)
        if more > 0:
            self.upper = np.append(self.upper, np.full(more, np.inf))
            self.angle = np.append(self.angle, np.full(more, np.inf))
            self.place = np.append(self.place, np.zeros((more, 3)), axis=0)

    def put(self, numbers, bounds):
        """Take over the bounds (FaceBounds) of some faces (k,)."""
        self.upper[numbers] = bounds.upper
        self.angle[numbers] = bounds.angle
        self.place[numbers] = bounds.place

    def missing(self, limits):
        """Faces (m,) bool that are not within the limits' error and angle."""
        return (self.upper > limits.error) | (self.angle > limits.normal_angle + SLACK)


class BoundProof:
    """Bounds for all faces of the work mesh and of its original.

    A face of the work mesh is compared again when a corner of it moved. A face of the original was
    proved to be near faces of the work mesh: it is compared again when one of those that are gone
    lay within the bound of it, or when the proof had failed.

    Parameters
    ----------
    work : BoundedMesh
    limits : BoundLimits
    """

    def __init__(self, work, limits):
        self.work, self.limits = work, limits
        self.source = HeldBounds(len(work.source.faces))
        self.faces = HeldBounds(0)
        self.corners = np.zeros((0, 9))  # of the work mesh's faces, when they were compared
        self.compared = 0  # faces, in all

    def renew(self):
        """Compare what changed; returns the work mesh as TriMesh, and its faces' numbers there."""
        work, limits = self.work, self.limits
        mesh, alive = work.to_mesh()
        fresh, gone = self._note_changes(mesh, alive)
        self.search = ClosestPoint(mesh.points, mesh.faces)
        stale = self.source.missing(limits)
        if len(gone):
            stale |= self._touched(gone)
        stale = np.flatnonzero(stale)
        options = (limits.error, limits.error, min(limits.normal_angle, SIMILAR))
        self.faces.put(alive[fresh], face_bounds(mesh, work.search, *options, chosen=fresh))
        self.source.put(stale, face_bounds(work.source, self.search, *options, chosen=stale))
        self.compared += len(fresh) + len(stale)
        self.mesh, self.alive = mesh, alive
        return mesh, alive

    def _note_changes(self, mesh, alive):
        """Faces (k,) of the mesh that are new, and old corners (j, 9) of those that are gone."""
        count = max(int(self.work.counts[1]), len(self.corners))
        more = count - len(self.corners)
        self.corners = np.append(self.corners, np.full((more, 9), np.nan), axis=0)
        self.faces.reserve(count)
        now = np.full((count, 9), np.nan)
        now[alive] = mesh.points[mesh.faces].reshape(-1, 9)
        same = (now == self.corners).all(axis=1)
        gone = self.corners[~same & np.isfinite(self.corners[:, 0])]
        self.corners = now
        ended = ~same & np.isnan(now[:, 0])
        self.faces.upper[ended] = self.faces.angle[ended] = -np.inf
        return np.flatnonzero(~same[alive]), gone

    def _touched(self, gone):
        """Faces (m,) bool of the original that may have been proved by triangles (j, 9)."""
        search = self.work.search
        corners = gone.reshape(-1, 3, 3)
        reach = self.limits.error
        boxes = np.concatenate([corners.min(axis=1) - reach, corners.max(axis=1) + reach], axis=1)
        marks = np.zeros(len(self.source.upper), bool)
        mark_touching(boxes, search.tree, marks)
        result = np.empty_like(marks)
        result[search.order] = marks
        return result

    @property
    def proved(self):
        """No point of either surface is farther from the other."""
        return float(max(self.source.upper.max(), self.faces.upper.max()))

    @property
    def normal_angle(self):
        """Every point of either has a point of the other in reach whose normal is as near [deg]."""
        return float(max(self.source.angle.max(), self.faces.angle.max()))

    def inverted(self):
        """Faces (m,) bool of the mesh that lie against the original.

        Against its interpolated normal and that of its face, both closest to their centroid; or
        if at some point of them all its normals within the bound differ by more than a right
        angle. Jagged originals have faces of their own against their interpolated normals.
        """
        smooth, flat = self._cosines()
        return ((smooth < 0.0) & (flat < 0.0)) | self.far_normals()

    def against(self):
        """Faces (m,) bool that are inverted, or lie against one of the two normals."""
        smooth, flat = self._cosines()
        return (smooth < 0.0) | (flat < 0.0) | self.far_normals()

    def far_normals(self):
        """Faces (m,) bool with a point that has no normal within a right angle and the bound."""
        return self.faces.angle[self.alive] > RIGHT_ANGLE

    def _cosines(self):
        """Products (m,) of faces' normals with the original's closest to their centroids."""
        mesh, work = self.mesh, self.work
        normals = face_normals(mesh.points, mesh.faces)
        found, weights, _ = work.search.query(mesh.points[mesh.faces].mean(axis=1))
        place = work.search.position[found]
        corners = work.reference[2][place].reshape(-1, 3, 3)
        smooth = np.einsum("nk,nkd,nd->n", weights, corners, normals)
        return smooth, np.einsum("nd,nd->n", work.search.tree[3][place, 9:], normals)

    def missed(self):
        """Where the bounds are not proved, the worst first.

        Returns
        -------
        faces : (k,) int array
            Faces of the work mesh.
        places : (k, 3) float array
            Points of them.
        targets : (k, 3) float array
            Points of the original: one of the two is the other's closest.
        """
        original, search = self.work.source, self.work.search
        bad = np.flatnonzero(self.faces.missing(self.limits))
        near_bad = closest(search, original, self.faces.place[bad])[1]
        far = np.flatnonzero(self.source.missing(self.limits))
        near, near_far = closest(self.search, self.mesh, self.source.place[far])
        faces = np.concatenate([bad, self.alive[near]])
        places = np.concatenate([self.faces.place[bad], near_far])
        targets = np.concatenate([near_bad, self.source.place[far]])
        badness = np.concatenate([self.faces.upper[bad], self.source.upper[far]])
        order = np.argsort(-badness, kind="stable")
        return faces[order], places[order], targets[order]


def closest(search, mesh, points):
    """Faces (k,) of a mesh closest to points (k, 3), and the points of them."""
    found, weights, _ = search.query(points)
    return found, np.einsum("nk,nkd->nd", weights, mesh.points[mesh.faces[found]])
