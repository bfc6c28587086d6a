"""A surface that is made coarser or finer while samples of the original keep close to it.

Flat arrays: half-edge 3 f + k of face f starts at its corner k. `state` and `samples` are the
tuples of arrays that the kernels of this package's `bounded_*` modules take.
"""

from functools import cached_property

import numpy as np

from meshes import TriMesh
from meshes.closest_point import ClosestPoint
from meshes.quality import area_vectors, corner_normals, face_normals, normalised
from meshes.self_intersection import self_intersecting_faces
from meshes.topology import edge_table, feature_corners, feature_mask

INSIDE, ON_CURVE, FIXED = 0, 1, 2
CREASE_WEIGHT = 1.0  # of the planes that hold feature edges, per squared length
PLANAR_WEIGHT = 1e3  # of planar labels, which must stay planar
SPACING = 1.0  # mean edges between samples within an edge that is bent
FLAT_SPACING = 1.5  # within one that is not
BENT = 0.1  # of the bound: the sagitta between the normals at both ends above which an edge is bent
MOST_INSIDE = 24  # samples within one edge
ADDED_SHARE = 0.8  # of the squared bound, of samples where it did not hold
SPARE = 0.1  # of vertices and faces, for splits


class BoundedMesh:
    """The surface, the samples of the original that its faces must stay close to, and quadrics.

    Parameters
    ----------
    mesh : TriMesh
        Manifold and oriented, with all its feature edges; the original.
    error : float [unit of the points]
        The bound; says how many samples are needed.
    fix_boundary : bool
    corner_angle : float [degrees]
        Feature curves that turn by more have a corner there.

    Attributes
    ----------
    state : tuple
        corner (3 f,), twin (3 f,), crease (3 f,), label (f,), first (n,), kind (n,), points (n, 3),
        normals (n, 3), quadrics (n, 11).
    samples : tuple
        head (f,), after (s,), place (s, 3), on_curve (s,), direction (s, 3), share (s,), near (s,).
    counts : (2,) int array
        Vertices and faces in use, those that are gone included.
    """

    def __init__(self, mesh, error, fix_boundary=False, corner_angle=45.0):
        self.source, self.bound = mesh, error
        self.centre = mesh.points.mean(axis=0)  # of the coordinates of the quadrics
        self.search = ClosestPoint(mesh.points, mesh.faces)
        normals = corner_normals(mesh)[self.search.order].reshape(-1, 9)
        self.reference = (self.search.tree, self.search.neighbours, normals)
        table = edge_table(mesh.faces)
        crease = feature_mask(mesh, table)
        room_f = int(len(mesh.faces) * (1.0 + SPARE)) + 2000
        room_v = int(len(mesh.points) * (1.0 + SPARE)) + 1000
        self.counts = np.array([len(mesh.points), len(mesh.faces)])
        corner = np.full(3 * room_f, -1, np.int64)
        corner[: mesh.faces.size] = mesh.faces.ravel()
        first = np.full(room_v, -1, np.int64)
        first[mesh.faces.ravel()] = np.arange(mesh.faces.size)
        label = np.zeros(room_f, np.int64)
        label[: len(mesh.faces)] = mesh.face_labels
        points = np.zeros((room_v, 3))
        points[: len(mesh.points)] = mesh.points
        marked = np.zeros(3 * room_f, np.int8)
        marked[: mesh.faces.size] = crease[table.face_edges].ravel()
        vectors = area_vectors(mesh.points, mesh.faces)
        normals = np.zeros((room_v, 3))
        for k in range(3):
            for d in range(3):
                normals[:, d] += np.bincount(mesh.faces[:, k], vectors[:, d], room_v)
        self.state = (
            corner, _twins(table, 3 * room_f), marked, label, first,
            _kinds(mesh, table, crease, fix_boundary, corner_angle, room_v),
            points, normals, _quadrics(mesh, table, crease, vectors, room_v, self.centre),
        )  # fmt: skip
        self.samples, self.sample_ends = _samples(
            mesh, table, crease, normals, room_f, self.search.position, error
        )

    @cached_property
    def crossed(self):
        """Faces (m,) bool of the original that meet others."""
        return self_intersecting_faces(self.source.points, self.source.faces)

    def lower_shares(self, share):
        """Scale the squared distances allowed to samples by those (n,) of the original's vertices.

        A sample within an edge gets the smaller one of its ends'.
        """
        own = self.samples[5]
        own[: len(share)] *= share
        own[len(share) :] *= share[self.sample_ends].min(axis=1)

    def add_samples(self, faces, places):
        """Add points (k, 3) of the original as samples of faces (k,), with less room."""
        head, after, place, on_curve, direction, share, near = self.samples
        first, count = len(place), len(places)
        found, _, _ = self.search.query(places)
        normals = face_normals(self.source.points, self.source.faces[found])
        after = np.concatenate([after, np.full(count, -1)])
        for k, face in enumerate(faces):
            after[first + k], head[face] = head[face], first + k
        self.samples = (
            head, after, np.concatenate([place, places]),
            np.concatenate([on_curve, np.zeros(count, np.int8)]),
            np.concatenate([direction, normals]),
            np.concatenate([share, np.full(count, ADDED_SHARE)]),
            np.concatenate([near, self.search.position[found]]),
        )  # fmt: skip

    def reserve(self, points):
        """Make room for so many more points, each with two more faces."""
        more_v = int(self.counts[0]) + points - len(self.state[4])
        more_f = int(self.counts[1]) + 2 * points - len(self.state[3])
        if more_v > 0 or more_f > 0:
            grow = max(more_v, more_f, 1000)
            sizes = (3, 3, 3, 1, 1, 1, 1, 1, 1)
            self.state = tuple(_grown(a, k * grow) for a, k in zip(self.state, sizes, strict=True))
            self.samples = (_grown(self.samples[0], grow), *self.samples[1:])

    @property
    def vertices(self):
        """Number of vertices in use."""
        return len(self.kept())

    def kept(self):
        """Numbers (k,) of the vertices in use."""
        return np.flatnonzero(self.state[4][: self.counts[0]] >= 0)

    def saved(self):
        """A copy of the surface and of its samples' lists, for `restore`."""
        lists = [array.copy() for array in self.samples[:2]]
        return [array.copy() for array in self.state], lists, self.counts.copy()

    def restore(self, saved):
        """Make the surface what it was when `saved` was made; that can be used again."""
        state, lists, counts = saved
        self.state = tuple(array.copy() for array in state)
        self.samples = (*(array.copy() for array in lists), *self.samples[2:])
        self.counts[:] = counts

    def vertices_around(self, faces, rings):
        """Vertices (n,) bool of some faces, and of as many rings around them."""
        corners = self.state[0][: 3 * self.counts[1]].reshape(-1, 3)
        alive = corners[corners[:, 0] >= 0]
        chosen = np.zeros(len(self.state[4]), bool)
        near = corners[faces]
        chosen[near[near[:, 0] >= 0]] = True
        for _ in range(rings):
            chosen[alive[chosen[alive].any(axis=1)]] = True
        return chosen

    def to_mesh(self):
        """The surface as TriMesh, and the number of each of its faces here."""
        corner, _, crease, label, _, _, points, _, _ = self.state
        halves = corner[: 3 * self.counts[1]].reshape(-1, 3)
        alive = np.flatnonzero(halves[:, 0] >= 0)
        kept = self.kept()
        new = np.full(self.counts[0], -1)
        new[kept] = np.arange(len(kept))
        faces = new[halves[alive]]
        ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)
        marked = crease[: 3 * self.counts[1]].reshape(-1, 3)[alive] == 1
        edges = np.unique(np.sort(ends[marked], axis=1), axis=0)
        mesh = TriMesh(points[kept], faces, label[alive], self.source.labels, edges)
        return mesh, alive


