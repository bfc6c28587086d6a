"""Slow, obvious twins of the optimiser's kernels and solvers."""

import numpy as np
from scipy.optimize import brentq, lsq_linear


def dense_hessian(qp):
    """H (n, n) of a step's quadratic programme."""
    hessian = np.diag(qp.diagonal) + qp.coupling * qp.stiffness.toarray()
    if qp.learned is not None:
        hessian += qp.learned.T.astype(float) @ qp.core @ qp.learned.astype(float)
    return hessian


def bfgs(base, pairs):
    """B (n, n) after the BFGS updates by pairs (s, y) of the base matrix (n, n), oldest first."""
    b = base.copy()
    for s, y in pairs:
        b += np.outer(y, y) / (y @ s) - np.outer(b @ s, b @ s) / (s @ b @ s)
    return b


def box_minimiser(hessian, linear, lower, upper):
    """Minimise 1/2 x^T H x - q^T x over a box by scipy's bounded least squares (BVLS).

    With H = L L^T that is || L^T x - L^-1 q ||^2.
    """
    factor = np.linalg.cholesky(hessian)
    right = np.linalg.solve(factor, linear)
    free = upper > lower
    x = lower.copy()
    target = right - factor.T[:, ~free] @ lower[~free]
    fit = lsq_linear(
        factor.T[:, free], target, (lower[free], upper[free]), method="bvls", tol=1e-15
    )
    x[free] = fit.x
    return x


def solve_qp_by_bisection(qp):
    """Solve a step's quadratic programme by a root search on its volume multiplier."""
    hessian = dense_hessian(qp)

    def minimiser(kappa):
        return box_minimiser(hessian, qp.linear - kappa * qp.mass, qp.lower, qp.upper)

    low = np.min((qp.linear - hessian @ qp.upper) / qp.mass)
    high = np.max((qp.linear - hessian @ qp.lower) / qp.mass)
    pad = 1e-3 * (high - low) + 1e-300
    kappa = brentq(
        lambda k: qp.mass @ minimiser(k) - qp.volume, low - pad, high + pad, xtol=1e-300, rtol=1e-15
    )
    return minimiser(kappa), kappa


def multiply(indptr, indices, data, coupling, diagonal, learned, lifted, x):
    """Twin of the kernel: one entry at a time."""
    out = np.zeros(len(x))
    for i in range(len(x)):
        row = range(indptr[i], indptr[i + 1])
        out[i] = diagonal[i] * x[i] + coupling * sum(data[k] * x[indices[k]] for k in row)
        out[i] += sum(float(w) * c for w, c in zip(learned[:, i], lifted, strict=True))
    return out


def project_by_bisection(linear, diagonal, mass, volume, lower, upper):
    """Twin of `project_in_metric`: plain bisection on kappa."""
    low = np.min((linear - diagonal * upper) / mass)
    high = np.max((linear - diagonal * lower) / mass)
    for _ in range(400):
        kappa = 0.5 * (low + high)
        x = np.clip((linear - kappa * mass) / diagonal, lower, upper)
        low, high = (kappa, high) if mass @ x > volume else (low, kappa)
    return x
