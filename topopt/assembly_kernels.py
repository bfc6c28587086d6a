"""Gather kernels that turn gradients and volumes into the stiffness matrix.

Every kernel writes only to the rows or edges of its own index, so that threads never meet and the
sums are taken in a fixed order.
"""

import numpy as np
from numba import njit, prange

from topopt.lanes import add_outer, load, scale, store, zero_rows

OPTIONS = {"cache": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy"}


@njit(parallel=True, **OPTIONS)
def edge_blocks(
    chunks, edge_start, edge_corners, weights, gradients, lame_lambda, lame_mu, upper, lower, blocks
):
    """Blocks (i, j) and (j, i) of every mesh edge i < j, summed over the tets around the edge.

    edge_corners[s] = 16 e + 4 a + b: on tet e, node i is corner a and node j is corner b.
    With O = sum of weight_e g_a g_b^T the block is lambda O + mu O^T + mu tr(O) I.
    """
    for t in prange(chunks.shape[0] - 1):
        outer = np.empty((3, 3))
        for edge in range(chunks[t], chunks[t + 1]):
            rows = zero_rows(gradients, 3, 3)
            for s in range(edge_start[edge], edge_start[edge + 1]):
                code = edge_corners[s]
                e = code >> 4
                first = load(gradients, 4 * e + ((code >> 2) & 3), 3)
                second = load(gradients, 4 * e + (code & 3), 3)
                rows = add_outer(rows, scale(weights[e], first), second)
            store(rows[0], outer, 0)
            store(rows[1], outer, 1)
            store(rows[2], outer, 2)
            trace = lame_mu * (outer[0, 0] + outer[1, 1] + outer[2, 2])
            for i in range(3):
                for j in range(3):
                    value = lame_lambda * outer[i, j] + lame_mu * outer[j, i]
                    if i == j:
                        value += trace
                    blocks[upper[edge], i, j] = value
                    blocks[lower[edge], j, i] = value


@njit(parallel=True, **OPTIONS)
def diagonal_and_supports(indptr, indices, diagonal, fixed, blocks):
    """Fill the diagonal blocks, then take the fixed degrees of freedom out of every row.

    A rigid translation costs no energy, so a diagonal block is minus the sum of its row's others.
    Rows and columns of fixed degrees of freedom are zeroed, their diagonal entry is kept.
    """
    for row in prange(indptr.shape[0] - 1):
        centre = diagonal[row]
        for i in range(3):
            for j in range(3):
                blocks[centre, i, j] = 0.0
        for k in range(indptr[row], indptr[row + 1]):
            if k != centre:
                for i in range(3):
                    for j in range(3):
                        blocks[centre, i, j] -= blocks[k, i, j]
        for k in range(indptr[row], indptr[row + 1]):
            column = indices[k]
            for i in range(3):
                for j in range(3):
                    held = fixed[row, i] or fixed[column, j]
                    if held and not (k == centre and i == j):
                        blocks[k, i, j] = 0.0
