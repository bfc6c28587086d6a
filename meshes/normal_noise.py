"""How rough a surface is: the part of its normals that does not vary smoothly."""

import numpy as np

from meshes.edges import edge_table
from meshes.quality import vertex_normals


def normal_noise(mesh):
    """Standard deviation [radians] of the vertex normals about smoothly varying ones.

    Around every vertex the normals of its neighbours are fitted by a linear function of the
    position, which curvature alone would follow; what is left is noise. The median over the
    vertices that lie on no crease and no open boundary.

    Parameters
    ----------
    mesh : TriMesh
        Manifold and oriented; its feature edges are its creases (see `meshes.features`).

    Returns
    -------
    float
        0 if no vertex has four neighbours.
    """
    normals = vertex_normals(mesh.points, mesh.faces)
    table = edge_table(mesh.faces)
    ends = np.concatenate([table.edges, table.edges[:, ::-1]])
    here, there = ends.T
    step = mesh.points[there] - mesh.points[here]
    length = np.linalg.norm(step, axis=1)
    size = np.bincount(here, length, minlength=len(normals))
    count = np.bincount(here, minlength=len(normals))
    step = step * (count / np.where(size > 0, size, 1.0))[here, None]  # about 1 long
    step -= np.einsum("ed,ed->e", step, normals[here])[:, None] * normals[here]
    change = normals[there] - normals[here]
    left = change - np.einsum("eij,ei->ej", _slopes(here, step, change, normals)[here], step)
    squares = np.bincount(here, np.einsum("ed,ed->e", left, left), minlength=len(normals))
    usable = count >= 4
    usable[table.edges[table.count != 2]] = False
    usable[mesh.feature_edges] = False
    if not usable.any():
        return 0.0
    return float(np.sqrt(np.median(squares[usable] / (2 * (count[usable] - 2))) / 2))


def _slopes(here, step, change, normals):
    """Least-squares slopes (n, 3, 3) of the normals along tangential steps."""
    count = len(normals)
    weight = np.einsum("ei,ej->eij", step, step).reshape(-1, 9)
    right = np.einsum("ei,ej->eij", step, change).reshape(-1, 9)
    gather = [np.bincount(here, column, minlength=count) for column in (*weight.T, *right.T)]
    matrix = np.stack(gather[:9], axis=1).reshape(-1, 3, 3)
    matrix += np.einsum("ni,nj->nij", normals, normals)  # tangential steps leave it singular
    matrix += 1e-9 * np.eye(3)
    return np.linalg.solve(matrix, np.stack(gather[9:], axis=1).reshape(-1, 3, 3))
