"""Compiled loops for a quadratic programme whose matrix carries a low-rank part.

H = diag(D) + coupling A + W^T C W with few rows W (k, n), kept in single precision (every loop
reads them as they are, so that H is one and the same matrix everywhere) and a small core C (k, k).
The loops over nodes run in blocks, as in `topopt.pdas_kernels`; sums within a block may be
reordered by the compiler (once, not at run time), so that they run as vectors.
"""

import numpy as np
from numba import njit, prange

from topopt.pdas_kernels import BLOCK, sum_blocks

VECTORS = {"cache": True, "error_model": "numpy", "fastmath": {"contract", "nsz", "reassoc"}}
PLAIN = {"cache": True, "error_model": "numpy"}


@njit(**VECTORS)
def dot(left, right):
    """Return left . right."""
    total = 0.0
    for i in range(left.size):
        total += left[i] * right[i]
    return total


@njit(**VECTORS)
def add_multiple(factor, x, out):
    """out += factor x."""
    for i in range(out.size):
        out[i] += factor * x[i]


@njit(parallel=True, **PLAIN)
def gram_of_blocks(left, right):
    """left right^T for left (k, n), right (l, n), a part for each block: (blocks, k, l)."""
    n_blocks = (left.shape[1] + BLOCK - 1) // BLOCK
    partial = np.zeros((n_blocks, left.shape[0], right.shape[0]))
    for block in prange(n_blocks):
        start, stop = block * BLOCK, min((block + 1) * BLOCK, left.shape[1])
        for a in range(left.shape[0]):
            for b in range(right.shape[0]):
                partial[block, a, b] = dot(left[a, start:stop], right[b, start:stop])
    return partial


def gram(left, right):
    """Return left right^T (k, l) for left (k, n) and right (l, n), the blocks added in order."""
    return np.add.accumulate(gram_of_blocks(left, right))[-1]


@njit(**PLAIN)
def small_product(matrix, x, out):
    """out[c] = matrix x[c], for matrix (k, k) and x, out (2, k)."""
    for c in range(2):
        for a in range(matrix.shape[0]):
            out[c, a] = dot(matrix[a], x[c])


@njit(**PLAIN)
def sum_moments(partial, out):
    """out (2, k) = sum over the blocks of partial (blocks, 2, k), in order."""
    out[:] = 0.0
    for block in range(partial.shape[0]):
        for c in range(2):
            add_multiple(1.0, partial[block, c], out[c])


@njit(**PLAIN)
def next_direction(norm, last, running, moment, weight, shift, core, beta, along, lifted):
    """beta, and by recurrence W p and C W p of the new direction p = z + beta p."""
    small_product(weight, shift, lifted)
    for c in range(2):
        beta[c] = norm[c] / last[c] if running[c] and last[c] > 0.0 else 0.0
        for a in range(along.shape[1]):
            along[c, a] = moment[c, a] - lifted[c, a] + beta[c] * along[c, a]
    small_product(core, along, lifted)


@njit(**PLAIN)
def step_length(norm, running, curvature, along, lifted, step):
    """step = norm / p.H p, curvature being p.H p without the low-rank part."""
    for c in range(2):
        total = curvature[c] + dot(along[c], lifted[c])
        step[c] = norm[c] / total if running[c] and total > 0.0 else 0.0


@njit(parallel=True, **PLAIN)
def low_rank_gradients(
    indptr, indices, data, coupling, diagonal, jacobi, packed, core, inner, weight, rows, x, r,
    work, tolerance, max_iterations,
):  # fmt: skip
    """Solve H_RR x = rhs on the rows R for two right sides at once.

    The preconditioner is P^-1 = J^-1 - J^-1 W^T inner W J^-1 with J = diag(jacobi). W p is
    carried along by its own recurrence, so that an iteration reads W twice.

    Parameters
    ----------
    indptr, indices, data, coupling, diagonal, jacobi, rows, x, r, max_iterations
        As in `pdas_kernels.conjugate_gradients`.
    packed : (k, rows) float32, W on the rows
    core, inner, weight : (k, k), C, the preconditioner's core, and W_R J^-1 W_R^T
    work : (3, n, 2) zeros; overwritten
    tolerance : (2,) absolute bound on sqrt(r^T P^-1 r)

    Returns
    -------
    int
        Iterations, or -1 if they did not suffice (or a number is not finite).
    """
    p, q, z = work[0], work[1], work[2]
    k, size = packed.shape
    n_blocks = (size + BLOCK - 1) // BLOCK
    partial, moments, t = np.zeros((n_blocks, 2)), np.zeros((n_blocks, 2, k)), np.zeros((2, size))
    step, beta, last = np.zeros(2), np.zeros(2), np.zeros(2)
    moment, shift, along, lifted = (
        np.zeros((2, k)),
        np.zeros((2, k)),
        np.zeros((2, k)),
        np.zeros((2, k)),
    )
    for iteration in range(max_iterations + 1):
        for block in prange(n_blocks):  # x += step p, r -= step H p, moments W J^-1 r
            start, stop = block * BLOCK, min((block + 1) * BLOCK, size)
            for c in range(2):
                part = t[c, start:stop]
                part[:] = 0.0
                for a in range(k):
                    add_multiple(lifted[c, a], packed[a, start:stop], part)
                for place in range(start, stop):
                    i = rows[place]
                    x[i, c] += step[c] * p[i, c]
                    r[i, c] -= step[c] * (q[i, c] + t[c, place])
                    t[c, place] = r[i, c] / jacobi[i]
                for a in range(k):
                    moments[block, c, a] = dot(packed[a, start:stop], part)
        sum_moments(moments, moment)
        small_product(inner, moment, shift)
        for block in prange(n_blocks):  # z = P^-1 r
            start, stop = block * BLOCK, min((block + 1) * BLOCK, size)
            for c in range(2):
                part = t[c, start:stop]
                part[:] = 0.0
                for a in range(k):
                    add_multiple(shift[c, a], packed[a, start:stop], part)
                partial[block, c] = 0.0
                for place in range(start, stop):
                    i = rows[place]
                    z[i, c] = (r[i, c] - t[c, place]) / jacobi[i]
                    partial[block, c] += z[i, c] * r[i, c]
        norm = sum_blocks(partial)
        if not np.isfinite(norm[0] + norm[1]):
            return -1
        running = np.sqrt(np.maximum(norm, 0.0)) > tolerance  # a column that is done stands still
        if not (running[0] or running[1]):
            return iteration
        next_direction(norm, last, running, moment, weight, shift, core, beta, along, lifted)
        for place in prange(size):
            i = rows[place]
            for c in range(2):
                p[i, c] = z[i, c] + beta[c] * p[i, c]
        for block in prange(n_blocks):  # q = (H - W^T C W) p
            s0, s1 = 0.0, 0.0
            for place in range(block * BLOCK, min((block + 1) * BLOCK, size)):
                i = rows[place]
                t0, t1 = 0.0, 0.0
                for entry in range(indptr[i], indptr[i + 1]):
                    j = indices[entry]
                    t0 += data[entry] * p[j, 0]
                    t1 += data[entry] * p[j, 1]
                q[i, 0] = diagonal[i] * p[i, 0] + coupling * t0
                q[i, 1] = diagonal[i] * p[i, 1] + coupling * t1
                s0 += p[i, 0] * q[i, 0]
                s1 += p[i, 1] * q[i, 1]
            partial[block, 0], partial[block, 1] = s0, s1
        step_length(norm, running, sum_blocks(partial), along, lifted, step)
        last = norm
    return -1