def _grown(array, more):
    """The array with `more` rows of -1 appended."""
    return np.concatenate([array, np.full((more, *array.shape[1:]), -1, array.dtype)])


def _twins(table, room):
    """Opposite half-edges (room,), -1 on boundaries."""
    twins = np.full(room, -1, np.int64)
    inner = table.start[:-1][table.count == 2]
    one, other = table.half_edges[inner], table.half_edges[inner + 1]
    twins[one], twins[other] = other, one
    return twins


def _kinds(mesh, table, crease, fix_boundary, corner_angle, room):
    """INSIDE, ON_CURVE or FIXED for every vertex (room,)."""
    kind = np.full(room, INSIDE, np.int8)
    edges = table.edges[crease]
    kind[edges.ravel()] = ON_CURVE
    kind[feature_corners(mesh, corner_angle)] = FIXED
    if fix_boundary:
        kind[table.edges[table.count == 1].ravel()] = FIXED
    return kind


def _plane_quadrics(normals, points, weights):
    """Rows (k, 11): the quadric w (n.x - n.p)^2 as A (6), b (3), c, and the weight w."""
    offset = np.einsum("ij,ij->i", normals, points)
    x, y, z = normals.T
    rows = [x * x, x * y, x * z, y * y, y * z, z * z, -offset * x, -offset * y, -offset * z]
    return weights[:, None] * np.stack([*rows, offset * offset, np.ones_like(x)], axis=1)


