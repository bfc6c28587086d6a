"""A hierarchy of levels: patterns once per mesh, numbers once per matrix.

On every level the smoother damps what varies quickly from node to node. What it leaves is nearly a
rigid-body motion in every neighbourhood, so it can be said with far fewer unknowns: six for each
aggregate. The prolongator P translates from those to the level's nodes, and the coarse matrix is
the level's own energy seen through it, P^T A P. The tentative T is exact for rigid-body motions
but tears at the borders of the aggregates; one smoothing step, P = (I - omega D^-1 A) T, mends
that (Vanek, Mandel and Brezina 1996), with omega = 4 / (3 lambda_max(D^-1 A)).

The numbers are in single precision: a preconditioner need not be accurate, and it is memory
bandwidth that takes the time.
"""

import numpy as np
from scipy.linalg import lapack
from threadpoolctl import ThreadpoolController

from meshes.errors import NotConverged
from topopt.multigrid import cycle_kernels, galerkin_kernels
from topopt.multigrid.aggregation import aggregate_level
from topopt.multigrid.patterns import INDEX, Pattern, transfer_patterns

SINGLE = np.float32
COARSEST_UNKNOWNS = 800  # small enough for a dense inverse
MAX_LEVELS = 12
PIVOT_FLOOR = 1e-6  # of a diagonal entry: below it a pivot is rounding
COARSEST_SHIFT = 1e-7  # relative to the diagonal: the rounding of single precision
REFERENCE_POWER_STEPS = 20
POWER_STEPS = 5


class Level:
    """One level: its matrix A, block-Jacobi D^-1, and the vectors a cycle works on.

    Parameters
    ----------
    pattern : Pattern
    width : int
        Unknowns per node: 3 on the finest level, 6 below.
    transfer : TransferPatterns or None
        None on the coarsest level.
    aggregation : Aggregation or None
    """

    def __init__(self, pattern, width, transfer=None, aggregation=None):
        self.pattern, self.width, self.transfer = pattern, width, transfer
        nodes = pattern.rows
        self.chunks = pattern.chunks
        self.f, self.x, self.other, self.residual, self.step = (
            np.zeros((nodes, width), SINGLE) for _ in range(5)
        )
        if transfer is None:
            return
        rows = np.repeat(np.arange(nodes), np.diff(pattern.indptr))
        self.diagonal = np.flatnonzero(rows == pattern.indices).astype(INDEX)
        self.aggregates = aggregation.aggregates
        self.tentative = aggregation.tentative.astype(SINGLE)
        self.inverse = np.empty((nodes, width, width), SINGLE)
        self.p_blocks = np.empty((len(transfer.prolongator.indices), width, 6), SINGLE)
        self.ap_blocks = np.empty((len(transfer.product.indices), width, 6), SINGLE)
        self.coarse_blocks = np.empty((len(transfer.coarse.indices), 6, 6), SINGLE)
        self.largest = 0.0
        self._power_vector = None

    @property
    def matrix(self):
        """A as (indptr, indices, blocks), the way the kernels take it."""
        return self.pattern.indptr, self.pattern.indices, self.blocks

    def set_numbers(self, blocks):
        """Take the blocks of A, and compute D^-1, lambda_max(D^-1 A), P and P^T A P."""
        self.blocks = blocks
        galerkin_kernels.invert_diagonal(
            self.chunks, self.diagonal, blocks, PIVOT_FLOOR, self.inverse
        )
        self._estimate_largest()
        p, ap, c = self.transfer.prolongator, self.transfer.product, self.transfer.coarse
        prolongator = (p.indptr, p.indices, self.p_blocks)
        product = (ap.indptr, ap.indices, self.ap_blocks)
        omega = SINGLE(4.0 / (3.0 * self.largest))
        galerkin_kernels.smooth_prolongator(
            self.chunks, *self.matrix, self.inverse, self.aggregates, self.tentative, omega,
            *prolongator,
        )  # fmt: skip
        galerkin_kernels.multiply(self.chunks, *self.matrix, *prolongator, *product, c.rows)
        r = self.transfer.restriction
        galerkin_kernels.galerkin(
            self.transfer.galerkin_chunks, r.indptr, r.indices, self.transfer.restriction_places,
            self.p_blocks, *product, c.indptr, c.indices, self.transfer.coarse_transposed,
            self.coarse_blocks, c.rows,
        )  # fmt: skip

    def _estimate_largest(self):
        """Power iteration for lambda_max(D^-1 A) from the reference matrix's vector.

        It never goes on from the last matrix's vector: the numbers of a matrix must not depend on
        which matrices came before it.
        """
        first = self._power_vector is None
        x, zero = self.other, self.f
        zero[:] = 0
        x[:] = np.random.default_rng(0).standard_normal(x.shape) if first else self._power_vector
        for _ in range(REFERENCE_POWER_STEPS if first else POWER_STEPS):
            before = cycle_kernels.inner_product(x, x)
            self.apply_step(zero, x, SINGLE(0), SINGLE(1), self.residual)
            after = cycle_kernels.inner_product(self.step, self.step)
            np.multiply(self.step, SINGLE(-1 / np.sqrt(after)), out=x)
            self.largest = float(np.sqrt(after / before))
        if first:
            self._power_vector = x.copy()

    def apply_step(self, f, x, momentum, gain, result):
        """step = momentum step + gain D^-1 (f - A x);  result = x + step."""
        cycle_kernels.chebyshev(
            self.chunks, *self.matrix, self.inverse, f, x, momentum, gain, self.step, result
        )

    def take_residual(self, f, x, result):
        """result = f - A x."""
        cycle_kernels.residual(self.chunks, *self.matrix, f, x, result)

    def restrict(self, coarse):
        """coarse.f = P^T residual."""
        r = self.transfer.restriction
        cycle_kernels.restrict(
            r.chunks, r.indptr, r.indices, self.transfer.restriction_places, self.p_blocks,
            self.residual, coarse.f,
        )  # fmt: skip

    def prolong(self, coarse):
        """x += P coarse.x."""
        p = self.transfer.prolongator
        cycle_kernels.prolong(self.chunks, p.indptr, p.indices, self.p_blocks, coarse.x, self.x)

    def invert(self, blas):
        """On the coarsest level: the dense inverse in blocks, by Cholesky in double precision."""
        nodes, width = self.pattern.rows, self.width
        size = nodes * width
        dense = np.zeros((nodes, width, nodes, width))
        rows = np.repeat(np.arange(nodes), np.diff(self.pattern.indptr))
        dense.transpose(0, 2, 1, 3)[rows, self.pattern.indices] = self.blocks
        dense = dense.reshape(size, size).T  # symmetric: the order LAPACK wants, without a copy
        dense[np.diag_indices(size)] *= 1.0 + COARSEST_SHIFT
        with blas.limit(limits=1, user_api="blas"):
            factor, failed = lapack.dpotrf(dense, lower=0, clean=0, overwrite_a=1)
            if not failed:
                inverse, failed = lapack.dpotri(factor, lower=0, overwrite_c=1)
        if failed:
            raise NotConverged(
                "the coarsest multigrid matrix is not positive definite: the supports leave a "
                "motion free, or the stiffness contrast is beyond single precision; use "
                "solver: direct."
            )
        self.dense_inverse = np.empty((nodes, nodes, width, width), SINGLE)
        galerkin_kernels.whole_blocks(inverse.T, self.dense_inverse)


