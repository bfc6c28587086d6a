"""Numeric set-up of one level: block inverses, smoothed prolongator, Galerkin product.

All patterns are known; only numbers are computed. A is (n, n) in blocks (b, b) with b = 3 on the
finest level and 6 below, P is (n, N) in blocks (b, 6), the coarse matrix (N, N) in blocks (6, 6).
Products of blocks are taken a row of six at once (`lanes`); a width must be a literal number
there, hence the branches on b. Rows are dealt out in chunks that do not depend on the number of
threads.
"""

import numpy as np
from numba import njit, prange

from topopt.lanes import (
    add,
    add_product,
    add_transposed_product,
    convert,
    load,
    scale,
    store,
    subtract,
    transform,
    zero,
)
from topopt.multigrid.cycle_kernels import INLINE, OPTIONS


@njit(parallel=True, **OPTIONS)
def scale_to_single(chunks, blocks, factor, result):
    """result = factor * blocks, in the precision of result."""
    for t in prange(chunks.shape[0] - 1):
        for k in range(chunks[t], chunks[t + 1]):
            for i in range(3):
                for j in range(3):
                    result[k, i, j] = factor * blocks[k, i, j]


@njit(**INLINE)
def _invert_block(width, k, blocks, floor, work):
    """work = the inverse of block k, by Gauss-Jordan in place."""
    for i in range(width):
        store(convert(load(blocks, width * k + i, width), work), work, i)
    for p in range(width):
        pivot = max(work[p, p], floor * blocks[k, p, p])
        work[p, p] = 1.0
        own = scale(1.0 / pivot, load(work, p, width))
        for i in range(width):
            factor = work[i, p]
            work[i, p] = 0.0
            store(subtract(load(work, i, width), scale(factor, own)), work, i)
        store(own, work, p)


@njit(parallel=True, **OPTIONS)
def invert_diagonal(chunks, diagonal, blocks, floor, result):
    """Inverses of the diagonal blocks, in double precision.

    A pivot below `floor` of its diagonal entry (rounding, in single precision, can leave less
    than nothing of a nearly dependent direction) is replaced by that.
    """
    b = blocks.shape[1]
    for t in prange(chunks.shape[0] - 1):
        work = np.empty((b, b))
        for row in range(chunks[t], chunks[t + 1]):
            k = np.int64(diagonal[row])
            if b == 3:
                _invert_block(3, k, blocks, floor, work)
            else:
                _invert_block(6, k, blocks, floor, work)
            for i in range(b):
                for j in range(i + 1):
                    mean = 0.5 * (work[i, j] + work[j, i])
                    result[row, i, j] = mean
                    result[row, j, i] = mean


@njit(**INLINE)
def _clear(width, blocks, first, last):
    """blocks[first:last] = 0, for blocks (width, 6)."""
    for row in range(width * np.int64(first), width * np.int64(last)):
        store(zero(blocks, 6), blocks, row)


@njit(**INLINE)
def _smooth_row(
    width, row, indptr, indices, blocks, inverse, aggregates, tentative, omega,
    p_indptr, p_indices, p_blocks,
):  # fmt: skip
    first, last = p_indptr[row], p_indptr[row + 1]
    _clear(width, p_blocks, first, last)
    for k in range(indptr[row], indptr[row + 1]):
        column = indices[k]
        g = aggregates[column]
        if g >= 0:
            s = np.int64(first)
            while p_indices[s] != g:
                s += 1
            add_product(blocks, k, tentative, column, p_blocks, s, width)
    for s in range(first, last):
        transform(inverse, row, -omega, p_blocks, s, width)
        if p_indices[s] == aggregates[row]:
            for i in range(width):
                here = width * np.int64(s) + i
                own = load(tentative, width * row + i, 6)
                store(add(load(p_blocks, here, 6), own), p_blocks, here)


