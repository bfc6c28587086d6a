"""The loop of split, collapse, flip and smooth, and the exact vertex count."""

import numpy as np

from remesh.collapse import collapse_short_edges
from remesh.flip import DELAUNAY, VALENCE, flip_edges
from remesh.shape_kernels import area_of_rows
from remesh.smooth import UNIFORM, smooth_vertices
from remesh.split import split_long_edges

FIRST_LENGTH = 0.93  # of the edge of equilateral triangles with the same area and count
COUNT_FEEDBACK = 0.7
MOST_SPLIT_PASSES, MANY_SPLITS = 20, 1.3
COARSENING_STEPS = (0.6, 0.8, 1.0)
LEAST_AIM, MOST_AIM = 0.7, 1.4  # of the edge length asked for


def length_for_count(work, sigma, vertices):
    """6D edge length of equilateral triangles of as many vertices on the work mesh's surface."""
    area = area_of_rows(work.halves, work.rows, work.counts, sigma**2)
    return float(np.sqrt(2.0 * area / (np.sqrt(3.0) * vertices)))


class PliantLoop:
    """Rounds of local operations towards one 6D edge length.

    Parameters
    ----------
    work : WorkMesh
    sigma : float [unit of the points]
    limits : (angle6, angle3, agreement)
        What every operation is held to.
    weights : UNIFORM or AREA
        Of the smoothing.
    short, long : float
        Edges are collapsed below and split above this times the target length.
    """

    def __init__(self, work, sigma, limits, weights=UNIFORM, short=0.7, long=1.4):
        self.work, self.sigma, self.limits = work, sigma, np.asarray(limits, float)
        self.weights, self.short, self.long = weights, short, long
        self.flip_limits = self.limits
        self.least_agreement = float(self.limits[2])

    def run(
        self, length, iterations, vertices=None, delaunay_rounds=2, final_sigma=None, progress=None
    ):
        """Run the loop; return the last target length of its rounds.

        The target follows the count, if one is asked, or else is corrected until the mean edge,
        measured with `final_sigma`, is as long as asked.
        """
        final_sigma = self.sigma if final_sigma is None else final_sigma
        asked = length
        for i in range(iterations):
            if self.work.sizing is not None:
                self.work.sizing.aim(length)
            if i == 0 and self.is_much_finer(length, vertices):
                self.coarsen(length)
            else:
                self.refine(length)
            rule = VALENCE if i < iterations - delaunay_rounds else DELAUNAY
            flip_edges(self.work, self.sigma, self.flip_limits, rule)
            for _ in range(2):
                smooth_vertices(self.work, self.sigma, self.limits, self.weights)
            if i < iterations - 1:
                if vertices is not None:
                    ratio = self.work.vertices / vertices
                else:
                    ratio = asked / self.edge_lengths(final_sigma, self.long * length).mean()
                length *= min(max(ratio, 0.5), 2.0) ** COUNT_FEEDBACK
                if vertices is None:
                    length = min(max(length, LEAST_AIM * asked), MOST_AIM * asked)
            if progress is not None:
                progress((i + 1) / iterations)
        return length

    def is_much_finer(self, length, vertices):
        """Whether the mesh is to lose more than half of its vertices."""
        if vertices is not None:
            return self.work.vertices > 2 * vertices
        return self.edge_lengths().mean() < np.sqrt(0.5) * length

    def coarsen(self, length):
        """First round on a mesh much finer than asked: collapse in three steps."""
        for factor in COARSENING_STEPS:
            collapse_short_edges(
                self.work, self.short * length * factor, self.long * length, self.sigma,
                (0.0, 0.0, self.least_agreement),
            )  # fmt: skip
            self.work.compact()
            flip_edges(self.work, self.sigma, self.flip_limits, DELAUNAY, 2)
            smooth_vertices(self.work, self.sigma, self.limits, self.weights)

    def refine(self, length):
        """Split what is too long, collapse what is too short."""
        for _ in range(MOST_SPLIT_PASSES):
            before = self.work.vertices
            split_long_edges(self.work, self.long * length, self.sigma, self.least_agreement)
            if self.work.vertices < MANY_SPLITS * before:
                break
            flip_edges(self.work, self.sigma, self.flip_limits, DELAUNAY, 2)
        collapse_short_edges(
            self.work, self.short * length, self.long * length, self.sigma, self.limits
        )
        self.work.compact()

    def meet_count(self, vertices, length, rounds=6, tolerance=0.002):
        """Collapse the shortest or split the longest edges until the count is met."""
        for _ in range(rounds):
            excess = self.work.vertices - vertices
            if abs(excess) <= tolerance * vertices:
                break
            if excess > 0:
                lengths = np.sort(self.edge_lengths(longest=self.long * length))
                bound = lengths[min(int(1.3 * excess), len(lengths) - 1)]
                limits = (0.0, 0.0, self.least_agreement)
                collapse_short_edges(
                    self.work, bound, 2.0 * length, self.sigma, limits, at_most=excess
                )
            else:
                self.split_longest(-excess, length)
            self.work.compact()
            flip_edges(self.work, self.sigma, (25.0, 0.0, self.limits[2]), VALENCE, 3)
            smooth_vertices(self.work, self.sigma, (20.0, 0.0, self.limits[2]), UNIFORM, 0.7)

    def split_longest(self, count, length):
        """Split about so many edges, the longest."""
        lengths = np.sort(self.edge_lengths(longest=self.long * length))
        bound = lengths[max(len(lengths) - count - 1, 0)]
        split_long_edges(self.work, bound, self.sigma, self.least_agreement, at_most=count)

    def edge_lengths(self, sigma=None, longest=0.0):
        """6D lengths of all edges (those of a feature by one of its sides), by the work's sizing.

        longest : float [unit of the points]
            6D length above which edges are split, so that those at the limit in 3D have it.
        """
        sigma = self.sigma if sigma is None else sigma
        first, last = self.work.edge_rows()
        step = self.work.rows[first, :6] - self.work.rows[last, :6]
        step[:, 3:] *= sigma
        square = np.einsum("ij,ij->i", step, step)
        if self.work.sizing is None:
            return np.sqrt(square)
        square3 = np.einsum("ij,ij->i", step[:, :3], step[:, :3])
        return self.work.sizing.lengths(self.work, first, last, square3, square, longest)
