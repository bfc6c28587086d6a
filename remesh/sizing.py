"""Edge lengths held within limits, and graded: they grow slowly from one triangle to the next.

What the embedding asks for at a place is an edge of the length h = L sqrt(A3 / A6): L is the 6D
length aimed at, A3 and A6 are the areas of the carrier's triangles there in 3D and in 6D (A6 / A3
is the determinant of the embedding's metric, so h is the edge of an equilateral triangle as large
as the metric's). Graded, it is

    h'(x) = min over y of h(y) + (G - 1) |x - y|,   distances along the carrier's edges,

so that over an edge as long as h' it grows by no more than the factor G. 6D lengths of edges are
multiplied by h / h', which leaves their proportions as they are. The limits hold for each edge by
itself: 6D lengths are raised and lowered so that in 3D none is split below the one or kept above
the other.
"""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from meshes.edges import edge_table
from remesh.connectivity import HINT
from remesh.embedding import corner_edge_lengths

SAME = 0.02  # relative change of the 6D length that the field is not made anew for
LONGEST, SHORTEST = 0.92, 1.1  # times the limits: room for the moves that come later
NO_SIZING = (np.zeros(0), 0.0, np.inf)


class Sizing:
    """Factors of the 6D lengths on a carrier, and limits of the 3D ones.

    Parameters
    ----------
    carrier : Carrier
    sigma : float [unit of the points]
        Of the loop.
    gradation : float or None
        How many times longer edges may be in the next triangle.
    min_length, max_length : float [unit of the points]
    """

    def __init__(self, carrier, sigma, gradation, min_length, max_length):
        mesh = carrier.mesh
        self.faces = mesh.faces
        self.shortest, self.longest = min_length, max_length
        self.growth = None if gradation is None else gradation - 1.0
        self.length = None
        self.scales = np.ones(len(mesh.faces))
        if gradation is not None:
            self.relative = relative_sizes(mesh, carrier.normals, sigma)
            edges = edge_table(mesh.faces).edges
            self.steps = edges, np.linalg.norm(np.diff(mesh.points[edges], axis=1)[:, 0], axis=1)

    def aim(self, length):
        """Make the field for a 6D length [unit of the points]."""
        if self.growth is None or (
            self.length is not None and abs(length - self.length) <= SAME * self.length
        ):
            return
        self.length = length
        wanted = np.clip(length * self.relative, self.shortest, self.longest)
        ratio = wanted / graded(wanted, *self.steps, self.growth)
        self.scales = ratio[self.faces].mean(axis=1)

    def for_splits(self):
        """What `split_long_edges` takes: halves are to be no shorter than the shortest."""
        return self.scales, (2.0 * self.shortest) ** 2, squared(LONGEST * self.longest)

    def for_collapses(self):
        """What `collapse_short_edges` takes for the edges that go."""
        return self.scales, (SHORTEST * self.shortest) ** 2, np.inf

    def lengths(self, work, first, last, square3, square6, longest):
        """6D lengths (e,) of edges between rows, as for splits above `longest`."""
        scale = 0.5 * (self.scales[work.links[first, HINT]] + self.scales[work.links[last, HINT]])
        least = square3 * (longest**2 / squared(LONGEST * self.longest))
        return np.sqrt(np.maximum(square6, least)) * scale


def squared(length):
    """The square of a length, which may be infinite."""
    return float(length) ** 2 if length < 1e150 else np.inf


def relative_sizes(mesh, corner_normals, sigma):
    """sqrt(A3 / A6) at every vertex (n,), of the triangles around it.

    Parameters
    ----------
    mesh : TriMesh
    corner_normals : (m, 3, 3) float array
        Of the surface.
    sigma : float [unit of the points]
    """
    corners = mesh.points[mesh.faces]
    area3 = areas(corners)
    area6 = areas(np.concatenate([corners, sigma * corner_normals], axis=2))
    count = len(mesh.points)
    around = [
        np.bincount(mesh.faces.ravel(), np.repeat(area, 3), minlength=count)
        for area in (area3, area6)
    ]
    return np.sqrt(np.divide(*around, out=np.ones(count), where=around[1] > 0.0))


def areas(corners):
    """Areas (m,) of triangles (m, 3, d)."""
    first, second, third = (corner_edge_lengths(corners) ** 2).T
    mixed = first * second + second * third + third * first
    squares = first**2 + second**2 + third**2
    return 0.25 * np.sqrt(np.maximum(2.0 * mixed - squares, 0.0))


def graded(sizes, edges, lengths, growth):
    """min over y of sizes(y) + growth |x - y| at every node (n,), |x - y| along edges.

    Parameters
    ----------
    sizes : (n,) float array
        Positive.
    edges : (e, 2) int array
    lengths : (e,) float array
    growth : float
        Positive.
    """
    count = len(sizes)
    ends = np.concatenate([edges, np.stack([np.full(count, count), np.arange(count)], axis=1)])
    # a node more, from which every other is as far as its own size
    steps = np.concatenate([np.maximum(growth * lengths, 1e-300), sizes])
    graph = coo_matrix((steps, ends.T), shape=(count + 1, count + 1)).tocsr()
    return dijkstra(graph, directed=False, indices=count)[:count]
