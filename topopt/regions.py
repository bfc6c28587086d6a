"""Regions of space by which a case names parts of the boundary, and triangles clipped to them.

Boxes and slabs are intersections of closed half-spaces {x : normal . x <= offset}. Triangles are
clipped against one half-space after the other (Sutherland and Hodgman 1974), as fans of triangles
in barycentric coordinates of their parents, so that P1 functions can be integrated over the pieces
exactly.

Spheres, cylinders and the insides of surfaces are known by a function that is negative inside, is
zero on the border, and changes by no more than the distance moved. Triangles that the border may
cross are cut in four, again and again, until they are small beside the region; then the function
counts as linear on them. What that misses is less than 2e-4 of the area of a sphere's or a
cylinder's disc, whatever the mesh.
"""

from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from meshes.closest_point import ClosestPoint
from meshes.patch import Plane
from meshes.quality import area_vectors
from meshes.topology import edge_table
from topopt.problem import Box, Cylinder, Slab, Sphere, SurfaceRegion

SMALL_BESIDE_REGION = 1 / 40  # of its radius: triangles that are not cut any more
SMALL_BESIDE_SURFACE = 1 / 200  # of the diagonal of a surface's bounding box, likewise
RELATIVE_TOLERANCE = 2e-7  # of the diagonal; points nearer to a face lie on it (STL has 24 bits)
_PREPARED = WeakKeyDictionary()
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
    region : Box or Slab

    Returns
    -------
    list of Plane, or None
        None for regions that are no intersection of half-spaces.
    """
    if isinstance(region, Slab):
        normal = np.asarray(region.normal, float) / np.linalg.norm(region.normal)
        middle, half = float(normal @ region.point), region.thickness / 2.0
        return [Plane(tuple(sign * normal), half + sign * middle) for sign in (-1.0, 1.0)]
    if isinstance(region, Sphere | Cylinder | SurfaceRegion):
        return None
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


def signed_distance(region, points):
    """How far points (n, 3) lie from a region's border [m]: (n,), negative inside.

    Never more than the true distance, and of it for spheres and surfaces exactly. Regions:
    Sphere, Cylinder, SurfaceRegion.
    """
    if isinstance(region, Sphere):
        return np.linalg.norm(points - np.asarray(region.center), axis=1) - region.radius
    if isinstance(region, Cylinder):
        start, end = np.asarray(region.start, float), np.asarray(region.end, float)
        length = np.linalg.norm(end - start)
        axis = (end - start) / length
        along = (points - start) @ axis
        radial = np.linalg.norm(points - start - along[:, None] * axis, axis=1)
        return np.maximum(radial - region.radius, np.maximum(-along, along - length))
    return _distance_to_surface(region.surface, points) - region.margin


def _distance_to_surface(surface, points):
    """Distance (n,) to a closed outward surface, negative inside.

    The side is told by the normal at the closest point: of its face, of both faces at an edge, of
    all by their angles at a corner (Baerentzen and Aanaes 2005).
    """
    finder, normals = _prepared(surface)
    faces, weights, distance = finder.query(points)
    closest = np.einsum("nk,nki->ni", weights, surface.points[surface.faces[faces]])
    kind = (weights > 1e-9).sum(axis=1)
    corner = weights.argmax(axis=1)
    edge = weights.argmin(axis=1)  # the edge opposite to the corner that does not count
    of_face, of_edge, of_corner = normals
    normal = np.where((kind == 3)[:, None], of_face[faces], of_edge[faces, edge])
    normal = np.where((kind == 1)[:, None], of_corner[surface.faces[faces, corner]], normal)
    outside = np.einsum("ni,ni->n", points - closest, normal) >= 0.0
    return np.where(outside, distance, -distance)


def _prepared(surface):
    """The surface's closest-point search and normals, made once while it lives."""
    if surface not in _PREPARED:
        finder = ClosestPoint(surface.points, surface.faces)
        _PREPARED[surface] = finder, _pseudo_normals(surface)
    return _PREPARED[surface]


def _pseudo_normals(surface):
    """Normals of faces (m, 3), of their edges by the opposite corner (m, 3, 3), of vertices."""
    points, faces = surface.points, surface.faces
    normal = area_vectors(points, faces)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    table = edge_table(faces)
    of_edge = np.zeros((len(table.edges), 3))
    np.add.at(of_edge, table.face_edges.ravel(), np.repeat(normal, 3, axis=0))
    opposite = np.empty((len(faces), 3, 3))
    for k in range(3):
        ends = table.edges[table.face_edges[:, k]]
        corner = (faces[:, :, None] != ends[:, None, :]).all(axis=2).argmax(axis=1)
        opposite[np.arange(len(faces)), corner] = of_edge[table.face_edges[:, k]]
    of_vertex = np.zeros((len(points), 3))
    for k in range(3):
        a = points[faces[:, (k + 1) % 3]] - points[faces[:, k]]
        b = points[faces[:, (k + 2) % 3]] - points[faces[:, k]]
        angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ni,ni->n", a, b))
        np.add.at(of_vertex, faces[:, k], angle[:, None] * normal)
    return normal, opposite, of_vertex


