"""Double-precision kernels of the outer conjugate gradients.

Sums are taken over fixed chunks of rows and then over the chunks in order, so that they come out
the same on any number of threads.
"""

from numba import njit, prange

from topopt.multigrid.cycle_kernels import _row_product_3

OPTIONS = {"cache": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy"}


@njit(forceinline=True, **OPTIONS)
def _total(partial, column):
    total = 0.0
    for t in range(partial.shape[0]):
        total += partial[t, column]
    return total


@njit(parallel=True, **OPTIONS)
def multiply_and_dot(chunks, indptr, indices, blocks, p, q, partial):
    """q = A p; returns p . q."""
    for t in prange(chunks.shape[0] - 1):
        total = 0.0
        for row in range(chunks[t], chunks[t + 1]):
            y = _row_product_3(indptr, indices, blocks, p, row)
            for i in range(3):
                q[row, i] = y[i]
                total += p[row, i] * y[i]
        partial[t, 0] = total
    return _total(partial, 0)


@njit(parallel=True, **OPTIONS)
def preconditioned_dots(chunks, z, r, q, partial):
    """Returns z . r and z . q."""
    for t in prange(chunks.shape[0] - 1):
        zr = zq = 0.0
        for row in range(chunks[t], chunks[t + 1]):
            for i in range(3):
                zr += z[row, i] * r[row, i]
                zq += z[row, i] * q[row, i]
        partial[t, 0] = zr
        partial[t, 1] = zq
    return _total(partial, 0), _total(partial, 1)


@njit(parallel=True, **OPTIONS)
def new_direction(chunks, z, beta, p):
    """p = z + beta p."""
    for t in prange(chunks.shape[0] - 1):
        for row in range(chunks[t], chunks[t + 1]):
            for i in range(3):
                p[row, i] = z[row, i] + beta * p[row, i]


@njit(parallel=True, **OPTIONS)
def advance(chunks, alpha, p, q, scale, x, r, single, partial):
    """x += alpha p; r -= alpha q; single = scale r in single precision; returns r . r."""
    for t in prange(chunks.shape[0] - 1):
        total = 0.0
        for row in range(chunks[t], chunks[t + 1]):
            for i in range(3):
                x[row, i] += alpha * p[row, i]
                value = r[row, i] - alpha * q[row, i]
                r[row, i] = value
                single[row, i] = scale * value
                total += value * value
        partial[t, 0] = total
    return _total(partial, 0)


@njit(parallel=True, **OPTIONS)
def true_residual(chunks, indptr, indices, blocks, f, x, r, partial):
    """r = f - A x; returns r . r."""
    for t in prange(chunks.shape[0] - 1):
        total = 0.0
        for row in range(chunks[t], chunks[t + 1]):
            y = _row_product_3(indptr, indices, blocks, x, row)
            for i in range(3):
                value = f[row, i] - y[i]
                r[row, i] = value
                total += value * value
        partial[t, 0] = total
    return _total(partial, 0)
