"""Sums over the tets around each node, in a fixed order."""

from numba import njit, prange


@njit(cache=True, parallel=True, error_model="numpy")
def node_sums(start, corners, local, result):
    """result[i] = sum of local[c] over the corners c = 4 e + a of tets at node i."""
    for i in prange(result.shape[0]):
        total = 0.0
        for k in range(start[i], start[i + 1]):
            total += local[corners[k]]
        result[i] = total
