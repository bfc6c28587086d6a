"""Values at the vertices of one surface, carried over to those of another."""

import numpy as np

from meshes.closest_point import ClosestPoint

UNIT = 1e-3  # vectors whose lengths differ from 1 by no more stay unit vectors
COLOURS = ("red", "green", "blue", "alpha", "rgb", "rgba", "color", "colors", "colour", "colours")


def interpolate(mesh, data, points):
    """Values at the points, from the closest points of a surface.

    Parameters
    ----------
    mesh : TriMesh
        It need not be manifold: along a seam, where vertices are doubled, each side keeps its own.
    data : mapping of str to (n,) or (n, k) array
        At the vertices of the mesh.
    points : (p, 3) float array

    Returns
    -------
    dict of str to (p,) or (p, k) array
        Of the same types. Real numbers and colours are interpolated linearly on the triangles;
        whole numbers (numbers of things) are those of the nearest corner. Where all vectors have
        length 1, the results have too.

    Raises
    ------
    InvalidMesh
        If the mesh has no faces, or points of faces that are not finite.
    """
    if not data:
        return {}
    faces, weights, _ = ClosestPoint(mesh.points, mesh.faces).query(points)
    corners = mesh.faces[faces]
    nearest = corners[np.arange(len(corners)), np.argmax(weights, axis=1)]
    return {
        name: _carried(name, np.asarray(values), corners, weights, nearest)
        for name, values in data.items()
    }


def _carried(name, values, corners, weights, nearest):
    """One array at the points."""
    whole = values.dtype.kind in "iub"
    if whole and not (name.lower() in COLOURS and values.dtype == np.uint8):
        return values[nearest]
    mixed = np.einsum("pk,pk...->p...", weights, values[corners].astype(float))
    if whole:
        return np.clip(np.rint(mixed), 0, 255).astype(values.dtype)
    if values.ndim == 2 and values.shape[1] == 3 and _all_unit(values):
        length = np.linalg.norm(mixed, axis=1, keepdims=True)
        mixed = np.where(length > 0, mixed / np.where(length > 0, length, 1.0), values[nearest])
    return mixed.astype(values.dtype)


def _all_unit(vectors):
    lengths = np.linalg.norm(vectors, axis=1)
    return len(lengths) > 0 and bool(np.all(np.abs(lengths - 1.0) <= UNIT))
