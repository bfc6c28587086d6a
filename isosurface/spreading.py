"""Crossings slid along the surface, away from the nodes of the mesh: triangles without slivers.

A crossing close to a node has others close to it, on the node's other edges, and their triangles
are slivers. Each slides within the surface as far as keeps it a share of its edge away from the
node; faces and topology stay as they are.
"""

import numpy as np

from meshes import InvalidCase
from meshes.quality import normalised

# Share of its distance to a plane that a sliding crossing must keep.
LEAST_DISTANCE = 0.2


def check_spread(spread):
    """Raise InvalidCase if the share is not in [0, 0.5)."""
    if not 0.0 <= spread < 0.5:
        raise InvalidCase(f"spread must lie in [0, 0.5), got {spread}")


def spread_crossings(field, edges, t, spread, fits):
    """Positions (k, 3) [m] of crossings that keep a share of their edge away from its ends.

    Parameters
    ----------
    field : PhaseField
    edges : (k, 2) int array
    t : (k,) float array
        Where the level is crossed.
    spread : float
        Share of an edge, below 0.5.
    fits : AngleFits

    Returns
    -------
    positions : (k, 3) float array [m]
        Those on edges of the domain's boundary, or without a valid fit, are where they were; the
        others follow the surface to second order.
    """
    mesh = field.mesh
    along = mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]]
    exact = mesh.points[edges[:, 0]] + t[:, None] * along
    slide = (np.clip(t, spread, 1.0 - spread) - t)[:, None] * along
    boundary = np.zeros(len(mesh.points), dtype=bool)
    boundary[mesh.facets] = True
    slide[boundary[edges].all(axis=1) | ~fits.valid] = 0.0
    gradient = fits.gradients + np.einsum("kij,kj->ki", fits.hessians, exact - fits.at)
    normal = normalised(gradient)
    slide -= normal * np.einsum("ki,ki->k", normal, slide)[:, None]
    bend = np.einsum("ki,kij,kj->k", slide, fits.hessians, slide)
    steepness = np.linalg.norm(gradient, axis=1)
    down = np.divide(0.5 * bend, steepness, out=np.zeros(len(t)), where=steepness > 0.0)
    length = np.linalg.norm(slide, axis=1)
    slide -= normal * np.clip(down, -0.5 * length, 0.5 * length)[:, None]
    slide[_leaves_planes(mesh, exact, slide)] = 0.0
    return exact + slide


def _leaves_planes(mesh, exact, slide):
    """Which crossings (k,) a slide would bring close to, or across, a plane of the boundary."""
    leaves = np.zeros(len(exact), dtype=bool)
    planes = [(p.plane.normal, p.plane.offset) for p in mesh.patches if p.plane is not None]
    planes += [(np.eye(3)[plane.axis], plane.offset) for plane in mesh.symmetry]
    for normal, offset in planes:
        before = exact @ np.asarray(normal) - offset
        after = (exact + slide) @ np.asarray(normal) - offset
        leaves |= after * np.sign(before) < LEAST_DISTANCE * np.abs(before)
    return leaves
