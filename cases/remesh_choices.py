"""What `python -m remesh` chooses by itself: sigma, and the surface the result is to lie on."""

import numpy as np

from meshes.edges import edge_table
from meshes.quality import face_areas

SIGMA = 0.05  # of the diagonal, on a smooth surface
NOISE_SHARE = 0.2  # of an edge: how much the noise of the normals may add to a 6D length
FINER = 0.75  # of the input's edges: with shorter ones the interpolant is chosen
ROUGH = 0.06  # radians: noisier normals are worth a remark


def expected_edge(mesh, vertices, edge_length):
    """Mean edge length [unit of the points] that a target leads to, if sigma were 0."""
    if edge_length is not None:
        return edge_length
    if vertices is None:
        return own_edge(mesh)
    return float(np.sqrt(2.0 / np.sqrt(3.0) * face_areas(mesh.points, mesh.faces).sum() / vertices))


def own_edge(mesh):
    """Mean edge length of a surface [unit of the points]."""
    ends = mesh.points[edge_table(mesh.faces).edges]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean())


def default_sigma(mesh, edge, noise):
    """The weight of the normals [unit of the points]: 0.05 diagonals, less on a noisy surface.

    In the embedding (x, sigma n) the noise of the normals is noise of sigma times as much, which
    is kept below a fifth of an edge. (Below the input's own edges it shrinks with the distance.)

    Parameters
    ----------
    mesh : TriMesh
    edge : float
        The edge length aimed at.
    noise : float [radians]
        See `meshes.normal_noise`.
    """
    largest = SIGMA * mesh.diagonal
    if noise == 0.0:
        return largest
    return min(largest, NOISE_SHARE * max(edge, own_edge(mesh)) / noise)


def choose_reference(request, mesh, edge):
    """Return "rbf" or "triangles" as asked for, or as suits the surface and the edge length.

    A finer mesh than the input would show its flat triangles, so that a smooth surface through
    its vertices is better; a coarser one can follow the triangles, and so lies closer to them.
    """
    if request.reference != "auto":
        return request.reference
    if request.smooth:
        return "triangles"
    return "rbf" if edge < FINER * own_edge(mesh) or request.algorithm == "thesis" else "triangles"
