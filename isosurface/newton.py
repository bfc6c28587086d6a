"""Vertices on the level by Newton's method on the field around them, off the mesh's edges."""

import numpy as np

from isosurface.crossing import LARGEST_REACH, profile_angle
from isosurface.local_quadratics import NEIGHBOURS, local_quadratics

STEPS = 2
LONGEST = 0.5  # step, in mean cut edges


def newton_vertices(field, edges, points, level):
    """Crossings moved onto the level of quadratics that are fitted around themselves.

    Parameters
    ----------
    field : PhaseField
    edges : (k, 2) int array
        The cut edges.
    points : (k, 3) float array [m]
        The crossings.
    level : float

    Returns
    -------
    (k, 3) float array
        Crossings on edges of the domain's boundary, and those around which too few nodes lie
        within the interface, stay where they are.

    Notes
    -----
    The fitted field is the angle of the profile, see `crossing`.
    """
    moved = np.array(points)
    telling = (field.values > 0.0) & (field.values < 1.0)
    free = ~_on_boundary(field.mesh, edges)
    if np.count_nonzero(telling) < NEIGHBOURS or not free.any():
        return moved
    ends = field.mesh.points[edges]
    size = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean()
    nodes, angles = field.mesh.points[telling], profile_angle(field.values[telling])
    for _ in range(STEPS):
        fits = local_quadratics(nodes, angles, moved[free])
        steep = np.maximum((fits.gradients**2).sum(axis=1), np.finfo(float).tiny)
        step = ((profile_angle(level) - fits.values) / steep)[:, None] * fits.gradients
        length = np.linalg.norm(step, axis=1)
        told = (fits.reach <= LARGEST_REACH * size) & (length <= LONGEST * size)
        moved[free] += np.where(told[:, None], step, 0.0)
    return moved


def _on_boundary(mesh, edges):
    """Which edges (k,) are edges of boundary facets."""
    size = len(mesh.points)
    sides = np.sort(mesh.facets[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges = np.sort(edges, axis=1).astype(np.int64)
    return np.isin(edges @ [size, 1], sides.astype(np.int64) @ [size, 1])
