"""The mesh while it is worked on: half-edges in flat arrays (see `connectivity`)."""

import numpy as np

from meshes import TriMesh
from meshes.quality import corner_angles
from remesh.compiled import allocating, kernel
from remesh.connectivity import (
    BASE,
    CORNER,
    CREASE,
    CURVE,
    EDGES,
    FREE_ROW,
    FREE_TRIANGLE,
    HINT,
    IDEAL,
    INTERIOR,
    KIND,
    LINKS,
    ORIGIN,
    OTHER,
    OUT,
    PARAMETER,
    ROWS,
    TRIANGLES,
    TWIN,
    VERTICES,
)
from remesh.curves import with_fixed_boundary


class WorkMesh:
    """Half-edges, rows and free lists of a mesh on its carrier.

    Parameters
    ----------
    carrier : Carrier
        The work mesh starts as the carrier's own triangulation.
    capacity : int, optional
        Vertices to make room for at first; the arrays grow when a sweep asks for more.
    fix_boundary : bool
        Keep the edges and vertices of open boundaries as they are.
    """

    def __init__(self, carrier, capacity=0, fix_boundary=False):
        self.carrier = carrier
        self.sizing = None  # or a Sizing, which splits and collapses then go by
        self.curves = carrier.curves.arrays
        if fix_boundary:
            self.curves = with_fixed_boundary(self.curves)
        mesh = carrier.mesh
        group, rows_of = carrier.layout.group, carrier.layout.rows_of
        count, vertices, triangles = len(rows_of), len(mesh.points), len(mesh.faces)
        self.counts = np.array([count, triangles, -1, -1, vertices], np.int64)
        self.halves = np.full((3 * triangles, 3), -1, np.int64)
        self.halves[:, ORIGIN] = group.ravel()
        self.halves[:, TWIN] = carrier.layout.twins
        self.labels = mesh.face_labels.astype(np.int64)
        self.links = np.zeros((count, LINKS), np.int64)
        self.rows = np.zeros((count, 8))
        self.rows[:, :3] = mesh.points[rows_of]
        self.rows[group.ravel(), 3:6] = carrier.normals.reshape(-1, 3)
        self.links[group.ravel(), HINT] = np.repeat(np.arange(triangles), 3)
        self.links[:, BASE] = rows_of
        _link_rows(self.links, vertices)
        self._mark_curves()
        self._count_edges(mesh)
        settle_all(self.halves, self.links, self.counts)
        self.reserve(max(capacity - vertices, 0))

    @property
    def vertices(self):
        """Number of vertices in use."""
        return int(self.counts[VERTICES])

    def reserve(self, more):
        """Make room for that many more vertices (one row each, two triangles each)."""
        rows = int(self.counts[ROWS] + more + 16) - len(self.rows)
        triangles = int(self.counts[TRIANGLES] + 2 * more + 32) - len(self.labels)
        if rows > 0:
            self.rows = _extended(self.rows, rows, 0.0)
            self.links = _extended(self.links, rows, -1)
        if triangles > 0:
            self.halves = _extended(self.halves, 3 * triangles, -1)
            self.labels = _extended(self.labels, triangles, -1)

    def compact(self):
        """Close the gaps that freed rows and triangles left."""
        used = int(self.counts[ROWS])
        compact_arrays(self.halves, self.links, self.rows, self.labels, self.counts)
        self.links[self.counts[ROWS] : used] = -1

    def saved(self):
        """Copies of all that operations change, for `restore`."""
        return tuple(
            a.copy() for a in (self.halves, self.links, self.rows, self.labels, self.counts)
        )

    def restore(self, state):
        """Go back to what `saved` returned."""
        self.halves, self.links, self.rows, self.labels, self.counts = (a.copy() for a in state)

    def base_rows(self):
        """The rows (n,) that stand for a vertex, in ascending order."""
        used = self.links[: self.counts[ROWS], BASE]
        return np.flatnonzero(used == np.arange(len(used)))

    def corner_rows(self):
        """Rows at the corners of the triangles in use (m, 3), and the triangles (m,)."""
        corners = self.halves[: 3 * self.counts[TRIANGLES], ORIGIN].reshape(-1, 3)
        live = np.flatnonzero(corners[:, 0] >= 0)
        return corners[live], live

    def edge_rows(self):
        """Rows at both ends of every edge (e,), (e,); of a feature edge on one of its sides."""
        used = 3 * int(self.counts[TRIANGLES])
        origin, twin = self.halves[:used, ORIGIN], self.halves[:used, TWIN]
        halves = np.flatnonzero((origin >= 0) & (twin < np.arange(used)))
        return origin[halves], origin[halves + np.where(halves % 3 == 2, -2, 1)]

    def to_mesh(self):
        """The mesh as TriMesh, and the rows of its points."""
        bases = self.base_rows()
        number = np.full(int(self.counts[ROWS]), -1)
        number[bases] = np.arange(len(bases))
        corners, live = self.corner_rows()
        vertex = number[self.links[: self.counts[ROWS], BASE]]
        faces = vertex[corners]
        crease = self.halves[: 3 * self.counts[TRIANGLES], CREASE].reshape(-1, 3)[live] >= 0
        ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)[crease]
        edges = np.unique(np.sort(ends, axis=1), axis=0) if len(ends) else np.zeros((0, 2))
        source = self.carrier.mesh
        mesh = TriMesh(self.rows[bases, :3], faces, self.labels[live], source.labels, edges)
        return mesh, bases

    def corner_normals(self):
        """Normals (m, 3, 3) at the corners of the triangles in use."""
        return self.rows[self.corner_rows()[0], 3:6]

    def _mark_curves(self):
        """KIND, CREASE and PARAMETER from the carrier's curves."""
        mesh, curves = self.carrier.mesh, self.carrier.curves
        self.links[:, KIND] = INTERIOR
        starts, nodes = curves.arrays[0], curves.arrays[1]
        codes = {}
        for i, path in enumerate(curves.vertices):
            self.links[path, KIND] = CURVE
            self.rows[path[:-1], PARAMETER] = nodes[starts[i] : starts[i + 1] - 1, 3]
            for a, b in zip(path[:-1].tolist(), path[1:].tolist()):
                codes[a, b], codes[b, a] = 2 * i, 2 * i + 1
        for i in np.flatnonzero(self.curves[4]):
            self.links[curves.vertices[i], KIND] = CORNER
        self.links[curves.corners, KIND] = CORNER
        flat = mesh.faces.ravel()
        for h in np.flatnonzero(self.carrier.layout.crease):
            a, b = flat[h], flat[h - 2 if h % 3 == 2 else h + 1]
            self.halves[h, CREASE] = codes[a, b]

    def _count_edges(self, mesh):
        """EDGES and IDEAL of every vertex."""
        count = len(mesh.points)
        on_boundary = mesh.faces.ravel()[self.carrier.layout.twins < 0]  # each vertex once
        self.links[:count, EDGES] = np.bincount(mesh.faces.ravel(), minlength=count)
        self.links[on_boundary, EDGES] += 1
        self.links[:count, IDEAL] = 6
        self.links[on_boundary, IDEAL] = 4
        corners = self.carrier.curves.corners
        if len(corners):
            angle = corner_angles(mesh.points[mesh.faces]).ravel()
            total = np.bincount(mesh.faces.ravel(), angle, minlength=count)
            ideal = np.rint(total / (np.pi / 3)) + np.isin(np.arange(count), on_boundary)
            self.links[corners, IDEAL] = np.maximum(ideal[corners], 3)


