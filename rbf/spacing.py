"""How far apart points lie, and what is done about those that coincide."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from meshes import InvalidCase, InvalidMesh

SUPPORT_PER_SPACING = 6.0  # support radius in spacings
WELD_PER_SPACING = 1e-4  # points nearer than this (in spacings) are one
CLOSE_PER_SPACING = 0.02  # points nearer than this may contradict each other
DAMPING = 1e3  # ridge per squared contradiction (in support radii)
SAMPLES = 4000  # points whose neighbours are looked at


def check_finite(array, name, width=3):
    """Return the array as contiguous floats (n, width).

    Raises
    ------
    InvalidMesh
        If it is empty, has another shape, or holds NaN or infinity.
    """
    array = np.ascontiguousarray(array, dtype=float)
    shape_ok = array.ndim == 1 if width == 1 else array.ndim == 2 and array.shape[1] == width
    if not shape_ok or not len(array):
        wanted = "(n,)" if width == 1 else f"(n, {width})"
        raise InvalidMesh(f"{name} must have shape {wanted} with n > 0, got {array.shape}")
    bad = ~np.isfinite(array.reshape(len(array), -1)).all(axis=1)
    if bad.any():
        raise InvalidMesh(
            f"{name} has {int(bad.sum())} rows that are not finite (the first is row "
            f"{int(bad.argmax())}): remove or repair them"
        )
    return array


def point_spacing(points, neighbours=12, instead="support_radius"):
    """Robust mean distance between neighbouring points of a surface [unit of the points].

    The edge length of the triangular lattice that has as many points within the distance of the
    12th neighbour; the median over (a sample of) all points, so that single long edges, clusters
    and near-duplicates do not matter.

    Raises
    ------
    InvalidCase
        If there are not two distinct points; says to give the parameter named `instead`.
    """
    count = min(neighbours, len(points) - 1)
    tree = cKDTree(points)
    sample = points[:: max(len(points) // SAMPLES, 1)]
    while count > 0:
        reach = tree.query(sample, k=[count + 1])[0].ravel()
        spacing = float(np.median(reach)) * np.sqrt(2.0 * np.pi / np.sqrt(3.0) / (count + 0.5))
        if spacing > 0.0:
            return spacing
        if count == len(points) - 1:
            break
        count = min(4 * count, len(points) - 1)  # more than a dozen points fall together
    raise InvalidCase(
        "the spacing of the points cannot be told, because there are not two distinct ones: "
        f"give {instead}"
    )


def choose_support(points, support_radius=None):
    """The support radius asked for, or six spacings; (support radius, spacing).

    Raises
    ------
    InvalidCase
        If the radius is not positive, or there is no spacing to take it from.
    """
    if support_radius is None:
        spacing = point_spacing(points)
        return SUPPORT_PER_SPACING * spacing, spacing
    if not (np.isfinite(support_radius) and support_radius > 0.0):
        raise InvalidCase(f"support_radius must be positive and finite, got {support_radius}")
    return float(support_radius), float(support_radius) / SUPPORT_PER_SPACING


def weld(points, distance):
    """Clusters of points that nearly coincide.

    Parameters
    ----------
    points : (n, 3) float array
    distance : float
        Points at most this far apart become one.

    Returns
    -------
    kept : (k,) int array
        The first point of each cluster, increasing.
    cluster : (n,) int array
        Which of the kept ones each point became.

    Raises
    ------
    InvalidCase
        If the distance is negative or not finite.
    """
    if not 0.0 <= distance < np.inf:
        raise InvalidCase(f"weld_distance must be at least 0 and finite, got {distance}")
    pairs = cKDTree(points).query_pairs(distance, output_type="ndarray")
    if not len(pairs):
        everything = np.arange(len(points))
        return everything, everything
    graph = coo_matrix(
        (np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2
    )
    count, label = connected_components(graph, directed=False)
    first = np.full(count, len(points))
    np.minimum.at(first, label, np.arange(len(points)))
    kept = np.sort(first)
    return kept, np.searchsorted(kept, first[label])


def damping(points, normals, spacing, support_radius):
    """Ridge (n,) of points that contradict a close neighbour, 0 for all others.

    Two points much nearer than the spacing, one above the other along the normal, ask for a
    surface that turns on the spot; an interpolant obeys with waves of the size of the spacing.
    Where the height exceeds what a curvature of two over the spacing explains, both values may
    give way by about that height.
    """
    ridge = np.zeros(len(points))
    pairs = cKDTree(points).query_pairs(CLOSE_PER_SPACING * spacing, output_type="ndarray")
    if len(pairs):
        i, j = pairs.T
        apart = points[j] - points[i]
        height = np.maximum(
            np.abs(np.einsum("ij,ij->i", apart, normals[i])),
            np.abs(np.einsum("ij,ij->i", apart, normals[j])),
        )
        height[height * spacing <= np.einsum("ij,ij->i", apart, apart)] = 0.0
        for site in (i, j):
            np.maximum.at(ridge, site, DAMPING * (height / support_radius) ** 2)
    return ridge
