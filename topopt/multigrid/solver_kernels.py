"""Double-precision kernels of the outer conjugate gradients.

Sums are taken over fixed chunks of rows and then over the chunks in order, so that they come out
the same on any number of threads.
"""

from numba import njit, prange

from topopt.lanes import add, convert, dot, load, scale, store, subtract
from topopt.multigrid.cycle_kernels import INLINE, OPTIONS, row_product


@njit(**INLINE)
def _total(partial, column):
    total = 0.0
    for t in range(partial.shape[0]):
        total += partial[t, column]
    return total


@njit(parallel=True, **OPTIONS)
def multiply_and_dot(chunks, indptr, indices, blocks, z, r, q, product, partial):
    """product = A z for z in single precision; returns z . r, z . product and z . q."""
    for t in prange(chunks.shape[0] - 1):
        zr = zs = zq = 0.0
        for row in range(chunks[t], chunks[t + 1]):
            s = row_product(3, 3, indptr, indices, blocks, z, row)
            store(s, product, row)
            here = convert(load(z, row, 3), product)
            zr += dot(here, load(r, row, 3))
            zs += dot(here, s)
            zq += dot(here, load(q, row, 3))
        partial[t, 0] = zr
        partial[t, 1] = zs
        partial[t, 2] = zq
    return _total(partial, 0), _total(partial, 1), _total(partial, 2)


@njit(parallel=True, **OPTIONS)
def advance(chunks, alpha, beta, z, product, gain, p, q, x, r, single, partial):
    """One step of conjugate gradients; returns r . r.

    p = z + beta p, q = product + beta q (which is A p), x += alpha p, r -= alpha q, and
    single = gain r in single precision.
    """
    for t in prange(chunks.shape[0] - 1):
        square = 0.0
        for row in range(chunks[t], chunks[t + 1]):
            here = add(convert(load(z, row, 3), p), scale(beta, load(p, row, 3)))
            store(here, p, row)
            store(add(load(x, row, 3), scale(alpha, here)), x, row)
            here = add(load(product, row, 3), scale(beta, load(q, row, 3)))
            store(here, q, row)
            rest = subtract(load(r, row, 3), scale(alpha, here))
            store(rest, r, row)
            store(convert(scale(gain, rest), single), single, row)
            square += dot(rest, rest)
        partial[t, 0] = square
    return _total(partial, 0)


@njit(parallel=True, **OPTIONS)
def true_residual(chunks, indptr, indices, blocks, f, x, r, partial):
    """r = f - A x; returns r . r."""
    for t in prange(chunks.shape[0] - 1):
        square = 0.0
        for row in range(chunks[t], chunks[t + 1]):
            ax = row_product(3, 3, indptr, indices, blocks, x, row)
            rest = subtract(load(f, row, 3), ax)
            store(rest, r, row)
            square += dot(rest, rest)
        partial[t, 0] = square
    return _total(partial, 0)
