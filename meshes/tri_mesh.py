"""A triangulated surface with labelled faces and feature curves."""

from dataclasses import dataclass

import numpy as np

from meshes.arrays import frozen
from meshes.patch import Patch


@dataclass(frozen=True, eq=False)
class TriMesh:
    """Triangles, the patch each belongs to, and the curves that must be kept.

    Parameters
    ----------
    points : (n, 3) float array [m, or the file's unit]
    faces : (m, 3) int32 array
        Oriented outward (counter-clockwise seen from outside).
    face_labels : (m,) int32 array, optional
        Index into `labels` of each face; all 0 if not given.
    labels : tuple of Patch, optional
        What the labels mean; planar caps carry their plane. One smooth "surface" if not given.
    feature_edges : (k, 2) int32 array, optional
        Edges of curves that are kept (label boundaries, creases, open boundaries).
    """

    points: np.ndarray
    faces: np.ndarray
    face_labels: np.ndarray | None = None
    labels: tuple[Patch, ...] = (Patch("surface"),)
    feature_edges: np.ndarray | None = None

    def __post_init__(self):
        put = object.__setattr__
        count = len(self.faces)
        labels = np.zeros(count, np.int32) if self.face_labels is None else self.face_labels
        edges = np.zeros((0, 2), np.int32) if self.feature_edges is None else self.feature_edges
        put(self, "points", frozen(self.points, np.float64, (None, 3), "points"))
        put(self, "faces", frozen(self.faces, np.int32, (None, 3), "faces"))
        put(self, "face_labels", frozen(labels, np.int32, (count,), "face_labels"))
        put(self, "labels", tuple(self.labels))
        put(self, "feature_edges", frozen(edges, np.int32, (None, 2), "feature_edges"))

    @property
    def diagonal(self):
        """Length of the bounding box's diagonal, in the unit of the points."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0))) if len(self.points) else 0.0

    def with_points(self, points):
        """Return the same connectivity with other vertex positions (n, 3)."""
        return TriMesh(points, self.faces, self.face_labels, self.labels, self.feature_edges)
