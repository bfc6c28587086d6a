"""Slow, obvious twins of the point location and of the transfer between meshes."""

import numpy as np


def barycentric(points, tets, point):
    """Weights (m, 4) of a point in every tet."""
    corners = points[tets]
    weights = np.empty((len(tets), 4))
    for e, (a, b, c, d) in enumerate(corners):
        weights[e, 1:] = np.linalg.solve(np.stack([b - a, c - a, d - a], axis=1), point - a)
    weights[:, 0] = 1.0 - weights[:, 1:].sum(axis=1)
    return weights


def value_at(mesh, values, point):
    """A P1 function at a point: by the tet in which the least weight is largest."""
    weights = barycentric(mesh.points, mesh.tets, point)
    tet = int(weights.min(axis=1).argmax())
    return float(weights[tet] @ values[mesh.tets[tet]])


def integral(mesh, values):
    """int v of a P1 function."""
    corners = mesh.points[mesh.tets]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6.0
    return float(volumes @ values[mesh.tets].mean(axis=1))
