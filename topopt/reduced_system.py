"""A quadratic programme's linear system on the nodes that lie between their bounds."""

import numpy as np

from meshes.errors import NotConverged
from topopt.low_rank_kernels import conjugate_gradients, gram, threads_that_pay

STEEPEST = -0.5  # see `ReducedSystem`


class ReducedSystem:
    """H_RR = J_RR + ... + W_R^T C W_R on some rows R of a programme, and its preconditioner.

    The preconditioner is the inverse of P = J + W^T C W on the rows, with J the diagonal of
    diag(D) + coupling A. P need not be definite: eigenvalues of J^-1/2 W^T C W J^-1/2 below -1/2
    are raised to -1/2.

    Parameters
    ----------
    qp : StepQP
    rows : (R,) int32 array
    """

    def __init__(self, qp, rows):
        self._qp, self.rows = qp, rows
        self.mass = qp.mass[rows]
        self._jacobi = qp.jacobi[rows]
        self._packed = np.ascontiguousarray(qp.learned[:, rows])
        self._inner, self._weight = self._core()

    def _core(self):
        """Core of P^-1 = J^-1 - J^-1 W^T core W J^-1, and W J^-1 W^T: (k, k) each."""
        weight = gram(self._packed, self._packed / self._jacobi)
        weight = 0.5 * (weight + weight.T)
        squares, vectors = np.linalg.eigh(weight)
        kept = squares > 1e-12 * squares.max(initial=0.0)
        root = vectors[:, kept] / np.sqrt(squares[kept])
        back = vectors[:, kept] * np.sqrt(squares[kept])
        values, turn = np.linalg.eigh(back.T @ self._qp.core @ back)
        values = np.maximum(values, STEEPEST)
        basis = root @ turn
        return (basis * (values / (1.0 + values))) @ basis.T, weight

    def precondition(self, r):
        """P^-1 r (R,)."""
        scaled = r / self._jacobi
        shift = self._inner @ gram(self._packed, scaled[None])[:, 0]
        for factor, row in zip(shift, self._packed, strict=True):
            scaled -= factor * row / self._jacobi
        return scaled

    def solve(self, right_side, scale):
        """H_RR^-1 right_side (R,), to the programme's tolerance times `scale`."""
        nothing = np.zeros(len(self.rows))
        return self._iterate(right_side.copy(), nothing, nothing, scale)[0]

    def solve_in_plane(self, right_side, answer):
        """Solve H_RR x + kappa m = right_side, m.x = 0.

        Parameters
        ----------
        right_side : (R,) float array
        answer : (R,) float array
            P^-1 m.

        Returns
        -------
        x : (R,) float array
        kappa : float
        """
        qp = self._qp
        kappa = float(answer @ right_side / (answer @ self.mass))
        scale = float(np.max(qp.upper - qp.lower) * np.sqrt(self._jacobi.sum()))
        x, more = self._iterate(right_side - kappa * self.mass, self.mass, answer, scale)
        return x, kappa + more

    def _iterate(self, r, mass, answer, scale):
        qp, x = self._qp, np.zeros(len(self.rows))
        limits = (qp.tolerance * scale, 20 * int(np.sqrt(len(x))) + 2000)
        low_rank = (self._packed, qp.core, self._inner, self._weight, self.rows)
        with threads_that_pay(len(x)):
            iterations, kappa = conjugate_gradients(
                *qp.matrix, self._jacobi, *low_rank, mass, answer, x, r, *limits
            )
        if iterations < 0:
            raise NotConverged(
                f"the step's linear system on {len(x)} nodes does not converge; the field, the "
                "sensitivities or the step size hold numbers that are not finite or far too large."
            )
        return x, kappa
