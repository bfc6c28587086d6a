"""Compiled loops of the step's quadratic programme: products with H = diag(D) + coupling A.

All vectors have full length n; `rows` lists the nodes that take part. A vector that is zero off
the rows needs no submatrix: the product with the full rows of A is that of the submatrix.
Sums are taken block by block and the blocks in order, so that any number of threads gives the
same bits.
"""

from inspect import signature
from types import FunctionType

import numpy as np
from numba import njit, prange

BLOCK = 2048
SMALL = 20000  # rows; below, threads cost more than they bring


def serial_and_parallel(function):
    """Compile a kernel twice; the length of `rows` decides which one runs, with the same bits."""
    options = {"cache": True, "error_model": "numpy"}
    twin = FunctionType(function.__code__, function.__globals__, function.__name__ + "_parallel")
    twin.__qualname__ = twin.__name__  # a name, and so a cache file, of its own
    serial, parallel = njit(**options)(function), njit(parallel=True, **options)(twin)
    position = list(signature(function).parameters).index("rows")

    def dispatch(*arguments):
        return (serial if arguments[position].size < SMALL else parallel)(*arguments)

    dispatch.py_func, dispatch.serial, dispatch.parallel = function, serial, parallel
    return dispatch


@njit(cache=True, error_model="numpy")
def sum_blocks(partial):
    """Add the rows of (k, 2) in order."""
    total = np.zeros(2)
    for block in range(partial.shape[0]):
        total += partial[block]
    return total


@serial_and_parallel
def multiply_rows(indptr, indices, data, coupling, diagonal, rows, x, out):
    """out[i] = (H x)[i] for the rows i (k,); x and out have n entries."""
    for k in prange(rows.size):
        i = rows[k]
        total = 0.0
        for entry in range(indptr[i], indptr[i + 1]):
            total += data[entry] * x[indices[entry]]
        out[i] = diagonal[i] * x[i] + coupling * total


@serial_and_parallel
def conjugate_gradients(
    indptr, indices, data, coupling, diagonal, jacobi, rows, x, r, work, tolerance, max_iterations
):
    """Solve H_RR x = rhs on the rows R for two right sides at once, Jacobi-preconditioned.

    Parameters
    ----------
    indptr, indices, data : A as CSR
    coupling : float
    diagonal : (n,) D
    jacobi : (n,) the diagonal of H
    rows : (k,) int array, R
    x : (n, 2) start; holds the solution afterwards
    r : (n, 2) residual of the start on the rows, zero elsewhere; overwritten
    work : (2, n, 2) zeros; overwritten
    tolerance : (2,) absolute bound on sqrt(r^T diag(H)^-1 r)
    max_iterations : int

    Returns
    -------
    int
        Iterations, or -1 if they did not suffice (or a number is not finite).
    """
    p, q = work[0], work[1]
    n_blocks = (rows.size + BLOCK - 1) // BLOCK
    partial = np.zeros((n_blocks, 2))
    step, beta = np.zeros(2), np.zeros(2)
    norm = np.zeros(2)  # r^T diag(H)^-1 r
    for i in rows:
        for c in range(2):
            norm[c] += r[i, c] * r[i, c] / jacobi[i]
    for iteration in range(max_iterations + 1):
        if not np.isfinite(norm[0] + norm[1]):
            return -1
        running = np.sqrt(norm) > tolerance  # a column that is done stands still
        if not (running[0] or running[1]):
            return iteration
        for k in prange(rows.size):
            i = rows[k]
            for c in range(2):
                p[i, c] = r[i, c] / jacobi[i] + beta[c] * p[i, c]
        for block in prange(n_blocks):
            s0, s1 = 0.0, 0.0
            for k in range(block * BLOCK, min((block + 1) * BLOCK, rows.size)):
                i = rows[k]
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
        curvature = sum_blocks(partial)
        for c in range(2):
            step[c] = norm[c] / curvature[c] if running[c] and curvature[c] > 0.0 else 0.0
        for block in prange(n_blocks):
            s0, s1 = 0.0, 0.0
            for k in range(block * BLOCK, min((block + 1) * BLOCK, rows.size)):
                i = rows[k]
                for c in range(2):
                    x[i, c] += step[c] * p[i, c]
                    r[i, c] -= step[c] * q[i, c]
                s0 += r[i, 0] * r[i, 0] / jacobi[i]
                s1 += r[i, 1] * r[i, 1] / jacobi[i]
            partial[block, 0], partial[block, 1] = s0, s1
        last = norm
        norm = sum_blocks(partial)
        for c in range(2):
            beta[c] = norm[c] / last[c] if running[c] else 0.0
    return -1


@njit(cache=True, error_model="numpy")
def projected_volume(kappa, linear, diagonal, mass, lower, upper, x):
    """x = clip((linear - kappa mass) / diagonal, lower, upper).

    Returns the volume mass . x, and its derivative by -kappa.
    """
    volume, slope = 0.0, 0.0
    for i in range(x.size):
        value = (linear[i] - kappa * mass[i]) / diagonal[i]
        if value <= lower[i]:
            value = lower[i]
        elif value >= upper[i]:
            value = upper[i]
        else:
            slope += mass[i] * mass[i] / diagonal[i]
        x[i] = value
        volume += mass[i] * value
    return volume, slope
