"""A few triangles of a work mesh as they were, so that changes among them can be undone."""

import numpy as np

from remesh.connectivity import (
    BASE,
    FREE_ROW,
    FREE_TRIANGLE,
    MAX_RING,
    ORIGIN,
    OUT,
    ROWS,
    TRIANGLES,
    TWIN,
    ring,
)

FREE_KEPT = 6  # of either free list: more than two changes use


class Region:
    """The triangles in some rings around one, and their rows.

    Parameters
    ----------
    work : WorkMesh
    t : int
        The triangle in the middle.
    rings : int
        Changes may not reach beyond the last but one.
    """

    def __init__(self, work, t, rings):
        self.work = work
        inside = rings_around(work, t, rings)[1]
        rows = work.halves[half_edges_of(inside), ORIGIN]
        bases = work.links[rows, BASE]
        self.inside = np.unique(np.concatenate([inside, next_free_triangles(work)]))
        self.rows = np.unique(np.concatenate([rows, bases, next_free_rows(work)]))
        self.sides = half_edges_of(self.inside)
        self.first_row, self.first = int(work.counts[ROWS]), int(work.counts[TRIANGLES])

    def triangles(self):
        """The region's triangles, with those that were added since (some may be free)."""
        return np.append(self.inside, self.added())

    def added(self):
        """Triangles that were added to the mesh since."""
        return np.arange(self.first, self.work.counts[TRIANGLES])

    def state(self):
        """Copies of all that changes in the region touch, for `restore`."""
        work = self.work
        rows, triangles = slice(self.first_row, work.counts[ROWS]), work.counts[TRIANGLES]
        return (
            work.counts.copy(), work.halves[self.sides], work.labels[self.inside],
            work.links[self.rows], work.rows[self.rows],
            work.halves[3 * self.first : 3 * triangles].copy(),
            work.labels[self.first : triangles].copy(),
            work.links[rows].copy(), work.rows[rows].copy(),
        )  # fmt: skip

    def restore(self, state):
        """Go back to what `state` returned."""
        work = self.work
        rows, triangles = slice(self.first_row, state[0][ROWS]), state[0][TRIANGLES]
        work.halves[3 * triangles : 3 * work.counts[TRIANGLES]] = -1
        work.links[state[0][ROWS] : work.counts[ROWS]] = -1
        work.counts[:] = state[0]
        work.halves[self.sides], work.labels[self.inside] = state[1:3]
        work.links[self.rows], work.rows[self.rows] = state[3:5]
        work.halves[3 * self.first : 3 * triangles] = state[5]
        work.labels[self.first : triangles] = state[6]
        work.links[rows], work.rows[rows] = state[7:]


def neighbourhood(work, t):
    """Vertices of the triangles that touch a triangle, and these triangles."""
    return rings_around(work, t, 1)


def rings_around(work, t, rings):
    """Vertices and triangles in so many rings around a triangle."""
    triangles = np.array([t])
    for _ in range(rings):
        triangles = triangles_at(work, vertices_of(work, triangles))
    return vertices_of(work, triangles), triangles


def vertices_of(work, triangles):
    """The vertices of some triangles."""
    return np.unique(work.links[work.halves[half_edges_of(triangles), ORIGIN], BASE])


def half_edges_of(triangles):
    """The three half-edges of each triangle."""
    return (3 * np.asarray(triangles)[:, None] + np.arange(3)).ravel()


def triangles_at(work, vertices):
    """The triangles that meet at any of some vertices."""
    fan, found = np.empty(MAX_RING, np.int64), []
    for v in vertices:
        count, _ = ring(work.halves, work.links, v, fan)
        found.append(fan[:count] // 3)
    return np.unique(np.concatenate(found))


def next_free_triangles(work):
    """The free triangles that are used next."""
    found, t = [], int(work.counts[FREE_TRIANGLE])
    while t >= 0 and len(found) < FREE_KEPT:
        found.append(t)
        t = int(work.halves[3 * t, TWIN])
    return np.array(found, np.int64)


def next_free_rows(work):
    """The free rows that are used next."""
    found, r = [], int(work.counts[FREE_ROW])
    while r >= 0 and len(found) < FREE_KEPT:
        found.append(r)
        r = int(work.links[r, OUT])
    return np.array(found, np.int64)
