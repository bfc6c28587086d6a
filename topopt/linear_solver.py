"""The slot for the linear solver of the state problem, and who can take it.

A solver is made once per mesh, takes the numbers of the matrix anew in every step (`update`), and
solves for as many right sides as are asked for (`solve`). Whoever keeps to the `LinearSolver`
protocol can take the slot without the optimiser knowing.
"""

import logging
from typing import Protocol

import numpy as np
import pyamg
from scipy.sparse import bsr_matrix
from scipy.sparse.linalg import splu

from meshes.errors import InvalidCase, NotConverged
from topopt.multigrid import MultigridSolver
from topopt.solution import Solution

log = logging.getLogger("phasemesh")

SOLVERS = ("auto", "multigrid", "pyamg", "direct")
SMALL = 3_000  # unknowns up to which `auto` factorises
FACTORISABLE = 200_000  # unknowns beyond which a factorisation of a solid needs too much memory


def make_solver(name, reference, modes):
    """Put a solver into the slot.

    Parameters
    ----------
    name : {"auto", "multigrid", "pyamg", "direct"}
        `auto` factorises small systems, takes multigrid for the rest, and falls back from
        multigrid to pyamg to the factorisation where one stalls; the others stand for themselves.
    reference : scipy.sparse.bsr_array, (3 n, 3 n) in 3 x 3 blocks [N/m]
        The matrix of the uniform material, with the pattern of all matrices to come.
    modes : (n, 3, 6) float array
        Rigid-body modes, zero at the fixed degrees of freedom.

    Raises
    ------
    InvalidCase
        If there is no solver of that name.
    """
    makers = {
        "multigrid": lambda: MultigridSolver(reference, modes),
        "pyamg": lambda: PyamgSolver(modes),
        "direct": DirectSolver,
    }
    if name in makers:
        return makers[name]()
    if name != "auto":
        raise InvalidCase(f"solver: must be one of {', '.join(SOLVERS)}, got {name!r}.")
    unknowns = reference.shape[0]
    if unknowns <= SMALL:
        return DirectSolver()
    names = ("multigrid", "pyamg", "direct") if unknowns <= FACTORISABLE else ("multigrid", "pyamg")
    return FallbackSolver([makers[n] for n in names])


class LinearSolver(Protocol):
    """A solver for symmetric positive definite matrices of 3 x 3 blocks on one mesh."""

    name: str

    def update(self, matrix, near=False):
        """Take a new matrix (bsr_array in 3 x 3 blocks) with the pattern of this mesh.

        Where it is `near` the last one, what was set up for that may stay.
        """

    def solve(self, right_side, start=None, tolerance=1e-6) -> Solution:
        """Solve K u = right_side (n, 3) to |f - K u| <= tolerance |f|, from `start` (n, 3).

        Raises NotConverged, with the history of residuals, where that cannot be reached.
        """


