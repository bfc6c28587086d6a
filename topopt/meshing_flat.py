"""The flat parts of a closed surface: where a mesh of its inside is snapped to planes.

A flat part is a set of faces connected across edges at which they do not turn. It counts as a
plane unless it looks like one facet of a curved surface: meeting a part that is at least half as
wide at a small angle.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from meshes.patch import Plane
from meshes.quality import area_vectors, normalised
from meshes.topology import angle_between, edge_table

FLAT_ANGLE = 1e-3  # rad: faces that turn by less across an edge may be one plane
FLAT = 1e-6  # of the longest side: how far the corners of a plane may lie off it
ALIGNED = 1e-6  # a normal that differs by less from an axis is along it
SOFT_ANGLE = np.radians(25.0)  # parts that meet at less may be facets of a curved surface
MOST_PLANES = 1000  # the widest flat parts are looked at


def flat_parts(points, faces):
    """Planes of a surface whose longest side is 1.

    Parameters
    ----------
    points : (n, 3) float array
    faces : (f, 3) int array
        Closed, manifold, oriented.

    Returns
    -------
    planes : tuple of Plane
        Outward, widest first; coplanar parts are one.
    widths : tuple of float
        Of each, twice the area over the perimeter of its widest part.
    face_plane : (f,) int array
        Index of each face's plane; -1 on curved parts.
    """
    table = edge_table(faces)
    vectors = area_vectors(points, faces)
    edges, pairs = table.face_pairs()
    turn = angle_between(vectors[pairs[:, 0]], vectors[pairs[:, 1]])
    count, part = connected_faces(pairs[turn < FLAT_ANGLE], len(faces))
    lengths = np.linalg.norm(points[table.edges[edges, 0]] - points[table.edges[edges, 1]], axis=1)
    rim = part[pairs[:, 0]] != part[pairs[:, 1]]
    width = _widths(count, part, vectors, pairs[rim], lengths[rim])
    faceted = _facets_of_curves(width, part[pairs[rim]], turn[rim])
    planes, widths, plane_of_part = [], [], np.full(count, -1)
    members = np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part))[:-1])
    for k in np.argsort(-width, kind="stable")[:MOST_PLANES]:
        if not faceted[k]:
            plane = _plane_through(points[faces[members[k]]].reshape(-1, 3), vectors[members[k]])
            plane_of_part[k] = _place_of(plane, planes)
            if plane_of_part[k] == len(planes):
                planes.append(plane)
                widths.append(float(width[k]))
    return tuple(planes), tuple(widths), plane_of_part[part]


def connected_faces(pairs, count):
    """Connected sets of faces joined by `pairs` (p, 2): how many, and which each of the `count`
    faces is in."""
    graph = coo_array((np.ones(len(pairs), np.int8), pairs.T), shape=(count, count))
    return connected_components(graph, directed=False)


def _widths(count, part, vectors, rim_pairs, rim_lengths):
    """Twice the area of each part over the length of its rim (0 where there is no rim)."""
    area = np.bincount(part, np.linalg.norm(vectors, axis=1), count)
    rim = np.bincount(part[rim_pairs].ravel(), np.repeat(rim_lengths, 2), count)
    return np.divide(2.0 * area, rim, out=np.zeros(count), where=rim > 0)


def _facets_of_curves(width, neighbours, turn):
    """Which parts meet one at least half as wide at a small angle: (count,) bool."""
    first, second = neighbours[turn < SOFT_ANGLE].T
    faceted = np.zeros(len(width), dtype=bool)
    faceted[first[width[second] > 0.5 * width[first]]] = True
    faceted[second[width[first] > 0.5 * width[second]]] = True
    return faceted


def _plane_through(points, vectors):
    """The plane of a flat part, its normal along an axis if it nearly is; None if it bends."""
    normal = normalised(vectors.sum(axis=0))
    axis = int(np.abs(normal).argmax())
    if np.abs(np.delete(normal, axis)).max() < ALIGNED:
        normal = np.where(np.arange(3) == axis, np.sign(normal), 0.0)
    heights = points @ normal
    offset = float(np.median(heights))
    if np.abs(heights - offset).max() > FLAT:
        return None
    return Plane(tuple(map(float, normal)), offset)


def _place_of(plane, planes):
    """Index of the same plane in a list, the list's length if it is new, -1 for None."""
    if plane is None:
        return -1
    for k, other in enumerate(planes):
        same = np.allclose(plane.normal, other.normal, rtol=0.0, atol=ALIGNED)
        if same and abs(plane.offset - other.offset) <= FLAT:
            return k
    return len(planes)
