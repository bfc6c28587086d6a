"""What a multigrid cycle does to vectors: smooth, take the residual, restrict, prolong.

Vectors are (n, b), matrices are in blocks (b, b), prolongators in blocks (b, 6); b is 3 on the
finest level and 6 below. The products with these blocks are where the time goes: a row of a block
is read at once (`lanes`). A width must be a literal number there, hence the branches on b. Rows
are dealt out in chunks that do not depend on the number of threads.
"""

from numba import njit, prange

from topopt.lanes import (
    add,
    add_combination,
    add_rows_times,
    load,
    prefetch,
    row_sums,
    scale,
    store,
    subtract,
    zero,
    zero_rows,
)

OPTIONS = {"cache": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy"}
AHEAD = 4096  # bytes of a matrix asked for before they are needed
EARLY = 16  # blocks of a prolongator asked for before they are needed
INLINE = {"inline": "always", "fastmath": {"contract", "nsz"}, "error_model": "numpy"}


@njit(**INLINE)
def row_product(width, columns, indptr, indices, blocks, x, row):
    """Block row `row` of A x, for blocks (width, columns): Lanes, in the precision of A."""
    sums = zero_rows(blocks, width, columns)
    for k in range(indptr[row], indptr[row + 1]):
        prefetch(blocks, k, width, columns, AHEAD)
        sums = add_rows_times(sums, blocks, k, x, indices[k])
    return row_sums(sums)


@njit(**INLINE)
def _residual_row(width, row, indptr, indices, blocks, f, x, result):
    y = row_product(width, width, indptr, indices, blocks, x, row)
    store(subtract(load(f, row, width), y), result, row)


@njit(parallel=True, **OPTIONS)
def residual(chunks, indptr, indices, blocks, f, x, result):
    """result = f - A x."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            if f.shape[1] == 3:
                _residual_row(3, row, indptr, indices, blocks, f, x, result)
            else:
                _residual_row(6, row, indptr, indices, blocks, f, x, result)


@njit(**INLINE)
def _chebyshev_row(
    width, row, indptr, indices, blocks, inverse, f, x, momentum, gain, step, result
):
    y = row_product(width, width, indptr, indices, blocks, x, row)
    r = scale(gain, subtract(load(f, row, width), y))
    moved = scale(momentum, load(step, row, width))
    moved = add_combination(moved, r, inverse, row)  # the inverse block is symmetric
    store(moved, step, row)
    store(add(load(x, row, width), moved), result, row)


@njit(parallel=True, **OPTIONS)
def chebyshev(chunks, indptr, indices, blocks, inverse, f, x, momentum, gain, step, result):
    """step = momentum step + gain D^-1 (f - A x);  result = x + step."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            if f.shape[1] == 3:
                _chebyshev_row(
                    3, row, indptr, indices, blocks, inverse, f, x, momentum, gain, step, result
                )
            else:
                _chebyshev_row(
                    6, row, indptr, indices, blocks, inverse, f, x, momentum, gain, step, result
                )


@njit(**INLINE)
def _first_row(width, row, inverse, f, gain, step, result):
    r = scale(gain, load(f, row, width))
    moved = add_combination(zero(f, width), r, inverse, row)
    store(moved, step, row)
    store(moved, result, row)


@njit(parallel=True, **OPTIONS)
def first_step(chunks, inverse, f, gain, step, result):
    """The same step from x = 0: step = result = gain D^-1 f."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            if f.shape[1] == 3:
                _first_row(3, row, inverse, f, gain, step, result)
            else:
                _first_row(6, row, inverse, f, gain, step, result)


@njit(**INLINE)
def _restrict_row(width, row, r_indptr, r_indices, r_places, p_blocks, residual, result):
    total = zero(result, 6)
    for k in range(r_indptr[row], r_indptr[row + 1]):
        prefetch(p_blocks, r_places[min(k + EARLY, r_places.shape[0] - 1)], width, 6, 0)
        total = add_combination(total, load(residual, r_indices[k], width), p_blocks, r_places[k])
    store(total, result, row)


@njit(parallel=True, **OPTIONS)
def restrict(chunks, r_indptr, r_indices, r_places, p_blocks, residual, result):
    """result = P^T residual, gathered: row g of P^T has its blocks at p_blocks[r_places[k]]."""
    for t in prange(chunks.shape[0] - 1):
        for g in range(chunks[t], chunks[t + 1]):
            if residual.shape[1] == 3:
                _restrict_row(3, g, r_indptr, r_indices, r_places, p_blocks, residual, result)
            else:
                _restrict_row(6, g, r_indptr, r_indices, r_places, p_blocks, residual, result)


@njit(**INLINE)
def _prolong_row(width, row, p_indptr, p_indices, p_blocks, coarse, x):
    correction = row_product(width, 6, p_indptr, p_indices, p_blocks, coarse, row)
    store(add(load(x, row, width), correction), x, row)


@njit(parallel=True, **OPTIONS)
def prolong(chunks, p_indptr, p_indices, p_blocks, coarse, x):
    """x += P coarse."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            if x.shape[1] == 3:
                _prolong_row(3, row, p_indptr, p_indices, p_blocks, coarse, x)
            else:
                _prolong_row(6, row, p_indptr, p_indices, p_blocks, coarse, x)


@njit(**INLINE)
def _dense_row(width, row, blocks, f, result):
    nodes = f.shape[0]
    sums = zero_rows(blocks, width, width)
    for column in range(nodes):
        sums = add_rows_times(sums, blocks, row * nodes + column, f, column)
    store(row_sums(sums), result, row)


@njit(**OPTIONS)
def dense_product(blocks, f, result):
    """result = A f for a dense matrix of n x n blocks (b, b), given block row by block row."""
    for row in range(f.shape[0]):
        if f.shape[1] == 3:
            _dense_row(3, row, blocks, f, result)
        else:
            _dense_row(6, row, blocks, f, result)


@njit(**OPTIONS)
def inner_product(a, b):
    """Inner product of (n, b) arrays in double precision, in one fixed order."""
    total = 0.0
    for i in range(a.shape[0]):
        for c in range(a.shape[1]):
            total += a[i, c] * b[i, c]
    return total
