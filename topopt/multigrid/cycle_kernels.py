"""What a multigrid cycle does to vectors: smooth, take the residual, restrict, prolong.

Vectors are (n, b), matrices are in blocks (b, b); b is 3 on the finest level and 6 below, and the
products with these blocks are written out because they are where the time goes. Rows are dealt
out in chunks that do not depend on the number of threads. Indices are unsigned: numba then leaves
out the test for negative ones, which costs more than the arithmetic.
"""

from numba import njit, prange

OPTIONS = {"cache": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy"}


@njit(forceinline=True, **OPTIONS)
def _row_product_3(indptr, indices, blocks, x, row):
    """The three entries of block row `row` of A x."""
    zero = blocks.dtype.type(0)
    y0, y1, y2 = zero, zero, zero
    for k in range(indptr[row], indptr[row + 1]):
        j = indices[k]
        x0, x1, x2 = x[j, 0], x[j, 1], x[j, 2]
        y0 += blocks[k, 0, 0] * x0 + blocks[k, 0, 1] * x1 + blocks[k, 0, 2] * x2
        y1 += blocks[k, 1, 0] * x0 + blocks[k, 1, 1] * x1 + blocks[k, 1, 2] * x2
        y2 += blocks[k, 2, 0] * x0 + blocks[k, 2, 1] * x1 + blocks[k, 2, 2] * x2
    return y0, y1, y2


@njit(forceinline=True, **OPTIONS)
def _row_product_6(indptr, indices, blocks, x, row):
    """The six entries of block row `row` of A x, A symmetric: columns are read as rows."""
    zero = blocks.dtype.type(0)
    y0, y1, y2, y3, y4, y5 = zero, zero, zero, zero, zero, zero
    for k in range(indptr[row], indptr[row + 1]):
        j = indices[k]
        for c in range(6):
            xc = x[j, c]
            y0 += blocks[k, 0, c] * xc
            y1 += blocks[k, 1, c] * xc
            y2 += blocks[k, 2, c] * xc
            y3 += blocks[k, 3, c] * xc
            y4 += blocks[k, 4, c] * xc
            y5 += blocks[k, 5, c] * xc
    return y0, y1, y2, y3, y4, y5


@njit(parallel=True, **OPTIONS)
def residual_3(chunks, indptr, indices, blocks, f, x, result):
    """result = f - A x."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            y = _row_product_3(indptr, indices, blocks, x, row)
            for i in range(3):
                result[row, i] = f[row, i] - y[i]


@njit(parallel=True, **OPTIONS)
def residual_6(chunks, indptr, indices, blocks, f, x, result):
    """result = f - A x."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            y = _row_product_6(indptr, indices, blocks, x, row)
            for i in range(6):
                result[row, i] = f[row, i] - y[i]


@njit(parallel=True, **OPTIONS)
def chebyshev_3(chunks, indptr, indices, blocks, inverse, f, x, momentum, gain, step, result):
    """step = momentum step + gain D^-1 (f - A x);  result = x + step."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            y = _row_product_3(indptr, indices, blocks, x, row)
            r0, r1, r2 = f[row, 0] - y[0], f[row, 1] - y[1], f[row, 2] - y[2]
            for i in range(3):
                d = inverse[row, i, 0] * r0 + inverse[row, i, 1] * r1 + inverse[row, i, 2] * r2
                step[row, i] = momentum * step[row, i] + gain * d
                result[row, i] = x[row, i] + step[row, i]


@njit(parallel=True, **OPTIONS)
def chebyshev_6(chunks, indptr, indices, blocks, inverse, f, x, momentum, gain, step, result):
    """step = momentum step + gain D^-1 (f - A x);  result = x + step."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            y = _row_product_6(indptr, indices, blocks, x, row)
            for i in range(6):
                d = inverse.dtype.type(0)
                for c in range(6):
                    d += inverse[row, i, c] * (f[row, c] - y[c])
                step[row, i] = momentum * step[row, i] + gain * d
                result[row, i] = x[row, i] + step[row, i]


@njit(parallel=True, **OPTIONS)
def first_step(chunks, inverse, f, gain, step, result):
    """The same step from x = 0: step = result = gain D^-1 f."""
    b = f.shape[1]
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            for i in range(b):
                d = inverse.dtype.type(0)
                for c in range(b):
                    d += inverse[row, i, c] * f[row, c]
                step[row, i] = gain * d
                result[row, i] = gain * d


@njit(forceinline=True, **OPTIONS)
def _restrict_row(width, first, last, rows, places, p_blocks, residual):
    """The six entries of a row of P^T residual."""
    zero = p_blocks.dtype.type(0)
    y0, y1, y2, y3, y4, y5 = zero, zero, zero, zero, zero, zero
    for k in range(first, last):
        place, row = places[k], rows[k]
        for i in range(width):
            value = residual[row, i]
            y0 += p_blocks[place, i, 0] * value
            y1 += p_blocks[place, i, 1] * value
            y2 += p_blocks[place, i, 2] * value
            y3 += p_blocks[place, i, 3] * value
            y4 += p_blocks[place, i, 4] * value
            y5 += p_blocks[place, i, 5] * value
    return y0, y1, y2, y3, y4, y5


@njit(parallel=True, **OPTIONS)
def restrict(chunks, r_indptr, r_indices, r_places, p_blocks, residual, result):
    """result = P^T residual, gathered: row g of P^T has its blocks at p_blocks[r_places[k]]."""
    for t in prange(chunks.shape[0] - 1):
        for g in range(chunks[t], chunks[t + 1]):
            first, last = r_indptr[g], r_indptr[g + 1]
            if residual.shape[1] == 3:  # a width the compiler knows makes the loop faster
                y = _restrict_row(3, first, last, r_indices, r_places, p_blocks, residual)
            else:
                y = _restrict_row(6, first, last, r_indices, r_places, p_blocks, residual)
            for c in range(6):
                result[g, c] = y[c]


@njit(forceinline=True, **OPTIONS)
def _prolong_row(width, row, first, last, p_indices, p_blocks, coarse, x):
    """x[row] += row of P coarse."""
    for k in range(first, last):
        g = p_indices[k]
        e0, e1, e2 = coarse[g, 0], coarse[g, 1], coarse[g, 2]
        e3, e4, e5 = coarse[g, 3], coarse[g, 4], coarse[g, 5]
        for i in range(width):
            moved = p_blocks[k, i, 0] * e0 + p_blocks[k, i, 1] * e1 + p_blocks[k, i, 2] * e2
            turned = p_blocks[k, i, 3] * e3 + p_blocks[k, i, 4] * e4 + p_blocks[k, i, 5] * e5
            x[row, i] += moved + turned


@njit(parallel=True, **OPTIONS)
def prolong(chunks, p_indptr, p_indices, p_blocks, coarse, x):
    """x += P coarse."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            first, last = p_indptr[row], p_indptr[row + 1]
            if x.shape[1] == 3:
                _prolong_row(3, row, first, last, p_indices, p_blocks, coarse, x)
            else:
                _prolong_row(6, row, first, last, p_indices, p_blocks, coarse, x)


@njit(parallel=True, **OPTIONS)
def dense_product(chunks, matrix, f, result):
    """result = matrix f for a dense symmetric matrix (6 n, 6 n); chunks of its unknowns."""
    for t in prange(chunks.shape[0] - 1):
        first, last = chunks[t], chunks[t + 1]
        part = result[first:last]
        part[:] = 0
        for j in range(matrix.shape[0]):
            part += matrix[j, first:last] * f[j]


@njit(parallel=True, **OPTIONS)
def dot(chunks, a, b, partial):
    """Inner product in double precision: a sum over each chunk, then over the chunks in order."""
    for t in prange(chunks.shape[0] - 1):
        total = 0.0
        for row in range(chunks[t], chunks[t + 1]):
            for i in range(a.shape[1]):
                total += a[row, i] * b[row, i]
        partial[t] = total
    total = 0.0
    for t in range(chunks.shape[0] - 1):
        total += partial[t]
    return total


@njit(parallel=True, **OPTIONS)
def add_scaled(chunks, factor, a, result):
    """result += factor a."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            for i in range(a.shape[1]):
                result[row, i] += factor * a[row, i]
