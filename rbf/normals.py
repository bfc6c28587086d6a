"""Normals at the vertices of a mesh, or at bare points."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from meshes import InvalidMesh
from rbf.spacing import check_finite


def face_normals(points, faces):
    """Unit normals (m, 3) of triangles; 0 where a triangle has no area."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    length = _lengths(normals)
    return normals / np.where(length > 0.0, length, 1.0)[:, None]


def _lengths(vectors):
    """Lengths (n,) of vectors (n, 3)."""
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def vertex_normals(mesh):
    """Unit vertex normals: face normals weighted by the inverse distance to the face's centroid.

    Parameters
    ----------
    mesh : TriMesh

    Returns
    -------
    normals : (n, 3) float array
        NaN at vertices that belong to no face with an area, or whose faces cancel out.

    Notes
    -----
    Thesis eq. (3.1).
    """
    return weighted_normals(mesh.points, mesh.faces)


def weighted_normals(points, faces):
    """`vertex_normals` of arrays: points (n, 3), faces (m, 3)."""
    normals = face_normals(points, faces)
    a, b, c = (points[faces[:, k]] for k in range(3))
    centroids = (a + b + c) / 3.0
    usable = normals.any(axis=1)
    total = np.zeros_like(points)
    scale = np.zeros(len(points))
    for corner, place in zip(faces.T, (a, b, c)):
        distance = _lengths(place - centroids)
        # a face shrunk to a point has no normal; its weight is then of no consequence
        weight = np.divide(1.0, distance, out=np.zeros_like(distance), where=distance > 0.0)
        weight *= usable
        scale += np.bincount(corner, weight, len(points))
        for axis in range(3):
            total[:, axis] += np.bincount(corner, weight * normals[:, axis], len(points))
    length = _lengths(total)
    length[~(length > 1e-9 * scale)] = np.nan
    return total / length[:, None]


def pca_normals(points, neighbours=12):
    """Unit normals of a point cloud, consistently oriented.

    The normal is the direction of least variance among the nearest neighbours; the signs follow
    a minimum spanning tree of the neighbourhood graph, whose edges cost 1 - |n_i.n_j|, starting
    at a point that is extreme in z, where the normal must point up.

    Parameters
    ----------
    points : (n, 3) float array
    neighbours : int

    Returns
    -------
    normals : (n, 3) float array
        Outward for a closed surface whose pieces lie apart.

    Raises
    ------
    InvalidMesh
        If points are not finite, fewer than three, or all on one line.

    Notes
    -----
    Thesis section 2.3.5 (cotangent plane); orientation after Hoppe et al. 1992.
    """
    points = check_finite(points, "points")
    if len(points) < 3:
        raise InvalidMesh(f"normals need at least 3 points, got {len(points)}: give the normals")
    count = min(neighbours, len(points) - 1)
    _, near = cKDTree(points).query(points, k=count + 1)
    offsets = points[near] - points[near].mean(axis=1, keepdims=True)
    scale = np.abs(offsets).max() or 1.0
    offsets = offsets / scale
    spread, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))
    straight = spread[:, 1] <= 1e-12 * spread[:, 2]
    if straight.any():
        raise InvalidMesh(
            f"{int(straight.sum())} points (the first is {int(straight.argmax())}) and their "
            f"{count} nearest neighbours lie on a line, so no normal can be told: give the "
            "normals, or more neighbours"
        )
    return _orient(points, axes[:, :, 0], near)


def _orient(points, normals, near):
    """Flip normals so that neighbours agree and each connected piece points outward."""
    n, count = near.shape
    i = np.repeat(np.arange(n), count - 1)
    j = near[:, 1:].reshape(-1)
    cost = 1.0 - np.abs(np.einsum("ij,ij->i", normals[i], normals[j])) + 1e-9
    graph = coo_matrix((cost, (i, j)), shape=(n, n)).tocsr()
    graph = graph.maximum(graph.T)
    tree = minimum_spanning_tree(graph)
    pieces, piece = connected_components(tree, directed=False)
    normals = normals.copy()
    for root in _top_points(points, piece, pieces):
        if normals[root, 2] < 0.0:
            normals[root] *= -1.0
        order, parent = breadth_first_order(tree, root, directed=False)
        for child in order[1:]:
            if normals[child] @ normals[parent[child]] < 0.0:
                normals[child] *= -1.0
    return normals


def _top_points(points, piece, pieces):
    """The highest point of each connected piece."""
    order = np.lexsort((-points[:, 2], piece))
    return order[np.searchsorted(piece[order], np.arange(pieces))]