class Hierarchy:
    """All levels of one mesh, finest first.

    Parameters
    ----------
    matrix : scipy.sparse.bsr_array, (3 n, 3 n) in 3 x 3 blocks
        A matrix with the pattern of all matrices to come, every diagonal block included; best
        that of the uniform material, from which the estimates of lambda_max start.
    modes : (n, 3, 6) float array
        Near-null modes (rigid-body motions), zero at fixed degrees of freedom.
    coarsest : int
        A level of at most so many unknowns is the last: it is inverted as a dense matrix.
    """

    def __init__(self, matrix, modes, coarsest=COARSEST_UNKNOWNS):
        self.levels = []
        self.aggregations = []
        self._blas = ThreadpoolController()
        pattern = Pattern.of(matrix)
        graph = pattern.graph()
        while pattern.rows * modes.shape[1] > coarsest and len(self.levels) < MAX_LEVELS:
            aggregation = aggregate_level(graph.indptr, graph.indices, modes)
            if aggregation.count >= 0.8 * pattern.rows or aggregation.count == 0:
                break
            transfer = transfer_patterns(pattern, graph, aggregation)
            self.levels.append(Level(pattern, modes.shape[1], transfer, aggregation))
            self.aggregations.append(aggregation)
            pattern, graph, modes = transfer.coarse, transfer.graph, aggregation.coarse_modes
        self.levels.append(Level(pattern, modes.shape[1]))
        self._finest = np.empty(matrix.data.shape, SINGLE)
        rows = np.repeat(np.arange(len(matrix.indptr) - 1), np.diff(matrix.indptr))
        self._diagonal = np.flatnonzero(rows == matrix.indices)
        self.update(matrix.data)

    def update(self, blocks):
        """Take the blocks (nnz, 3, 3) of a new matrix, and recompute every level's numbers."""
        finest = self.levels[0]
        self.scale = 1.0 / blocks[self._diagonal].diagonal(axis1=1, axis2=2).max()
        starts = finest.pattern.indptr[finest.chunks]
        galerkin_kernels.scale_to_single(starts, blocks, self.scale, self._finest)
        numbers = self._finest
        for level in self.levels[:-1]:
            level.set_numbers(numbers)
            numbers = level.coarse_blocks
        self.levels[-1].blocks = numbers
        self.levels[-1].invert(self._blas)
