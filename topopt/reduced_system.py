"""A quadratic programme's linear system on the nodes that lie between their bounds."""

import numpy as np

from meshes.errors import NotConverged
from topopt.low_rank_kernels import conjugate_gradients, gram, pack, threads_that_pay

STEEPEST = -0.5  # see `ReducedSystem`


class ReducedSystem:
    """H_RR = J_RR + ... + W_R^T C W_R on some rows R of a programme, and its preconditioner.

    The preconditioner is the inverse of P = J + W^T C W on the rows, with J the diagonal of
    diag(D) + coupling A. P need not be definite: eigenvalues of J^-1/2 W^T C W J^-1/2 below -1/2
    are raised to -1/2.

    Parameters
    ----------
    qp : StepQP
    rows : (R,) uint32 array
    """

    def __init__(self, qp, rows):
        self._qp, self.rows = qp, rows
        self.mass = qp.mass[rows]
        self._jacobi = qp.jacobi[rows]
        self._packed, self._weight = pack(qp.learned, rows, self._jacobi)
        self._inner = self._core()

    def _core(self):
        """Core (k, k) of P^-1 = J^-1 - J^-1 W^T core W J^-1."""
        squares, vectors = np.linalg.eigh(self._weight)
        kept = squares > 1e-12 * squares.max(initial=0.0)
        root = vectors[:, kept] / np.sqrt(squares[kept])
        back = vectors[:, kept] * np.sqrt(squares[kept])
        values, turn = np.linalg.eigh(back.T @ self._qp.core @ back)
        values = np.maximum(values, STEEPEST)
        basis = root @ turn
        return (basis * (values / (1.0 + values))) @ basis.T

    def precondition(self, r):
        """P^-1 r (R,)."""
        scaled = r / self._jacobi
        shift = self._inner @ gram(self._packed, scaled[None])[:, 0]
        rest = r.copy()
        for factor, row in zip(shift, self._packed, strict=True):
            rest -= factor * row
        return rest / self._jacobi

    def solve(self, right_side, scale):
        """H_RR^-1 right_side (R,), to the programme's tolerance times `scale`."""
        nothing = np.zeros(len(self.rows))
        return self._iterate(right_side.copy(), nothing, nothing, scale)[0]

    def solve_in_plane(self, right_side, answer, reduction=0.0):
        """Solve H_RR x + kappa m = right_side, m.x = 0.

        Parameters
        ----------
        right_side : (R,) float array
        answer : (R,) float array
            P^-1 m.
        reduction : float
            How much smaller than that of x = 0 the residual need only get.

        Returns
        -------
        x : (R,) float array
        kappa : float
        solved : bool
            Whether to the programme's tolerance.
        """
        qp = self._qp
        kappa = float(answer @ right_side / (answer @ self.mass))
        scale = float(np.max(qp.upper - qp.lower) * np.sqrt(self._jacobi.sum()))
        rest = right_side - kappa * self.mass
        x, more, norm = self._iterate(rest, self.mass, answer, scale, reduction)
        return x, kappa + more, norm <= qp.tolerance * scale

    def _iterate(self, r, mass, answer, scale, reduction=0.0):
        qp, x = self._qp, np.zeros(len(self.rows))
        limits = (qp.tolerance * scale, reduction, 20 * int(np.sqrt(len(x))) + 2000)
        low_rank = (self._packed, qp.core, self._inner, self._weight, self.rows)
        with threads_that_pay(len(x)):
            iterations, kappa, norm = conjugate_gradients(
                *qp.matrix, self._jacobi, *low_rank, mass, answer, x, r, *limits
            )
        if iterations < 0:
            raise NotConverged(
                f"the step's linear system on {len(x)} nodes does not converge; the field, the "
                "sensitivities or the step size hold numbers that are not finite or far too large."
            )
        return x, kappa, norm
