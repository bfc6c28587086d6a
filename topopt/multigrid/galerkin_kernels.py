"""Numeric set-up of one level: block inverses, smoothed prolongator, Galerkin product.

All patterns are known; only numbers are computed. A is (n, n) in blocks (b, b) with b = 3 on the
finest level and 6 below, P is (n, N) in blocks (b, 6), the coarse matrix (N, N) in blocks (6, 6).
Rows are dealt out in chunks that do not depend on the number of threads. The six columns of a
block of P are written out: they are what the processor works on at once. Indices are unsigned:
numba then leaves out the test for negative ones, which costs more than the arithmetic.
"""

import numpy as np
from numba import njit, prange

ONE = np.uint32(1)
OPTIONS = {"cache": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy"}


@njit(parallel=True, **OPTIONS)
def scale_to_single(chunks, blocks, scale, result):
    """result = scale * blocks, in the precision of result."""
    for t in prange(chunks.shape[0] - 1):
        for k in range(chunks[t], chunks[t + 1]):
            for i in range(3):
                for j in range(3):
                    result[k, i, j] = scale * blocks[k, i, j]


@njit(parallel=True, **OPTIONS)
def invert_diagonal(chunks, diagonal, blocks, floor, result):
    """Inverses of the diagonal blocks, by Gauss-Jordan in double precision.

    A pivot below `floor` of its diagonal entry (rounding, in single precision, can leave less
    than nothing of a nearly dependent direction) is replaced by that.
    """
    b = blocks.shape[1]
    for t in prange(chunks.shape[0] - 1):
        work = np.empty((b, b))
        inverse = np.empty((b, b))
        for row in range(chunks[t], chunks[t + 1]):
            for i in range(b):
                for j in range(b):
                    work[i, j] = blocks[diagonal[row], i, j]
                    inverse[i, j] = 1.0 if i == j else 0.0
            for p in range(b):
                pivot = max(work[p, p], floor * blocks[diagonal[row], p, p])
                for j in range(b):
                    work[p, j] /= pivot
                    inverse[p, j] /= pivot
                for i in range(b):
                    if i != p:
                        factor = work[i, p]
                        for j in range(b):
                            work[i, j] -= factor * work[p, j]
                            inverse[i, j] -= factor * inverse[p, j]
            for i in range(b):
                for j in range(b):
                    result[row, i, j] = 0.5 * (inverse[i, j] + inverse[j, i])


@njit(forceinline=True, **OPTIONS)
def _clear(blocks, first, last):
    """blocks[first:last] = 0."""
    for s in range(first, last):
        for i in range(blocks.shape[1]):
            for c in range(6):
                blocks[s, i, c] = 0


@njit(forceinline=True, **OPTIONS)
def _add_product(left, l, right, r, result, s):
    """result[s] (b, 6) += left[l] (b, b) @ right[r] (b, 6)."""
    if left.shape[1] == 3:  # a width the compiler knows makes the loops twice as fast
        _add_product_of(3, left, l, right, r, result, s)
    else:
        _add_product_of(6, left, l, right, r, result, s)


@njit(forceinline=True, **OPTIONS)
def _add_product_of(width, left, l, right, r, result, s):
    for i in range(width):
        s0, s1, s2 = result[s, i, 0], result[s, i, 1], result[s, i, 2]
        s3, s4, s5 = result[s, i, 3], result[s, i, 4], result[s, i, 5]
        for m in range(width):
            a = left[l, i, m]
            s0 += a * right[r, m, 0]
            s1 += a * right[r, m, 1]
            s2 += a * right[r, m, 2]
            s3 += a * right[r, m, 3]
            s4 += a * right[r, m, 4]
            s5 += a * right[r, m, 5]
        result[s, i, 0], result[s, i, 1], result[s, i, 2] = s0, s1, s2
        result[s, i, 3], result[s, i, 4], result[s, i, 5] = s3, s4, s5


@njit(forceinline=True, **OPTIONS)
def _add_transposed_product(left, l, right, r, result, s):
    """result[s] (6, 6) += left[l]^T @ right[r], for left and right (b, 6)."""
    if left.shape[1] == 3:
        _add_transposed_product_of(3, left, l, right, r, result, s)
    else:
        _add_transposed_product_of(6, left, l, right, r, result, s)


@njit(forceinline=True, **OPTIONS)
def _add_transposed_product_of(width, left, l, right, r, result, s):
    for i in range(6):
        s0, s1, s2 = result[s, i, 0], result[s, i, 1], result[s, i, 2]
        s3, s4, s5 = result[s, i, 3], result[s, i, 4], result[s, i, 5]
        for m in range(width):
            a = left[l, m, i]
            s0 += a * right[r, m, 0]
            s1 += a * right[r, m, 1]
            s2 += a * right[r, m, 2]
            s3 += a * right[r, m, 3]
            s4 += a * right[r, m, 4]
            s5 += a * right[r, m, 5]
        result[s, i, 0], result[s, i, 1], result[s, i, 2] = s0, s1, s2
        result[s, i, 3], result[s, i, 4], result[s, i, 5] = s3, s4, s5


@njit(parallel=True, **OPTIONS)
def smooth_prolongator(
    chunks, indptr, indices, blocks, inverse, aggregates, tentative, omega,
    p_indptr, p_indices, p_blocks,
):  # fmt: skip
    """P = (I - omega D^-1 A) T."""
    for t in prange(chunks.shape[0] - 1):
        width = p_blocks.shape[1]
        product = np.empty((width, 6), p_blocks.dtype)
        for row in range(chunks[t], chunks[t + 1]):
            first, last = p_indptr[row], p_indptr[row + 1]
            _clear(p_blocks, first, last)
            for k in range(indptr[row], indptr[row + 1]):
                column = np.uint64(indices[k])
                g = aggregates[column]
                if g >= 0:
                    place = np.uint64(first)
                    while p_indices[place] != g:
                        place += np.uint64(1)
                    _add_product(blocks, k, tentative, column, p_blocks, place)
            for s in range(first, last):
                own = p_indices[s] == aggregates[row]
                for i in range(width):
                    for c in range(6):
                        value = inverse[row, i, 0] * p_blocks[s, 0, c]
                        for m in range(1, width):
                            value += inverse[row, i, m] * p_blocks[s, m, c]
                        product[i, c] = -omega * value
                        if own:
                            product[i, c] += tentative[row, i, c]
                for i in range(width):
                    for c in range(6):
                        p_blocks[s, i, c] = product[i, c]


@njit(parallel=True, **OPTIONS)
def multiply(
    chunks, indptr, indices, blocks, p_indptr, p_indices, p_blocks,
    ap_indptr, ap_indices, ap_blocks, n_coarse,
):  # fmt: skip
    """A P, on its known pattern."""
    for t in prange(chunks.shape[0] - 1):
        place = np.empty(n_coarse, np.uint32)
        for row in range(chunks[t], chunks[t + 1]):
            first, last = ap_indptr[row], ap_indptr[row + 1]
            _clear(ap_blocks, first, last)
            for s in range(first, last):
                place[ap_indices[s]] = s
            for k in range(indptr[row], indptr[row + 1]):
                column = indices[k]
                for q in range(p_indptr[column], p_indptr[column + ONE]):
                    s = np.uint64(place[p_indices[q]])
                    _add_product(blocks, k, p_blocks, q, ap_blocks, s)


@njit(parallel=True, **OPTIONS)
def galerkin_upper(
    chunks, r_indptr, r_indices, r_places, p_blocks, ap_indptr, ap_indices, ap_blocks,
    c_indptr, c_indices, c_blocks, n_coarse,
):  # fmt: skip
    """Upper half of P^T (A P), on its known pattern.

    Row g of P^T has its blocks at p_blocks[r_places[k]], of the fine rows r_indices[k].
    """
    for t in prange(chunks.shape[0] - 1):
        place = np.empty(n_coarse, np.uint32)
        for g in range(chunks[t], chunks[t + 1]):
            first, last = c_indptr[g], c_indptr[g + 1]
            _clear(c_blocks, first, last)
            for s in range(first, last):
                place[c_indices[s]] = s
            for k in range(r_indptr[g], r_indptr[g + 1]):
                row, here = r_indices[k], r_places[k]
                for q in range(ap_indptr[row], ap_indptr[row + ONE]):
                    h = ap_indices[q]
                    if h >= g:
                        _add_transposed_product(p_blocks, here, ap_blocks, q, c_blocks, place[h])


@njit(parallel=True, **OPTIONS)
def mirror(chunks, c_indptr, c_indices, c_transposed, c_blocks):
    """Lower half from the upper one; a coarse unknown that moves nothing gets a diagonal of 1.

    c_transposed[s] is where the block (h, g) stands if the s-th block is (g, h).
    """
    for t in prange(chunks.shape[0] - 1):
        for g in range(chunks[t], chunks[t + 1]):
            for s in range(c_indptr[g], c_indptr[g + 1]):
                if c_indices[s] < g:
                    for i in range(6):
                        for j in range(6):
                            c_blocks[s, i, j] = c_blocks[c_transposed[s], j, i]
                elif c_indices[s] == g:
                    for i in range(6):
                        for j in range(i):
                            c_blocks[s, i, j] = c_blocks[s, j, i]
                        if c_blocks[s, i, i] == 0:
                            c_blocks[s, i, i] = 1
