"""Curves on a surface that are kept: between labels, creases, open boundaries."""

import numpy as np

from meshes.edges import edge_table


def label_boundaries(mesh):
    """Return the edges (k, 2) between faces of different labels, and all edges not shared by two.

    Parameters
    ----------
    mesh : TriMesh
    """
    table = edge_table(mesh.faces)
    return table.edges[_label_change(table, mesh.face_labels)]


def _label_change(table, labels):
    """Edges (e,) bool whose faces differ in label, or that have not exactly two faces."""
    change = table.count != 2
    inner, pairs = table.face_pairs()
    change[inner] = labels[pairs[:, 0]] != labels[pairs[:, 1]]
    return change


def feature_mask(mesh, table):
    """Edges (e,) bool across which nothing is smooth: feature edges, label changes, boundaries."""
    mask = _label_change(table, mesh.face_labels)
    if len(mesh.feature_edges):
        size = int(table.edges.max(initial=0)) + 1
        key = table.edges[:, 0].astype(np.int64) * size + table.edges[:, 1]
        low = mesh.feature_edges.min(axis=1).astype(np.int64)
        high = mesh.feature_edges.max(axis=1)
        wanted = (low * size + high)[high < size]
        index = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
        mask[index[key[index] == wanted]] = True
    return mask


def feature_corners(mesh, angle=45.0):
    """Return the vertices (k,) where feature curves end, meet, or turn by more than `angle`.

    Parameters
    ----------
    mesh : TriMesh
    angle : float [degrees]
        A curve that runs on straight turns by 0.
    """
    edges = np.asarray(mesh.feature_edges, dtype=np.int64)
    if len(edges) == 0:
        return np.zeros(0, dtype=np.int32)
    ends = np.concatenate([edges[:, 0], edges[:, 1]])
    others = np.concatenate([edges[:, 1], edges[:, 0]])
    order = np.argsort(ends, kind="stable")
    ends, others = ends[order], others[order]
    vertices, first, degree = np.unique(ends, return_index=True, return_counts=True)
    corner = degree != 2
    through = np.flatnonzero(~corner)
    here = mesh.points[vertices[through]]
    before = here - mesh.points[others[first[through]]]
    after = mesh.points[others[first[through] + 1]] - here
    corner[through] = angle_between(before, after) > np.radians(angle)
    return vertices[corner].astype(np.int32)


def angle_between(a, b):
    """Angle (n,) [radians] between vectors a and b (n, 3), accurate for small angles too."""
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.arctan2(sine, np.einsum("...k,...k->...", a, b))
