"""Conjugate gradients with a nearest-neighbour factorised approximate inverse (FSAI, Vecchia).

A group of sites has the last rows of the inverse Cholesky factor of the system's block that belongs
to the K nearest earlier sites and its own. Groups do not depend on one another, and the number of
iterations does not depend on the number of sites.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal

from meshes import NotConverged
from rbf import fsai_kernels as kernels
from rbf.system import DERIVATIVE_SCALE
from rbf.threads import in_parts

ADVICE = (
    "weld or repair points that almost coincide, reduce support_radius, give more neighbours "
    "(40), or allow a ridge of about 1e-6"
)


GROUP_FUNCTIONALS = 16  # rows that share one factorisation


class Preconditioner:
    """G^T G, an approximate inverse of a system's matrix; entries in single precision.

    Parameters
    ----------
    system : HermiteSystem or PointSystem
    neighbours : int
        How many earlier sites a full group of rows sees (a smaller group sees more).

    Attributes
    ----------
    bad_pivots : int
        Pivots that were noise and were replaced: 0 on good input.
    group_start : (g + 1,) int array
        Group i is the sites group_start[i] to group_start[i + 1], in the order of the cells.
    """

    def __init__(self, system, neighbours):
        n, m = len(system.sites), system.unknowns_per_site
        grid = system.grid
        self._m = m
        self.group_start, cells = _groups(grid.starts, GROUP_FUNCTIONALS // m)
        largest = int(np.diff(self.group_start).max())
        self._columns = np.empty((len(cells), min(neighbours, n) + largest), np.int32)
        self._counts = np.empty(len(cells), np.int32)
        in_parts(
            kernels.choose_columns,
            len(cells),
            grid.keys,
            cells,
            grid.arrays,
            system.sites,
            self.group_start,
            self._columns,
            self._counts,
        )
        self._factor(system)
        self._prepare_transpose(n)

    def _factor(self, system):
        m, counts = self._m, self._counts.astype(np.int64)
        lengths = np.diff(self.group_start) * counts * m * m
        self._offsets = np.concatenate([[0], np.cumsum(lengths)])
        self._entries = np.empty(self._offsets[-1], np.float32)
        bad = np.zeros(len(counts), np.int64)
        in_parts(
            kernels.factor_groups,
            len(counts),
            system.form,
            DERIVATIVE_SCALE,
            system.ridge,
            m,
            system.positions,
            system.normals,
            self.group_start,
            self._columns,
            self._counts,
            self._offsets,
            self._entries,
            bad,
        )
        self.bad_pivots = int(bad.sum())

    def _prepare_transpose(self, n):
        total = int(self._counts.sum())
        self._product_start = np.cumsum(self._counts, dtype=np.int64) - self._counts
        self._product_start *= self._m
        self._products = np.empty(total * self._m, np.float32)
        self._starts, self._places = np.zeros(n + 1, np.int64), np.empty(total, np.int64)
        kernels.list_products(
            self._m, self._columns, self._counts, self._product_start, self._starts, self._places
        )

    def columns(self):
        """For each group, the sites its rows see: earlier ones, then its own."""
        return [row[:count] for row, count in zip(self._columns, self._counts)]

    def apply(self, residual, out):
        """out = G^T G residual, arrays (n, m)."""
        in_parts(
            kernels.apply_rows,
            len(self._counts),
            self._m,
            self.group_start,
            self._columns,
            self._counts,
            self._offsets,
            self._entries,
            residual,
            self._products,
            self._product_start,
        )
        place = self._starts, self._places, self._products, out
        in_parts(kernels.sum_products, len(out), self._m, *place)


def _groups(cell_starts, size):
    """Split each cell into even groups of at most `size` sites: (starts (g + 1,), cells (g,))."""
    members = np.diff(cell_starts)
    parts = -(-members // size)
    cells = np.repeat(np.arange(len(members)), parts)
    part = np.arange(len(cells)) - np.repeat(np.cumsum(parts) - parts, parts)
    starts = cell_starts[cells] + part * members[cells] // parts[cells]
    return np.append(starts, cell_starts[-1]), cells


@dataclass(frozen=True)
class Solution:
    """Coefficients x (n, m) and how they were found.

    `residual` is the true one, ||b - A x|| / ||b||; `condition` is that of the preconditioned
    matrix, estimated from the iteration's own Lanczos coefficients.
    """

    x: np.ndarray
    iterations: int
    residual: float
    condition: float
    bad_pivots: int
    history: tuple[float, ...]


def solve(system, right, tolerance=1e-8, neighbours=20, iterations=300, start=None):
    """Solve A x = right (n, m) to a relative residual.

    Raises
    ------
    NotConverged
        If the true residual stays above the tolerance; says what to change.
    """
    preconditioner = Preconditioner(system, neighbours)
    return solve_with(system, preconditioner, right, tolerance, iterations, start)


def solve_with(system, preconditioner, right, tolerance=1e-8, iterations=300, start=None):
    """`solve` with a preconditioner at hand."""
    norm = np.sqrt(_dot(right, right))
    if norm == 0.0:
        return Solution(np.zeros_like(right), 0, 0.0, 1.0, preconditioner.bad_pivots, ())
    right = right / norm  # the preconditioner's single precision has a narrow range
    x = np.zeros_like(right) if start is None else start / norm
    history, condition, used = [], 1.0, 0
    residual = _true_residual(system, right, x) if start is not None else right.copy()
    for _restart in range(4):  # rounding may part the recurrence from the true residual
        steps, estimate = _iterate(
            system, preconditioner, x, residual, tolerance, iterations - used, history
        )
        used, condition = used + steps, max(condition, estimate)
        residual = _true_residual(system, right, x)
        reached = np.sqrt(_dot(residual, residual))
        if reached <= tolerance or used >= iterations or not np.isfinite(reached):
            break
    if not reached <= tolerance:
        raise NotConverged(
            f"the interpolation system stalled at a residual of {reached:.1e} (asked for "
            f"{tolerance:.0e}) after {used} iterations, with {preconditioner.bad_pivots} bad "
            f"pivots: {ADVICE}",
            history,
        )
    bad_pivots = preconditioner.bad_pivots
    return Solution(norm * x, used, float(reached), condition, bad_pivots, tuple(history))


def _iterate(system, preconditioner, x, r, target, iterations, history):
    """Conjugate gradients from x with residual r, both overwritten; (steps, condition)."""
    z, p, q = np.empty_like(r), np.empty_like(r), np.empty_like(r)
    preconditioner.apply(r, z)
    p[:] = z
    rz = _dot(r, z)
    alphas, betas = [], []
    for _ in range(iterations):
        system.multiply(p, q)
        curvature = _dot(p, q)
        if not curvature > 0.0:
            break  # rounding made the matrix indefinite: the true residual decides
        alphas.append(rz / curvature)
        x += alphas[-1] * p
        q *= alphas[-1]
        r -= q
        history.append(np.sqrt(_dot(r, r)))
        if not history[-1] > target:
            break
        preconditioner.apply(r, z)
        rz, old = _dot(r, z), rz
        betas.append(rz / old)
        p *= betas[-1]
        p += z
    return len(alphas), _lanczos_condition(alphas, betas)


def _lanczos_condition(alphas, betas):
    """Condition number from the coefficients of conjugate gradients."""
    if not alphas:
        return 1.0
    alphas = np.array(alphas)
    betas = np.array(betas[: len(alphas) - 1])
    diagonal = 1.0 / alphas
    diagonal[1:] += betas / alphas[:-1]
    eigenvalues = eigvalsh_tridiagonal(diagonal, np.sqrt(betas) / alphas[:-1])
    return float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > 0 else np.inf


def _true_residual(system, right, x):
    product = np.empty_like(right)
    system.multiply(x, product)
    return right - product


def _dot(x, y):
    # not BLAS, whose sums depend on the number of threads
    return float(np.einsum("ij,ij->", x, y))
