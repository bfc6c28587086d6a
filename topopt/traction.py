"""Tractions and springs on a part of the boundary that the mesh need not follow.

Each facet is clipped to the region. On a piece the traction q is constant and the shape functions
are linear, so int q N_i = q A N_i(centroid) exactly: the total force and its moments are those of
the patch, on any mesh. Likewise int N_i N_j is known exactly from the values at a piece's corners.
"""

import numpy as np

from topopt.problem import Springs
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
    region : Region
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


def facet_mass(points, facets, region, tolerance):
    """Exact mass matrix of the P1 functions on the part of the facets inside a region.

    Parameters
    ----------
    points : (n, 3) float array [m]
    facets : (b, 3) int array
    region : Region
    tolerance : float [m]
        See `topopt.regions.clip_triangles`.

    Returns
    -------
    pairs : (k, 2) int array
        Nodes i and j; a pair occurs once for every piece.
    mass : (k,) float array [m^2]
        int N_i N_j over the piece.

    Notes
    -----
    For linear f and g on a triangle with area A and corners c,
    int f g = A / 12 (sum_c f_c sum_c g_c + sum_c f_c g_c).
    """
    pieces = clip_triangles(points[facets], region, tolerance)
    area = facet_areas(points, facets)[pieces.parent] * pieces.share
    corner = pieces.barycentric  # (k, c, i): N_i at corner c
    total = corner.sum(axis=1)
    local = total[:, :, None] * total[:, None, :] + np.einsum("kci,kcj->kij", corner, corner)
    nodes = facets[pieces.parent]
    pairs = np.stack([np.repeat(nodes, 3, axis=1).ravel(), np.tile(nodes, 3).ravel()], axis=1)
    return pairs, (local * (area / 12.0)[:, None, None]).ravel()


def merged_springs(rows, columns, blocks, n_points):
    """Springs in which every pair of nodes occurs once, from blocks (k, 3) to be added up."""
    key = rows.astype(np.int64) * n_points + columns
    pairs, place = np.unique(key, return_inverse=True)
    summed = [np.bincount(place, blocks[:, axis], len(pairs)) for axis in range(3)]
    return Springs(*np.divmod(pairs, n_points), np.stack(summed, axis=1))