def grown(region, margin):
    """The region with its border moved out by a margin [m]."""
    if isinstance(region, Box):
        lower, upper = np.asarray(region.lower), np.asarray(region.upper)
        return Box(tuple(lower - margin), tuple(upper + margin))
    if isinstance(region, Slab):
        return replace(region, thickness=region.thickness + 2.0 * margin)
    if isinstance(region, SurfaceRegion):
        return replace(region, margin=region.margin + margin)
    if isinstance(region, Cylinder):
        start, end = np.asarray(region.start, float), np.asarray(region.end, float)
        step = margin * (end - start) / np.linalg.norm(end - start)
        region = replace(region, start=tuple(start - step), end=tuple(end + step))
    return replace(region, radius=region.radius + margin)


def in_words(region):
    """A region as it is named in messages."""

    def triple(values):
        return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"

    if isinstance(region, Box):
        sides = (f"[{a:.6g}, {b:.6g}]" for a, b in zip(region.lower, region.upper))
        return " x ".join(sides) + " m"
    if isinstance(region, Slab):
        return (
            f"the plane through {triple(region.point)} m with normal {triple(region.normal)}, "
            f"{region.thickness:.6g} m thick"
        )
    if isinstance(region, Sphere):
        return f"the sphere around {triple(region.center)} m with radius {region.radius:.6g} m"
    if isinstance(region, Cylinder):
        return (
            f"the cylinder from {triple(region.start)} to {triple(region.end)} m with radius "
            f"{region.radius:.6g} m"
        )
    low, high = region.surface.points.min(axis=0), region.surface.points.max(axis=0)
    return f"the inside of {region.name} between {triple(low)} and {triple(high)} m"


def tolerance_of(points):
    """The length [m] below which points count as lying on a region's face."""
    return RELATIVE_TOLERANCE * float(np.linalg.norm(np.ptp(points, axis=0)))


def contains(region, points, tolerance):
    """Which points (n, 3) lie in the closed region, to within `tolerance` [m]: (n,) bool."""
    planes = half_spaces(region)
    if planes is None:
        return signed_distance(region, points) <= tolerance
    inside = np.ones(len(points), dtype=bool)
    for plane in planes:
        inside &= plane.signed_distance(points) <= tolerance
    return inside


def clip_triangles(corners, region, tolerance):
    """Clip triangles against a region.

    Parameters
    ----------
    corners : (n, 3, 3) float array [m]
        Corner c of triangle i in row [i, c].
    region : Region
    tolerance : float [m]
        Corners nearer than this to a face of the region lie on it, so that a triangle in the
        plane of a face is inside and one that touches the region from outside has no piece.

    Returns
    -------
    Pieces
        Ordered by parent; together they cover the intersection once.
    """
    planes = half_spaces(region)
    if planes is None:
        parent, barycentric = _clip_by_distance(corners, region, tolerance)
        planes = []
    else:
        parent = np.arange(len(corners))
        barycentric = np.broadcast_to(np.eye(3), (len(corners), 3, 3))
    for plane in planes:
        distance = plane.signed_distance(barycentric @ corners[parent])
        distance[np.abs(distance) <= tolerance] = 0.0
        source, barycentric = _clip(barycentric, distance)
        parent = parent[source]
    share = np.abs(np.linalg.det(barycentric))
    order = np.argsort(parent, kind="stable")
    order = order[share[order] > SMALLEST_SHARE]
    return Pieces(parent[order], barycentric[order], share[order])


QUARTERS = 0.5 * np.array(
    [
        [[2, 0, 0], [1, 1, 0], [1, 0, 1]],
        [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
        [[1, 0, 1], [0, 1, 1], [0, 0, 2]],
        [[1, 1, 0], [0, 1, 1], [1, 0, 1]],
    ]
)


def _clip_by_distance(corners, region, tolerance):
    """Parents (k,) and barycentric coordinates (k, 3, 3) of the pieces inside a region that is
    known by its `signed_distance`."""
    convex = not isinstance(region, SurfaceRegion)
    smallest = SMALL_BESIDE_REGION * region.radius if convex else _smallest(region.surface)
    parent = np.arange(len(corners))
    barycentric = np.broadcast_to(np.eye(3), (len(corners), 3, 3))
    kept = []
    while len(parent):
        placed = barycentric @ corners[parent]
        middle = placed.mean(axis=1)
        reach = np.linalg.norm(placed - middle[:, None], axis=2).max(axis=1)
        near = signed_distance(region, middle) <= reach + tolerance
        parent, barycentric, placed, reach = (
            values[near] for values in (parent, barycentric, placed, reach)
        )
        distance = signed_distance(region, placed.reshape(-1, 3)).reshape(-1, 3)
        distance[np.abs(distance) <= tolerance] = 0.0
        inside = (distance <= 0.0).all(axis=1)
        if not convex:
            inside &= signed_distance(region, placed.mean(axis=1)) <= -reach
        final = inside | (reach <= smallest)
        source, pieces = _clip(barycentric[final], distance[final])
        kept.append((parent[final][source], pieces))
        parent = np.repeat(parent[~final], 4)
        barycentric = np.einsum("qij,kjl->kqil", QUARTERS, barycentric[~final]).reshape(-1, 3, 3)
    parents, pieces = zip(*kept) if kept else ((parent,), (np.array(barycentric),))
    return np.concatenate(parents), np.concatenate(pieces)


def _smallest(surface):
    return SMALL_BESIDE_SURFACE * float(np.linalg.norm(np.ptp(surface.points, axis=0)))


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