def _link_rows(links, vertices):
    """OTHER: a cycle through the rows of each vertex."""
    links[:, OTHER] = np.arange(len(links))
    for r in range(vertices, len(links)):
        base = links[r, BASE]
        links[r, OTHER] = links[base, OTHER]
        links[base, OTHER] = r


def _extended(array, more, fill):
    """The array with `more` lines at its end."""
    added = np.full((more, *array.shape[1:]), fill, array.dtype)
    return np.concatenate([array, added])


@kernel
def settle_all(halves, links, counts):
    """OUT of every vertex: a half-edge that leaves it, on the boundary the one without a twin."""
    for h in range(3 * counts[TRIANGLES] - 1, -1, -1):
        row = halves[h, ORIGIN]
        if row >= 0:
            links[links[row, BASE], OUT] = h
    for h in range(3 * counts[TRIANGLES]):
        row = halves[h, ORIGIN]
        if row >= 0 and halves[h, TWIN] < 0:
            links[links[row, BASE], OUT] = h


@allocating
def compact_arrays(halves, links, rows, labels, counts):
    """Move live rows and triangles to the front, in order, and empty the free lists."""
    new_row = np.full(counts[ROWS], -1, np.int64)
    n = 0
    for r in range(counts[ROWS]):
        if links[r, BASE] >= 0:
            new_row[r] = n
            n += 1
    new_triangle = np.full(counts[TRIANGLES], -1, np.int64)
    m = 0
    for t in range(counts[TRIANGLES]):
        if halves[3 * t, ORIGIN] >= 0:
            new_triangle[t] = m
            m += 1
    for r in range(counts[ROWS]):
        to = new_row[r]
        if to < 0:
            continue
        for k in range(8):
            rows[to, k] = rows[r, k]
        for k in range(LINKS):
            links[to, k] = links[r, k]
        links[to, BASE] = new_row[links[to, BASE]]
        links[to, OTHER] = new_row[links[to, OTHER]]
        if links[to, BASE] == to:
            h = links[to, OUT]
            links[to, OUT] = 3 * new_triangle[h // 3] + h % 3
    for t in range(counts[TRIANGLES]):
        to = new_triangle[t]
        if to < 0:
            continue
        labels[to] = labels[t]
        for k in range(3):
            halves[3 * to + k, ORIGIN] = new_row[halves[3 * t + k, ORIGIN]]
            twin = halves[3 * t + k, TWIN]
            if twin >= 0:
                twin = 3 * new_triangle[twin // 3] + twin % 3
            halves[3 * to + k, TWIN] = twin
            halves[3 * to + k, CREASE] = halves[3 * t + k, CREASE]
    for h in range(3 * m, 3 * counts[TRIANGLES]):
        halves[h, ORIGIN] = -1
        halves[h, CREASE] = -1
    counts[ROWS], counts[TRIANGLES] = n, m
    counts[FREE_ROW], counts[FREE_TRIANGLE] = -1, -1
