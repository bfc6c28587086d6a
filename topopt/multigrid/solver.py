"""Conjugate gradients in double precision around a multigrid cycle in single precision.

The cycle is not quite the same linear map twice (rounding, K-cycle), so the direction is made
orthogonal to the last one by the flexible formula beta = -(z . A p) / (p . A p). The product A z
with the cycle's answer z gives A p along with p = z + beta p, and p . A p = z . A z -
(z . A p)^2 / (p . A p) with the old p on the right: one pass over the matrix and one over the
vectors is all that an iteration needs (Chronopoulos and Gear 1989).
"""

import numpy as np

from meshes.errors import NotConverged
from topopt.multigrid import solver_kernels as kernels
from topopt.multigrid.cycle import CycleSettings, apply_cycle, threads_that_pay
from topopt.multigrid.hierarchy import COARSEST_UNKNOWNS, Hierarchy
from topopt.multigrid.patterns import INDEX
from topopt.solution import Solution


class MultigridSolver:
    """Smoothed aggregation for elasticity: patterns once, numbers in each update.

    Parameters
    ----------
    matrix : scipy.sparse.bsr_array, (3 n, 3 n) in 3 x 3 blocks
        The matrix of the uniform material: its pattern is that of all matrices to come.
    modes : (n, 3, 6) float array
        Rigid-body modes, zero at the fixed degrees of freedom.
    settings : CycleSettings, optional
    max_iterations : int
    coarsest : int
        See `Hierarchy`.
    """

    name = "multigrid"

    def __init__(
        self, matrix, modes, settings=None, max_iterations=200, coarsest=COARSEST_UNKNOWNS
    ):
        self.hierarchy = Hierarchy(matrix, modes, coarsest)
        self.settings = settings or CycleSettings()
        self._max_iterations = max_iterations
        self._chunks = self.hierarchy.levels[0].chunks
        self._partial = np.zeros((len(self._chunks) - 1, 3))

    def update(self, matrix, near=False):
        """Take a new matrix (bsr_array in 3 x 3 blocks) with the pattern of this solver.

        Where it is `near` the last one, the hierarchy stays: a preconditioner need not be exact.
        """
        self._matrix = (matrix.indptr.view(INDEX), matrix.indices.view(INDEX), matrix.data)
        if near:
            return
        with threads_that_pay(self.hierarchy.levels[0]):
            self.hierarchy.update(matrix.data)

    def solve(self, right_side, start=None, tolerance=1e-6):
        """Solve K u = right_side (n, 3) to |f - K u| <= tolerance |f|: a Solution.

        Raises
        ------
        NotConverged
            With the history of relative residuals, if the iteration stalls or breaks down.
        """
        with threads_that_pay(self.hierarchy.levels[0]):
            return self._solve(right_side, start, tolerance)

    def _solve(self, right_side, start, tolerance):
        f = np.ascontiguousarray(right_side, dtype=float)
        x = np.zeros_like(f) if start is None else np.array(start, dtype=float, order="C")
        history = []
        size = float(np.linalg.norm(f))
        if size == 0.0:
            return Solution(np.zeros_like(f), f.copy(), 0, (0.0,), self.name, 0.0)
        r = np.empty_like(f)
        energy = None
        for turn in range(3):  # the recursion's residual drifts from the true one: check, go on
            square = kernels.true_residual(self._chunks, *self._matrix, f, x, r, self._partial)
            history.append(np.sqrt(square) / size)
            if history[-1] <= tolerance:
                break
            if turn == 0 and history[0] > 1.0:
                history[0] = _scale_start(f, x, r) / size
            energy = self._iterate(x, r, size, tolerance, history)
        else:
            self._give_up(history, tolerance, "rounding keeps the residual up")
        energy = self._error_energy(r) if energy is None else energy
        return Solution(x, r, len(history) - 1, tuple(history), self.name, energy)

    def _iterate(self, x, r, size, tolerance, history):
        """Conjugate gradients on x and r in place, until |r| <= tolerance size.

        Returns r . B r before the last step, B the cycle, or None if none was taken. The error's
        energy falls with each step; how far with the last one would cost another cycle to know.
        """
        finest = self.hierarchy.levels[0]
        p, q, product = np.zeros_like(x), np.zeros_like(x), np.empty_like(x)
        norm = history[-1] * size
        np.multiply(r, 1.0 / norm, out=finest.f, casting="same_kind")
        curvature, energy = 1.0, None
        while history[-1] > tolerance:
            if len(history) > self._max_iterations:
                self._give_up(history, tolerance, f"{self._max_iterations} iterations are up")
            apply_cycle(self.hierarchy.levels, self.settings)
            zr, zaz, zq = kernels.multiply_and_dot(
                self._chunks, *self._matrix, finest.x, r, q, product, self._partial
            )
            beta = -zq / curvature
            curvature = zaz + beta * zq
            if not (zr > 0.0 and curvature > 0.0):
                self._give_up(history, tolerance, "matrix or preconditioner is not definite")
            square = kernels.advance(
                self._chunks, zr / curvature, beta, finest.x, product, 1.0 / norm,
                p, q, x, r, finest.f, self._partial,
            )  # fmt: skip
            energy = zr * norm * self.hierarchy.scale
            norm = np.sqrt(square)
            history.append(norm / size)
        return energy

    def _error_energy(self, residual):
        """r . B r of a residual r (n, 3), an estimate of r . K^-1 r."""
        norm = float(np.linalg.norm(residual))
        if norm == 0.0:
            return 0.0
        finest = self.hierarchy.levels[0]
        np.multiply(residual, 1.0 / norm, out=finest.f, casting="same_kind")
        with threads_that_pay(finest):
            apply_cycle(self.hierarchy.levels, self.settings)
        return abs(float((finest.x * residual).sum())) * norm * self.hierarchy.scale

    def _give_up(self, history, tolerance, why):
        raise NotConverged(
            f"multigrid stalled at a relative residual of {history[-1]:.1e} after "
            f"{len(history) - 1} iterations where {tolerance:.1e} is asked for ({why}); use "
            "solver: pyamg or direct, or a mesh with better tets.",
            history,
        )


def _scale_start(f, x, r):
    """Multiply a start x in place by the factor with the least energy; |r|, r as well.

    A start may be good but where the stiffness has come back to what was void and had moved a
    lot: then the residual is thousands of f, and that of no start at all is better.
    """
    work = float(np.vdot(f, x))
    energy = work - float(np.vdot(r, x))  # x . K x
    factor = work / energy if energy > 0.0 else 0.0
    r *= factor
    r += (1.0 - factor) * f
    x *= factor
    return float(np.linalg.norm(r))
