"""Consistent nodal forces of a traction on a part of the boundary that the mesh need not follow.

Each facet is clipped to the load's region. On a piece the traction q is constant and the shape
functions are linear, so int q N_i = q A N_i(centroid) exactly: the total force and its moments
are those of the patch, on any mesh.
"""

import numpy as np

from topopt.regions import clip_triangles


def facet_areas(points, facets):
    """Areas (b,) [m^2] of triangles (b, 3)."""
    a, b, c = (points[facets[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0


def traction_forces(points, facets, region, traction, tolerance):
    """Nodal forces of a constant traction on the part of the facets inside a region.

    Parameters
    ----------
    points : (n, 3) float array [m]
    facets : (b, 3) int array
        The facets that can carry load.
    region : Box
    traction : (3,) [Pa]
    tolerance : float [m]
        See `topopt.regions.clip_triangles`.

    Returns
    -------
    forces : (n, 3) float array [N]
        int N_i q over the patch; zero everywhere if no facet overlaps the region.
    area : float [m^2]
        Area of the patch.
    """
    pieces = clip_triangles(points[facets], region, tolerance)
    area = facet_areas(points, facets)[pieces.parent] * pieces.share
    weights = area[:, None] * pieces.centroid  # (k, 3): int N_i over each piece
    nodal = np.bincount(
        facets[pieces.parent].ravel(), weights=weights.ravel(), minlength=len(points)
    )
    return nodal[:, None] * np.asarray(traction, dtype=float), float(area.sum())