@njit(parallel=True, **OPTIONS)
def smooth_prolongator(
    chunks, indptr, indices, blocks, inverse, aggregates, tentative, omega,
    p_indptr, p_indices, p_blocks,
):  # fmt: skip
    """P = (I - omega D^-1 A) T."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            if blocks.shape[1] == 3:
                _smooth_row(
                    3, row, indptr, indices, blocks, inverse, aggregates, tentative, omega,
                    p_indptr, p_indices, p_blocks,
                )  # fmt: skip
            else:
                _smooth_row(
                    6, row, indptr, indices, blocks, inverse, aggregates, tentative, omega,
                    p_indptr, p_indices, p_blocks,
                )  # fmt: skip


@njit(**INLINE)
def _multiply_row(
    width, row, place, indptr, indices, blocks, p_indptr, p_indices, p_blocks,
    ap_indptr, ap_indices, ap_blocks,
):  # fmt: skip
    first, last = ap_indptr[row], ap_indptr[row + 1]
    _clear(width, ap_blocks, first, last)
    for s in range(first, last):
        place[ap_indices[s]] = s
    for k in range(indptr[row], indptr[row + 1]):
        column = np.int64(indices[k])
        for q in range(p_indptr[column], p_indptr[column + 1]):
            add_product(blocks, k, p_blocks, q, ap_blocks, place[p_indices[q]], width)


@njit(parallel=True, **OPTIONS)
def multiply(
    chunks, indptr, indices, blocks, p_indptr, p_indices, p_blocks,
    ap_indptr, ap_indices, ap_blocks, n_coarse,
):  # fmt: skip
    """A P, on its known pattern."""
    for t in prange(chunks.shape[0] - 1):
        place = np.empty(n_coarse, np.uint32)
        for row in range(chunks[t], chunks[t + 1]):
            if blocks.shape[1] == 3:
                _multiply_row(
                    3, row, place, indptr, indices, blocks, p_indptr, p_indices, p_blocks,
                    ap_indptr, ap_indices, ap_blocks,
                )  # fmt: skip
            else:
                _multiply_row(
                    6, row, place, indptr, indices, blocks, p_indptr, p_indices, p_blocks,
                    ap_indptr, ap_indices, ap_blocks,
                )  # fmt: skip


@njit(**INLINE)
def _galerkin_row(
    width, g, place, r_indptr, r_indices, r_places, p_blocks, ap_indptr, ap_indices, ap_blocks,
    c_indptr, c_indices, c_blocks,
):  # fmt: skip
    for s in range(c_indptr[g], c_indptr[g + 1]):
        place[c_indices[s]] = s
    _clear(6, c_blocks, place[g], c_indptr[g + 1])
    for k in range(r_indptr[g], r_indptr[g + 1]):
        row, here = np.int64(r_indices[k]), r_places[k]
        for q in range(ap_indptr[row], ap_indptr[row + 1]):
            h = ap_indices[q]
            if h >= g:
                add_transposed_product(p_blocks, here, ap_blocks, q, c_blocks, place[h], width)


@njit(**INLINE)
def _mirror_row(g, diagonal, last, c_transposed, c_blocks):
    """Blocks (h, g) from the blocks (g, h), h >= g; a coarse unknown that moves nothing gets 1."""
    for i in range(6):
        for j in range(i):
            c_blocks[diagonal, i, j] = c_blocks[diagonal, j, i]
        if c_blocks[diagonal, i, i] == 0:
            c_blocks[diagonal, i, i] = 1
    for s in range(diagonal + 1, last):
        for i in range(6):
            for j in range(6):
                c_blocks[c_transposed[s], i, j] = c_blocks[s, j, i]


@njit(parallel=True, **OPTIONS)
def galerkin(
    chunks, r_indptr, r_indices, r_places, p_blocks, ap_indptr, ap_indices, ap_blocks,
    c_indptr, c_indices, c_transposed, c_blocks, n_coarse,
):  # fmt: skip
    """P^T (A P), on its known pattern: the upper half, mirrored.

    Row g of P^T has its blocks at p_blocks[r_places[k]], of the fine rows r_indices[k].
    c_transposed[s] is where the block (h, g) stands if the s-th block is (g, h): whoever computes
    the one writes the other, too.
    """
    for t in prange(chunks.shape[0] - 1):
        place = np.empty(n_coarse, np.uint32)
        for g in range(chunks[t], chunks[t + 1]):
            if p_blocks.shape[1] == 3:
                _galerkin_row(
                    3, g, place, r_indptr, r_indices, r_places, p_blocks,
                    ap_indptr, ap_indices, ap_blocks, c_indptr, c_indices, c_blocks,
                )  # fmt: skip
            else:
                _galerkin_row(
                    6, g, place, r_indptr, r_indices, r_places, p_blocks,
                    ap_indptr, ap_indices, ap_blocks, c_indptr, c_indices, c_blocks,
                )  # fmt: skip
            _mirror_row(g, np.int64(place[g]), np.int64(c_indptr[g + 1]), c_transposed, c_blocks)


@njit(**OPTIONS)
def whole_blocks(lower, blocks):
    """Blocks (n, n, b, b) of the symmetric matrix (n b, n b) whose lower half is given."""
    b = blocks.shape[2]
    for g in range(blocks.shape[0]):
        for h in range(g + 1):
            for i in range(b):
                for j in range(b):
                    if h < g or j <= i:
                        blocks[g, h, i, j] = blocks[h, g, j, i] = lower[g * b + i, h * b + j]
