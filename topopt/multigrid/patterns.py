"""Where the nonzeros are: everything about a hierarchy that depends on the mesh alone.

With S the graph of a level and Q the membership of nodes in aggregates, the smoothed prolongator
P = (I - omega D^-1 A) T has the pattern S Q, the product A P has S S Q, and the Galerkin matrix
P^T A P has (S Q)^T S S Q. They are found once; the numbers are filled in anew in every step.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from topopt.multigrid.aggregation import membership

INDEX = np.uint32
WORK_PER_CHUNK = 1024  # blocks
MAX_CHUNKS = 64


@dataclass(frozen=True, eq=False)
class Pattern:
    """A sparsity pattern in CSR form (uint32), its rows dealt out in chunks of equal work."""

    indptr: np.ndarray
    indices: np.ndarray
    chunks: np.ndarray

    @classmethod
    def of(cls, matrix):
        """The pattern of a scipy matrix, columns sorted."""
        matrix.sort_indices()
        chunks = equal_chunks(np.diff(matrix.indptr))
        return cls(matrix.indptr.astype(INDEX), matrix.indices.astype(INDEX), chunks)

    def graph(self, n_columns=None):
        """The pattern as a csr_array of ones (n_columns: as many as rows)."""
        shape = (len(self.indptr) - 1, n_columns or len(self.indptr) - 1)
        return csr_array((np.ones(len(self.indices), np.float32), *self.signed), shape=shape)

    @property
    def signed(self):
        """Indices and indptr as scipy takes them (int32), without a copy."""
        return self.indices.view(np.int32), self.indptr.view(np.int32)

    @property
    def rows(self):
        return len(self.indptr) - 1


@dataclass(frozen=True, eq=False)
class TransferPatterns:
    """Patterns that lead from one level to the next coarser one.

    Parameters
    ----------
    prolongator : Pattern, (n, N)
    restriction : Pattern, (N, n)
        The transpose of the prolongator.
    restriction_places : uint32 array
        Where each block of the restriction stands among the prolongator's.
    product : Pattern, (n, N), of A P
    coarse : Pattern, (N, N), of P^T A P
    coarse_transposed : uint32 array
        Where block (h, g) of the coarse matrix stands, for each block (g, h).
    galerkin_chunks : int array
        Coarse rows, dealt out by the work of the upper half of P^T (A P).
    graph : csr_array, (N, N)
        Q^T S Q: which aggregates touch; the graph the next level is aggregated on.
    """

    prolongator: Pattern
    restriction: Pattern
    restriction_places: np.ndarray
    product: Pattern
    coarse: Pattern
    coarse_transposed: np.ndarray
    galerkin_chunks: np.ndarray
    graph: csr_array


def equal_chunks(work):
    """Deal rows out in chunks of about equal work: first row of each, and the end (k + 1,).

    The chunks depend on the rows only, never on the number of threads: sums over chunks come out
    the same on any machine.
    """
    count = max(1, min(MAX_CHUNKS, len(work), int(np.sum(work)) // WORK_PER_CHUNK))
    total = np.concatenate([[0], np.cumsum(work)])
    inner = np.searchsorted(total, np.linspace(0, total[-1], count + 1)[1:-1])
    return np.concatenate([[0], inner, [len(work)]]).astype(np.int64)


def transfer_patterns(pattern, graph, aggregation):
    """Find the patterns of one level's transfer.

    Parameters
    ----------
    pattern : Pattern
        Of the level's matrix A.
    graph : csr_array
        Which nodes touch: the pattern itself on the finest level.
    aggregation : Aggregation

    Returns
    -------
    TransferPatterns
    """
    member = membership(aggregation.aggregates, aggregation.count).astype(np.float32)
    matrix = pattern.graph()
    prolongator = (matrix @ member).tocsr()
    product = (matrix @ prolongator).tocsr()
    coarse = (prolongator.T.tocsr() @ product).tocsr()
    p, ap, c = (Pattern.of(m) for m in (prolongator, product, coarse))
    restriction, places = _transpose(p, aggregation.count)
    _, coarse_transposed = _transpose(c, aggregation.count)
    coarse_rows = np.repeat(np.arange(c.rows), np.diff(c.indptr))
    upper = np.bincount(coarse_rows, c.indices >= coarse_rows, minlength=c.rows)
    work = upper * np.diff(restriction.indptr)
    touching = (member.T.tocsr() @ (graph.astype(np.float32) @ member)).tocsr()
    touching.sort_indices()
    return TransferPatterns(
        p, restriction, places, ap, c, coarse_transposed, equal_chunks(work), touching
    )


def _transpose(pattern, n_columns):
    """Return the transposed pattern, and where each of its entries stands in the original."""
    number = np.arange(len(pattern.indices))
    numbered = csr_array((number, *pattern.signed), shape=(pattern.rows, n_columns))
    transposed = numbered.T.tocsr()
    transposed.sort_indices()
    return Pattern.of(transposed), transposed.data.astype(INDEX)