def _quadrics(mesh, table, crease, vectors, room, centre):
    """Sum (room, 11) of the quadrics of the faces and feature edges around every vertex."""
    area = 0.5 * np.linalg.norm(vectors, axis=1)
    normal = normalised(vectors)
    planar = np.array([patch.plane is not None for patch in mesh.labels])
    weight = area * np.where(planar[mesh.face_labels], PLANAR_WEIGHT, 1.0) / 3.0
    points = mesh.points - centre
    rows = _plane_quadrics(normal, points[mesh.faces[:, 0]], weight)
    rows[:, 10] = area / 3.0
    total = np.zeros((room, 11))
    _scatter(total, mesh.faces.ravel(), np.repeat(rows, 3, axis=0))
    halves = np.flatnonzero(crease[table.face_edges].ravel())
    start = mesh.faces.ravel()[halves]
    end = mesh.faces[:, [1, 2, 0]].ravel()[halves]
    step = points[end] - points[start]
    across = normalised(np.cross(normal[halves // 3], step))
    square = np.einsum("ij,ij->i", step, step)
    rows = _plane_quadrics(across, points[start], 0.5 * CREASE_WEIGHT * square)
    rows[:, 10] = 0.0
    _scatter(total, start, rows)
    _scatter(total, end, rows)
    return total


def _scatter(total, index, rows):
    for k in range(rows.shape[1]):
        total[:, k] += np.bincount(index, rows[:, k], len(total))


def _samples_inside(length, turn, error):
    """How many samples lie within edges (e,), by their length and the turn of the normals."""
    bent = 0.125 * length * turn > BENT * error
    share = np.minimum(length / length.mean(), MOST_INSIDE)
    inside = np.where(bent, np.ceil(share / SPACING), np.floor(share / FLAT_SPACING))
    return inside.astype(np.int64)


def _samples(mesh, table, crease, normals, room, position, error):
    """Vertices, and points within edges that are long, each on one of its faces."""
    ends = mesh.points[table.edges]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    at_ends = normalised(normals[: len(mesh.points)])[table.edges]
    turn = np.linalg.norm(at_ends[:, 1] - at_ends[:, 0], axis=1)
    inside = _samples_inside(length, turn, error)
    edge = np.repeat(np.arange(len(length)), inside)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(inside) - inside, inside) + 1
    s = (number / (inside[edge] + 1.0))[:, None]
    n = len(mesh.points)
    on_edge = table.edges[edge]
    place = np.concatenate([mesh.points, (1 - s) * ends[edge, 0] + s * ends[edge, 1]])
    direction = np.concatenate([normals[:n], (1 - s) * normals[on_edge[:, 0]]
                                + s * normals[on_edge[:, 1]]])  # fmt: skip
    on_curve = np.zeros(len(place), np.int8)
    on_curve[table.edges[crease]] = 1
    on_curve[n:] = crease[edge]
    face = np.empty(len(place), np.int64)
    face[mesh.faces.ravel()] = np.repeat(np.arange(len(mesh.faces)), 3)
    # a vertex on a curve must be listed at a face with a feature edge
    halves = np.flatnonzero(crease[table.face_edges].ravel())
    face[mesh.faces.ravel()[halves]] = halves // 3
    face[mesh.faces[:, [1, 2, 0]].ravel()[halves]] = halves // 3
    face[n:] = table.half_edges[table.start[edge]] // 3
    head, after = np.full(room, -1, np.int64), np.full(len(place), -1, np.int64)
    order = np.argsort(face, kind="stable")
    same = face[order][1:] == face[order][:-1]
    after[order[:-1][same]] = order[1:][same]
    start = np.concatenate([[True], ~same])
    head[face[order[start]]] = order[start]
    return (
        head, after, place, on_curve, normalised(direction), np.ones(len(place)),
        position[face].astype(np.int64),
    ), on_edge  # fmt: skip
