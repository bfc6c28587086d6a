"""Compiled vector operations of conjugate gradients, the same bits with any number of threads."""

from numba import njit, prange

OPTIONS = {"cache": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
SUMS = {"cache": True, "error_model": "numpy", "fastmath": {"contract", "nsz", "reassoc"}}
CHUNK = 8192  # entries per partial sum: fixed, so that sums do not depend on the threads


@njit(parallel=True, **SUMS)
def dot(x, y, partial):
    """Sum of x y over flat arrays; `partial` has one entry per chunk."""
    for chunk in prange(partial.size):
        total = 0.0
        for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, x.size)):
            total += x[i] * y[i]
        partial[chunk] = total
    result = 0.0
    for chunk in range(partial.size):
        result += partial[chunk]
    return result


@njit(parallel=True, **OPTIONS)
def step(alpha, p, q, x, r):
    """x += alpha p and r -= alpha q."""
    for i in prange(x.size):
        x[i] += alpha * p[i]
        r[i] -= alpha * q[i]


@njit(parallel=True, **OPTIONS)
def turn(beta, z, p):
    """p = z + beta p."""
    for i in prange(p.size):
        p[i] = z[i] + beta * p[i]
