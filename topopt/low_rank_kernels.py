"""Compiled loops of the step's quadratic programme, whose matrix carries a low-rank part.

H = diag(D) + coupling A + W^T C W with few rows W (k, n), kept in single precision (every loop
reads them as they are, so that H is one and the same matrix everywhere) and a small core C (k, k).
The loops over nodes run in blocks; sums are taken block by block and the blocks in order, so that
any number of threads gives the same bits. Sums within a block may be reordered by the compiler
(once, not at run time), so that they run as vectors.
"""

from contextlib import contextmanager

import numba
import numpy as np
from numba import njit, prange

BLOCK = 2048
SMALL = 2 * BLOCK  # rows; up to here waking a second thread costs more than it brings
VECTORS = {"cache": True, "error_model": "numpy", "fastmath": {"contract", "nsz", "reassoc"}}
PLAIN = {"cache": True, "error_model": "numpy"}


@contextmanager
def threads_that_pay(rows):
    """One thread for so few rows that others would not pay."""
    threads = numba.get_num_threads()
    if rows <= SMALL:
        numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(threads)


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
    with threads_that_pay(left.shape[1]):
        return np.add.accumulate(gram_of_blocks(left, right))[-1]


@njit(parallel=True, **PLAIN)
def pack_blocks(learned, rows, jacobi, packed, partial):
    """packed (k, R) = learned[:, rows]; partial (blocks, k, k): packed J^-1 packed^T by blocks.

    Only entries a <= b of partial are written.
    """
    k, size = packed.shape
    for block in prange(partial.shape[0]):
        start, stop = block * BLOCK, min((block + 1) * BLOCK, size)
        scaled = np.empty(stop - start)
        for b in range(k):
            for place in range(start, stop):
                packed[b, place] = learned[b, rows[place]]
                scaled[place - start] = packed[b, place] / jacobi[place]
            for a in range(b + 1):
                partial[block, a, b] = dot(packed[a, start:stop], scaled)


