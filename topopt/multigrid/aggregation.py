"""Aggregates and the tentative prolongator: the geometry of smoothed aggregation.

An aggregate is a handful of neighbouring nodes that move as one on the coarser level. The moves a
coarse node can make are those the smoother cannot tell from zero: the six rigid-body motions of
its aggregate, made orthonormal. All of it depends on the mesh alone and is done once.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from topopt.multigrid import aggregation_kernels as kernels

DEPENDENT = 1e-6  # a mode with less than this of its length left depends on those before it


@dataclass(frozen=True, eq=False)
class Aggregation:
    """One level's step to the next coarser one.

    Parameters
    ----------
    aggregates : (n,) int32 array
        The aggregate of each node; negative for nodes that take no part (all fixed).
    count : int
        Number of aggregates N.
    tentative : (n, b, 6) float array
        T: block row i stands in the block column of i's aggregate; orthonormal columns.
    coarse_modes : (N, 6, 6) float array
        The near-null modes on the coarse level: T coarse_modes = modes.
    """

    aggregates: np.ndarray
    count: int
    tentative: np.ndarray
    coarse_modes: np.ndarray


def aggregate_nodes(indptr, indices, taking_part):
    """Group the nodes of a graph into aggregates of a node and its neighbours.

    Parameters
    ----------
    indptr, indices : int arrays
        The graph, in CSR form.
    taking_part : (n,) bool array

    Returns
    -------
    aggregates : (n,) int32 array
    count : int
    """
    aggregates = np.where(taking_part, kernels.UNDECIDED, kernels.LEFT_OUT).astype(np.int32)
    count = kernels.aggregate(indptr, indices, aggregates)
    return aggregates, count


def aggregate_level(indptr, indices, modes):
    """Aggregate one level and represent its near-null modes on the aggregates.

    Parameters
    ----------
    indptr, indices : int arrays
        The graph of the level. On coarser levels this is the graph of the aggregates themselves,
        not the wider pattern of the smoothed Galerkin matrix, which would coarsen too fast.
    modes : (n, b, 6) float array
        Near-null modes; a node where all are zero takes no part.

    Returns
    -------
    Aggregation
    """
    aggregates, count = aggregate_nodes(indptr, indices, np.any(modes != 0.0, axis=(1, 2)))
    start, members = _members(aggregates, count)
    tentative = np.zeros_like(modes)
    coarse_modes = np.zeros((count, modes.shape[2], modes.shape[2]))
    kernels.orthonormalise(start, members, modes, DEPENDENT, tentative, coarse_modes)
    return Aggregation(aggregates, count, tentative, coarse_modes)


def _members(aggregates, count):
    """Return the nodes sorted by aggregate, and where each aggregate's nodes start."""
    nodes = np.flatnonzero(aggregates >= 0)
    order = nodes[np.argsort(aggregates[nodes], kind="stable")]
    start = np.searchsorted(aggregates[order], np.arange(count + 1))
    return start.astype(np.int32), order.astype(np.int32)


def membership(aggregates, count):
    """Return Q (n, N), with Q[i, g] = 1 where node i belongs to aggregate g: csr_array."""
    inside = aggregates >= 0
    indptr = np.concatenate([[0], np.cumsum(inside)]).astype(np.int32)
    ones = np.ones(indptr[-1], np.int32)
    return csr_array((ones, aggregates[inside], indptr), shape=(len(aggregates), count))
