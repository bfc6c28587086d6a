"""Extreme eigenvalues of an interpolation matrix, by Lanczos iterations."""

import numpy as np
from scipy.linalg import eigh_tridiagonal

from rbf.solve import Preconditioner, solve_with

STEPS = 20
SOLVE_TOLERANCE = 1e-6


def extreme_eigenvalues(system, neighbours, steps=STEPS, seed=0):
    """Smallest and largest eigenvalue of a system's matrix (its diagonal entries are about 1).

    Lanczos on the matrix gives the largest, on its inverse (with the preconditioned solver) the
    smallest; both from inside, in 20 steps to a few per cent.

    Returns
    -------
    smallest, largest : float
    """
    preconditioner = Preconditioner(system, neighbours)
    shape = (len(system.sites), system.unknowns_per_site)

    def multiply(x):
        out = np.empty(shape)
        system.multiply(x.reshape(shape), out)
        return out.reshape(-1)

    def invert(x):
        right = np.ascontiguousarray(x.reshape(shape))
        return solve_with(system, preconditioner, right, SOLVE_TOLERANCE).x.reshape(-1)

    start = np.random.default_rng(seed).standard_normal(shape[0] * shape[1])
    return 1.0 / largest_eigenvalue(invert, start, steps), largest_eigenvalue(
        multiply, start, steps
    )


def largest_eigenvalue(operator, start, steps):
    """Largest eigenvalue of a symmetric positive operator, by Lanczos with full orthogonality."""
    steps = min(steps, start.size)
    basis = [start / np.linalg.norm(start)]
    diagonal, beside = [], []
    for step in range(steps):
        image = operator(basis[-1])
        diagonal.append(basis[-1] @ image)
        for _twice in range(2):
            for vector in basis:
                image -= (vector @ image) * vector
        length = np.linalg.norm(image)
        if step == steps - 1 or length <= 1e-10 * diagonal[0]:
            break
        beside.append(length)
        basis.append(image / length)
    return float(eigh_tridiagonal(np.array(diagonal), np.array(beside))[0][-1])