def pack(learned, rows, jacobi):
    """W on the rows (k, R), and W_R J^-1 W_R^T (k, k), for learned = W (k, n), jacobi (R,)."""
    k, size = len(learned), len(rows)
    packed = np.empty((k, size), np.float32)
    partial = np.zeros(((size + BLOCK - 1) // BLOCK, k, k))
    with threads_that_pay(size):
        pack_blocks(learned, rows, jacobi, packed, partial)
    upper = np.add.accumulate(partial)[-1]
    return packed, upper + np.triu(upper, 1).T


@njit(**PLAIN)
def small_product(matrix, x, out):
    """out = matrix x, for matrix (k, k) and x, out (k,)."""
    for a in range(matrix.shape[0]):
        out[a] = dot(matrix[a], x)


@njit(**PLAIN)
def sum_rows(partial, out):
    """out (k,) = sum over the blocks of partial (blocks, k), in order."""
    out[:] = 0.0
    for block in range(partial.shape[0]):
        add_multiple(1.0, partial[block], out)


@njit(**VECTORS)
def add_rows(factors, matrix, start, stop, out):
    """out (stop - start,) += factors matrix[:, start:stop], four rows at a time."""
    k, size = matrix.shape[0], stop - start
    for a in range(0, k - 3, 4):
        f0, f1, f2, f3 = factors[a], factors[a + 1], factors[a + 2], factors[a + 3]
        x0, x1 = matrix[a, start:stop], matrix[a + 1, start:stop]
        x2, x3 = matrix[a + 2, start:stop], matrix[a + 3, start:stop]
        for i in range(size):
            out[i] += f0 * x0[i] + f1 * x1[i] + f2 * x2[i] + f3 * x3[i]
    for a in range(k - k % 4, k):
        add_multiple(factors[a], matrix[a, start:stop], out)


@njit(**VECTORS)
def row_dots(matrix, start, stop, x, out):
    """out (k,) = matrix[:, start:stop] x (stop - start,), four rows at a time."""
    k, size = matrix.shape[0], stop - start
    for a in range(0, k - 3, 4):
        x0, x1 = matrix[a, start:stop], matrix[a + 1, start:stop]
        x2, x3 = matrix[a + 2, start:stop], matrix[a + 3, start:stop]
        s0 = s1 = s2 = s3 = 0.0
        for i in range(size):
            s0 += x0[i] * x[i]
            s1 += x1[i] * x[i]
            s2 += x2[i] * x[i]
            s3 += x3[i] * x[i]
        out[a], out[a + 1], out[a + 2], out[a + 3] = s0, s1, s2, s3
    for a in range(k - k % 4, k):
        out[a] = dot(matrix[a, start:stop], x)


@njit(parallel=True, **PLAIN)
def multiply(indptr, indices, data, coupling, diagonal, learned, lifted, x, out):
    """out = H x, with lifted = C W x."""
    size = x.size
    for block in prange((size + BLOCK - 1) // BLOCK):
        start, stop = block * BLOCK, min((block + 1) * BLOCK, size)
        for i in range(start, stop):
            total = 0.0
            for entry in range(indptr[i], indptr[i + 1]):
                total += data[entry] * x[indices[entry]]
            out[i] = diagonal[i] * x[i] + coupling * total
        add_rows(lifted, learned, start, stop, out[start:stop])


@njit(**PLAIN)
def _bounds(block, size):
    """First and last place of a block, and one beyond."""
    return block * BLOCK, min((block + 1) * BLOCK, size)


@njit(**PLAIN)
def _move(block, step, push, lifted, packed, jacobi, mass, rows, p, q, x, r, t, moment):
    """x += step p, r -= step H p, t = J^-1 r, and moment = W J^-1 r of the block."""
    start, stop = _bounds(block, rows.size)
    part = t[start:stop]
    for i in range(part.size):
        part[i] = 0.0
    add_rows(lifted, packed, start, stop, part)
    for place in range(start, stop):
        x[place] += step * p[rows[place]]
        r[place] -= step * (q[place] + t[place] - push * mass[place])
        t[place] = r[place] / jacobi[place]
    row_dots(packed, start, stop, part, moment)


@njit(**PLAIN)
def _precondition(block, shift, packed, jacobi, r, t, z, partial):
    """z = P^-1 r of the block, and its part of z . r."""
    start, stop = _bounds(block, r.size)
    part = z[start:stop]
    for i in range(part.size):
        part[i] = 0.0
    add_rows(shift, packed, start, stop, part)
    total = 0.0
    for place in range(start, stop):
        z[place] = t[place] - z[place] / jacobi[place]
        total += z[place] * r[place]
    partial[block, 0] = total


@njit(**PLAIN)
def _turn(block, beta, rows, z, p):
    """p = z + beta p on the block's rows."""
    start, stop = _bounds(block, rows.size)
    for place in range(start, stop):
        p[rows[place]] = z[place] + beta * p[rows[place]]


@njit(**PLAIN)
def _apply(block, indptr, indices, data, coupling, diagonal, rows, answer, p, q, partial):
    """q = (H - W^T C W) p of the block, and its parts of p . q and answer . q."""
    start, stop = _bounds(block, rows.size)
    s0, s1 = 0.0, 0.0
    for place in range(start, stop):
        i = rows[place]
        gathered = 0.0
        for entry in range(indptr[i], indptr[i + 1]):
            gathered += data[entry] * p[indices[entry]]
        q[place] = diagonal[i] * p[i] + coupling * gathered
        s0 += p[i] * q[place]
        s1 += answer[place] * q[place]
    partial[block, 0], partial[block, 1] = s0, s1


@njit(**PLAIN)
def _along(weight, moment, shift, beta, along, lifted):
    """along = W p by its recurrence; lifted is overwritten."""
    small_product(weight, shift, lifted)
    for a in range(along.size):
        along[a] = moment[a] - lifted[a] + beta * along[a]


MOVE, PRECONDITION, TURN, APPLY = range(4)


@njit(parallel=True, **PLAIN)
def _sweep(
    task, numbers, indptr, indices, data, coupling, diagonal, jacobi, packed, rows, mass, answer,
    small, moments, partial, p, q, x, r, t, z,
):  # fmt: skip
    """One of the four tasks on all blocks: one parallel loop, since each takes long to compile."""
    for block in prange(partial.shape[0]):
        if task == MOVE:
            step, push = numbers[0], numbers[1]
            moment, lifted = moments[block], small[3]
            _move(block, step, push, lifted, packed, jacobi, mass, rows, p, q, x, r, t, moment)
        elif task == PRECONDITION:
            _precondition(block, small[1], packed, jacobi, r, t, z, partial)
        elif task == TURN:
            _turn(block, numbers[2], rows, z, p)
        else:
            _apply(block, indptr, indices, data, coupling, diagonal, rows, answer, p, q, partial)


@njit(**PLAIN)
def conjugate_gradients(
    indptr, indices, data, coupling, diagonal, jacobi, packed, core, inner, weight, rows,
    mass, answer, x, r, tolerance, reduction, max_iterations,
):  # fmt: skip
    """Solve H_RR x + kappa m = rhs, m.x = 0 on the rows R; without the constraint where m = 0.

    The preconditioner is P^-1 = J^-1 - J^-1 W^T inner W J^-1 with J = diag(jacobi). W p is
    carried along by its own recurrence, so that an iteration reads W twice. H p is moved along m
    to where P^-1 m is orthogonal to it; so all directions stay in the plane m.p = 0.

    Parameters
    ----------
    indptr, indices, data, coupling, diagonal : A as CSR and D, of all n nodes
    jacobi : (R,) the diagonal of H without its low-rank part
    packed : (k, R) float32, W on the rows
    core, inner, weight : (k, k), C, the preconditioner's core, and W_R J^-1 W_R^T
    rows : (R,) int array
    mass, answer : (R,) m, and P^-1 m
    x : (R,) start; holds the solution afterwards
    r : (R,) the start's rhs - H x - kappa m, orthogonal to P^-1 m; overwritten
    tolerance : absolute bound on sqrt(r^T P^-1 r)
    reduction : the same relative to the start; the weaker of the two counts
    max_iterations : int

    Returns
    -------
    iterations : int
        -1 if they did not suffice (a number is not finite, H is not definite).
    kappa : float
        Beyond that of the start.
    norm : float
        sqrt(r^T P^-1 r) at the end.
    """
    k, size = packed.shape
    n_blocks = (size + BLOCK - 1) // BLOCK
    partial, moments, sums = np.zeros((n_blocks, 2)), np.zeros((n_blocks, k)), np.zeros(2)
    p, q, t, z = np.zeros(diagonal.size), np.zeros(size), np.zeros(size), np.zeros(size)
    small, numbers = np.zeros((5, k)), np.zeros(3)  # numbers: step, push and beta
    moment, shift, along, lifted, held = small[0], small[1], small[2], small[3], small[4]
    matrix = (indptr, indices, data, coupling, diagonal, jacobi, packed, rows, mass, answer)
    vectors = (small, moments, partial, p, q, x, r, t, z)
    row_dots(packed, 0, size, answer, held)
    level = dot(mass, answer)
    last, kappa, goal = 0.0, 0.0, tolerance
    for iteration in range(max_iterations + 1):
        _sweep(MOVE, numbers, *matrix, *vectors)
        sum_rows(moments, moment)
        small_product(inner, moment, shift)
        _sweep(PRECONDITION, numbers, *matrix, *vectors)
        sum_rows(partial, sums)
        norm = sums[0]
        if not np.isfinite(norm):
            return -1, kappa, norm
        length = np.sqrt(max(norm, 0.0))
        if iteration == 0:
            goal = max(tolerance, reduction * length)
        if length <= goal:
            return iteration, kappa, length
        numbers[2] = norm / last if last > 0.0 else 0.0
        _along(weight, moment, shift, numbers[2], along, lifted)
        small_product(core, along, lifted)
        _sweep(TURN, numbers, *matrix, *vectors)
        _sweep(APPLY, numbers, *matrix, *vectors)
        sum_rows(partial, sums)
        curvature = sums[0] + dot(along, lifted)
        if not curvature > 0.0:
            return -1, kappa, length
        last = norm
        numbers[0] = norm / curvature
        numbers[1] = (sums[1] + dot(held, lifted)) / level if level > 0.0 else 0.0
        kappa -= numbers[0] * numbers[1]
    return -1, kappa, length