class DirectSolver:
    """A sparse LU factorisation: exact, and the reference for the others; for small meshes."""

    name = "direct"

    def update(self, matrix, near=False):
        self._matrix = matrix
        try:
            self._factors = splu(
                matrix.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise NotConverged(
                f"the direct solver cannot factorise the stiffness matrix ({error}); check that "
                "the supports hold every rigid motion."
            ) from error

    def solve(self, right_side, start=None, tolerance=1e-6):
        f = right_side.ravel()
        x = self._factors.solve(f)
        residual = f - self._matrix @ x
        size = float(np.linalg.norm(residual) / (np.linalg.norm(f) or 1.0))
        if not size <= tolerance:
            raise NotConverged(
                f"the direct solver leaves a relative residual of {size:.1e} where {tolerance:.1e} "
                "is asked for: the matrix is singular or nearly so; check the supports.",
                (size,),
            )
        shape = right_side.shape
        energy = max(float(residual @ self._factors.solve(residual)), 0.0)
        return Solution(x.reshape(shape), residual.reshape(shape), 1, (size,), self.name, energy)


class PyamgSolver:
    """Conjugate gradients with pyamg's smoothed aggregation, the hierarchy rebuilt in each update.

    Parameters
    ----------
    modes : (n, 3, 6) float array
        Rigid-body modes, zero at the fixed degrees of freedom.
    max_iterations : int
    """

    name = "pyamg"

    def __init__(self, modes, max_iterations=500):
        self._modes = modes.reshape(-1, modes.shape[2])
        self._max_iterations = max_iterations

    def update(self, matrix, near=False):
        self._matrix = bsr_matrix(matrix)
        smoother = ("block_gauss_seidel", {"sweep": "symmetric"})
        self._hierarchy = pyamg.smoothed_aggregation_solver(
            self._matrix,
            B=self._modes,
            symmetry="symmetric",
            strength=("symmetric", {"theta": 0.02}),
            improve_candidates=None,
            max_coarse=300,
            presmoother=smoother,
            postsmoother=smoother,
        )

    def solve(self, right_side, start=None, tolerance=1e-6):
        f = right_side.ravel()
        size = float(np.linalg.norm(f)) or 1.0
        history = []
        x = self._hierarchy.solve(
            f,
            x0=None if start is None else start.ravel(),
            tol=tolerance,
            accel="cg",
            maxiter=self._max_iterations,
            residuals=history,
        )
        residual = f - self._matrix @ x
        history = (*(float(h) / size for h in history), float(np.linalg.norm(residual)) / size)
        if not history[-1] <= tolerance:
            raise NotConverged(
                f"pyamg stalled at a relative residual of {history[-1]:.1e} after {len(history)} "
                f"iterations where {tolerance:.1e} is asked for; use solver: direct, or a mesh "
                "with better tets.",
                history,
            )
        shape = right_side.shape
        energy = max(float(residual @ (self._hierarchy.aspreconditioner() @ residual)), 0.0)
        told = (len(history) - 2, history, self.name, energy)
        return Solution(x.reshape(shape), residual.reshape(shape), *told)


class FallbackSolver:
    """Tries one solver after the other, first to last, until one converges.

    Every matrix starts again with the first, so that an answer does not depend on earlier ones.

    Parameters
    ----------
    makers : sequence of functions without arguments that make a LinearSolver
        Called when the solver is first needed.
    """

    name = "auto"

    def __init__(self, makers):
        self._makers = list(makers)
        self._solvers = [self._makers[0](), *[None] * (len(self._makers) - 1)]
        self._ready = -1

    def update(self, matrix, near=False):
        self._matrix, self._near = matrix, near and self._ready == 0
        self._ready = -1  # the last solver that has taken this matrix

    def solve(self, right_side, start=None, tolerance=1e-6):
        for k in range(len(self._makers)):
            try:
                self._prepare(k)
                return self._solvers[k].solve(right_side, start, tolerance)
            except NotConverged as stalled:
                if k + 1 == len(self._makers):
                    raise
                log.warning("%s Falling back to the next solver.", stalled)
        raise AssertionError("no solver to try")

    def _prepare(self, k):
        if self._ready < k:
            if self._solvers[k] is None:
                self._solvers[k] = self._makers[k]()
            self._solvers[k].update(self._matrix, self._near and k == 0)
            self._ready = k


def rigid_body_modes(points, fixed):
    """The near-null space of elasticity: three translations and three rotations.

    Parameters
    ----------
    points : (n, 3) float array [m]
    fixed : (n, 3) bool array
        Degrees of freedom at which the modes are set to zero.

    Returns
    -------
    (n, 3, 6) float array
        Centred and scaled, so that all six modes are of size one.
    """
    x, y, z = (points - points.mean(axis=0)).T / (np.ptp(points, axis=0).max() or 1.0)
    modes = np.zeros((len(points), 3, 6))
    modes[:, range(3), range(3)] = 1.0
    modes[:, 0, 3], modes[:, 1, 3] = -y, x
    modes[:, 1, 4], modes[:, 2, 4] = -z, y
    modes[:, 2, 5], modes[:, 0, 5] = -x, z
    modes[fixed] = 0.0
    return modes
