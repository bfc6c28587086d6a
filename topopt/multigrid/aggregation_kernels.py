"""Serial kernels that build aggregates and the tentative prolongator, once per mesh."""

import numpy as np
from numba import njit

UNDECIDED = -1
LEFT_OUT = -2


@njit(cache=True)
def aggregate(indptr, indices, aggregates):
    """Greedy aggregation of a graph; returns the number of aggregates.

    On entry aggregates[i] is UNDECIDED, or LEFT_OUT for nodes that take no part. Pass 1 makes an
    aggregate of every node whose neighbourhood is untouched; pass 2 lets the nodes in between
    join a neighbouring aggregate; pass 3 gathers what is still left.
    """
    n = indptr.shape[0] - 1
    count = 0
    for i in range(n):
        if aggregates[i] != UNDECIDED:
            continue
        untouched = True
        for k in range(indptr[i], indptr[i + 1]):
            untouched &= aggregates[indices[k]] < 0
        if untouched:
            aggregates[i] = count
            for k in range(indptr[i], indptr[i + 1]):
                if aggregates[indices[k]] == UNDECIDED:
                    aggregates[indices[k]] = count
            count += 1
    joined = np.empty(n, np.int32)
    for i in range(n):
        joined[i] = aggregates[i]
        if aggregates[i] == UNDECIDED:
            for k in range(indptr[i], indptr[i + 1]):
                if aggregates[indices[k]] >= 0:
                    joined[i] = aggregates[indices[k]]
                    break
    for i in range(n):
        aggregates[i] = joined[i]
    for i in range(n):
        if aggregates[i] == UNDECIDED:
            aggregates[i] = count
            for k in range(indptr[i], indptr[i + 1]):
                if aggregates[indices[k]] == UNDECIDED:
                    aggregates[indices[k]] = count
            count += 1
    return count


@njit(cache=True)
def orthonormalise(start, members, modes, drop, tentative, coarse_modes):
    """Modified Gram-Schmidt of the near-null modes, twice over, on each aggregate by itself.

    members[start[g]:start[g + 1]] are the nodes of aggregate g, modes (n, b, 6) what has to be
    represented. On exit tentative (n, b, 6) has orthonormal columns on every aggregate and
    tentative @ coarse_modes[g] = modes there. A column whose remainder is below `drop` of its
    length depends on the others (an aggregate of one node has no rotations): it is left zero.
    """
    width = modes.shape[1]
    columns = modes.shape[2]
    for g in range(start.shape[0] - 1):
        nodes = members[start[g] : start[g + 1]]
        for c in range(columns):
            length = 0.0
            for r in nodes:
                for i in range(width):
                    tentative[r, i, c] = modes[r, i, c]
                    length += modes[r, i, c] ** 2
            for _ in range(2):
                for before in range(c):
                    dot = 0.0
                    for r in nodes:
                        for i in range(width):
                            dot += tentative[r, i, before] * tentative[r, i, c]
                    coarse_modes[g, before, c] += dot
                    for r in nodes:
                        for i in range(width):
                            tentative[r, i, c] -= dot * tentative[r, i, before]
            rest = 0.0
            for r in nodes:
                for i in range(width):
                    rest += tentative[r, i, c] ** 2
            norm = np.sqrt(rest) if rest > drop * drop * length else 0.0
            coarse_modes[g, c, c] = norm
            for r in nodes:
                for i in range(width):
                    tentative[r, i, c] = tentative[r, i, c] / norm if norm > 0.0 else 0.0
