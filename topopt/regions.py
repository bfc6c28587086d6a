"""Regions of space by which a case names parts of the boundary, and triangles clipped to them.

A region is convex: the intersection of closed half-spaces {x : normal . x <= offset}. Triangles
are clipped against one half-space after the other (Sutherland and Hodgman 1974), as fans of
triangles in barycentric coordinates of their parents, so that P1 functions can be integrated
over the pieces exactly.
"""

from dataclasses import dataclass

import numpy as np

from meshes.patch import Plane
from topopt.problem import Box

RELATIVE_TOLERANCE = 2e-7  # of the diagonal; points nearer to a face lie on it (STL has 24 bits)
SMALLEST_SHARE = 1e-15  # of a parent triangle's area; smaller pieces are rounding


@dataclass(frozen=True, eq=False)
class Pieces:
    """Triangles (k) that are parts of other triangles.

    Parameters
    ----------
    parent : (k,) int array
        Index of the triangle each piece is a part of.
    barycentric : (k, 3, 3) float array
        Row c of piece i: the barycentric coordinates of its corner c in its parent.
    share : (k,) float array
        Area of the piece over the area of its parent.
    """

    parent: np.ndarray
    barycentric: np.ndarray
    share: np.ndarray

    @property
    def centroid(self):
        """Barycentric coordinates (k, 3) of the centroids: also the values of the P1 shape
        functions there."""
        return self.barycentric.mean(axis=1)


def half_spaces(region):
    """The half-spaces whose intersection is the region, as outward planes; faces at infinity
    are left out.

    Parameters
    ----------
    region : Box

    Returns
    -------
    list of Plane
    """
    if not isinstance(region, Box):
        raise TypeError(f"no such region: {region!r}")
    planes = []
    for axis in range(3):
        for sign, bound in ((-1.0, region.lower[axis]), (1.0, region.upper[axis])):
            if np.isfinite(bound):
                normal = [0.0, 0.0, 0.0]
                normal[axis] = sign
                planes.append(Plane(tuple(normal), sign * bound))
    return planes


def tolerance_of(points):
    """The length [m] below which points count as lying on a region's face."""
    return RELATIVE_TOLERANCE * float(np.linalg.norm(np.ptp(points, axis=0)))


def contains(region, points, tolerance):
    """Which points (n, 3) lie in the closed region, to within `tolerance` [m]: (n,) bool."""
    inside = np.ones(len(points), dtype=bool)
    for plane in half_spaces(region):
        inside &= plane.signed_distance(points) <= tolerance
    return inside


def clip_triangles(corners, region, tolerance):
    """Clip triangles against a convex region.

    Parameters
    ----------
    corners : (n, 3, 3) float array [m]
        Corner c of triangle i in row [i, c].
    region : Box
    tolerance : float [m]
        Corners nearer than this to a face of the region lie on it, so that a triangle in the
        plane of a face is inside and one that touches the region from outside has no piece.

    Returns
    -------
    Pieces
        Ordered by parent; together they cover the intersection once.
    """
    parent = np.arange(len(corners))
    barycentric = np.broadcast_to(np.eye(3), (len(corners), 3, 3))
    for plane in half_spaces(region):
        distance = plane.signed_distance(barycentric @ corners[parent])
        distance[np.abs(distance) <= tolerance] = 0.0
        source, barycentric = _clip(barycentric, distance)
        parent = parent[source]
    share = np.abs(np.linalg.det(barycentric))
    order = np.argsort(parent, kind="stable")
    order = order[share[order] > SMALLEST_SHARE]
    return Pieces(parent[order], barycentric[order], share[order])


def _clip(triangles, distance):
    """Keep the part of triangles (k, 3, 3) where the linear function given by its corner values
    `distance` (k, 3) is not positive: source (l,) and triangles (l, 3, 3)."""
    whole = np.flatnonzero((distance <= 0).all(axis=1))
    below = distance < 0
    cut = ~(distance <= 0).all(axis=1)
    one, two = (np.flatnonzero(cut & (below.sum(axis=1) == count)) for count in (1, 2))
    tip, a, b = _turned(triangles[one], distance[one], below[one].argmax(axis=1))
    tips = np.stack([tip[0], _crossing(tip, a), _crossing(tip, b)], axis=1)
    out, c, d = _turned(triangles[two], distance[two], (~below[two]).argmax(axis=1))
    near_c, near_d = _crossing(c, out), _crossing(d, out)
    first = np.stack([c[0], d[0], near_d], axis=1)
    second = np.stack([c[0], near_d, near_c], axis=1)
    source = np.concatenate([whole, one, two, two])
    return source, np.concatenate([triangles[whole], tips, first, second])


def _turned(triangles, distance, first):
    """The corners, each with its value, in cyclic order from corner `first` (k,)."""
    row = np.arange(len(triangles))
    order = (first + np.arange(3)[:, None]) % 3
    return [(triangles[row, corner], distance[row, corner]) for corner in order]


def _crossing(inside, outside):
    """Where the values of two corners pass through zero; at `outside` itself if it is zero."""
    (a, value_a), (b, value_b) = inside, outside
    weight = (value_a / (value_a - value_b))[:, None]
    return a + weight * (b - a)
