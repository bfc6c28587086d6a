"""Tips of horns and ears: points that a collapse or a smoothing step would cut off.

A tip is a vertex from which the surface falls away on all sides within one edge length, in one
sense: ridges, rims and cylinders are none, because the surface goes straight on along them. Tips
are found on the carrier beforehand and kept as corners; afterwards it is too late, because no
triangle near a lost tip agrees with the surface's normals there.
"""

import numpy as np
from scipy.spatial import cKDTree

from meshes.topology import edge_table
from remesh.connectivity import CORNER, INTERIOR, KIND

STEEP = 0.35  # least fall over distance, in every direction, at about one edge length
CURVED = 0.5  # least curvature along every edge, in units of 1 / length
NEAR, FAR = 0.8, 1.25  # the distances looked at, in units of the length


def keep_tips(work, length):
    """Make corners of the tips of a work mesh that is still its carrier; return how many.

    Parameters
    ----------
    work : WorkMesh
    length : float [unit of the points]
        3D edge length that the result will have.
    """
    mesh = work.carrier.mesh
    normals = work.rows[: len(mesh.points), 3:6]
    candidates = curved_all_round(mesh, normals, length)
    candidates = candidates[work.links[candidates, KIND] == INTERIOR]
    tips = sharpest(mesh.points, normals, candidates, length)
    work.links[tips, KIND] = CORNER
    return len(tips)


def curved_all_round(mesh, normals, length):
    """Vertices (k,) from which all edges bend away to the same side by at least CURVED."""
    ends = edge_table(mesh.faces).edges
    ends = np.concatenate([ends, ends[:, ::-1]])
    step = mesh.points[ends[:, 1]] - mesh.points[ends[:, 0]]
    square = np.einsum("ij,ij->i", step, step)
    rise = 2.0 * np.einsum("ij,ij->i", step, normals[ends[:, 0]])
    bend = rise * length / np.where(square > 0.0, square, np.inf)
    highest, lowest = np.full(len(mesh.points), -np.inf), np.full(len(mesh.points), np.inf)
    np.maximum.at(highest, ends[:, 0], bend)
    np.minimum.at(lowest, ends[:, 0], bend)
    return np.flatnonzero((highest < -CURVED) | (lowest > CURVED))


def sharpest(points, normals, candidates, length):
    """Of the candidates those with a steep fall all round, one per neighbourhood."""
    tree = cKDTree(points)
    fall = np.zeros(len(candidates))
    for i, v in enumerate(candidates):
        around = np.array(tree.query_ball_point(points[v], FAR * length))
        step = points[around] - points[v]
        distance = np.linalg.norm(step, axis=1)
        ring = distance > NEAR * length
        if ring.any():
            slope = step[ring] @ normals[v] / distance[ring]
            fall[i] = max(-slope.max(), slope.min())
    chosen = []
    for i in np.argsort(-fall, kind="stable"):
        if fall[i] < STEEP:
            break
        v = candidates[i]
        if all(np.linalg.norm(points[v] - points[w]) > length for w in chosen):
            chosen.append(v)
    return np.array(chosen, int)
