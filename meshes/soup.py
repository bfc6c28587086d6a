"""Faces that are being repaired: arrays, and where each vertex came from."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Soup:
    """Triangles of which nothing is known.

    Parameters
    ----------
    points : (n, 3) float array
    faces : (m, 3) int64 array
    labels : (m,) int array
        Number of each face's label.
    origin : (n,) int64 array
        A name for each vertex: copies of a vertex share it, new ones have negative names.
    turned : (m,) bool array
        Faces that have been turned over.
    """

    points: np.ndarray
    faces: np.ndarray
    labels: np.ndarray
    origin: np.ndarray
    turned: np.ndarray

    def keep(self, chosen):
        """The faces (m,) bool chosen."""
        return replace(
            self,
            faces=self.faces[chosen],
            labels=self.labels[chosen],
            turned=self.turned[chosen],
        )

    def turn(self, chosen):
        """With the faces (m,) bool chosen turned over."""
        faces = self.faces.copy()
        faces[chosen] = faces[chosen][:, [0, 2, 1]]
        return replace(self, faces=faces, turned=self.turned ^ chosen)

    def added(self, faces, labels):
        """With more faces (k, 3) and their labels (k,)."""
        return replace(
            self,
            faces=np.concatenate([self.faces, faces]),
            labels=np.concatenate([self.labels, labels]),
            turned=np.concatenate([self.turned, np.zeros(len(faces), dtype=bool)]),
        )


def soup_of(mesh):
    """The Soup of a TriMesh."""
    return Soup(
        points=mesh.points,
        faces=mesh.faces.astype(np.int64),
        labels=mesh.face_labels.astype(np.int64),
        origin=np.arange(len(mesh.points), dtype=np.int64),
        turned=np.zeros(len(mesh.faces), dtype=bool),
    )


def naming_a_vertex_twice(faces):
    """Faces (m,) bool with fewer than three different vertices."""
    return (faces == np.roll(faces, 1, axis=1)).any(axis=1)


def opposite_ends(faces, half_edges):
    """First and last vertex (h,) of half-edges."""
    flat = faces.ravel()
    return flat[half_edges], flat[half_edges + np.where(half_edges % 3 == 2, -2, 1)]
