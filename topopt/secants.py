"""What past steps tell about the second derivative of J: the metric's low-rank part.

With steps s_k and changes of the gradient y_k, the limited-memory BFGS metric over a base B0 is

    B = B0 - [B0 S, Y] [[S^T B0 S, L], [L^T, -E]]^-1 [B0 S, Y]^T,   S^T Y = L + E + upper part,

L strictly lower triangular, E diagonal. It is positive definite if all s_k.y_k > 0; where J bends
downward along s_k, y_k is moved towards B0 s_k (Powell's damping).
"""

from dataclasses import dataclass

import numpy as np

from topopt.geometry import unsigned
from topopt.low_rank_kernels import dot, multiply, threads_that_pay

MEMORY = 15  # pairs
DAMPING = 0.1  # least s.y in units of s.B0 s
LEAST_STEP = 1e-14  # of s.B0 s, in units of the largest; below, a pair is rounding only


@dataclass(frozen=True, eq=False)
class Secants:
    """The last directions and the changes of the gradient along them, oldest first.

    Parameters
    ----------
    steps, changes : (k, n) float arrays
        s_k, and y_k [J].
    """

    steps: np.ndarray
    changes: np.ndarray

    @classmethod
    def none(cls, n):
        """No pair yet, for fields of n nodes."""
        return cls(np.zeros((0, n)), np.zeros((0, n)))


class SecantMetric:
    """The metric B over one base B0 = diag(D) + coupling A, taught pair by pair.

    A further pair costs one product with B0, and its row of S^T B0 S and of S^T Y.

    Parameters
    ----------
    secants : Secants
    stiffness : (n, n) CSR matrix [m]
        A.
    coupling : float
    diagonal : (n,) float array
        D > 0.

    Notes
    -----
    R. Byrd, J. Nocedal, R. Schnabel, Representations of quasi-Newton matrices and their use in
    limited memory methods, Math. Programming 63 (1994), theorem 2.3; damping: M. Powell (1978).
    """

    def __init__(self, secants, stiffness, coupling, diagonal):
        self._stiffness, self._coupling = stiffness, coupling
        self._diagonal, self._none = diagonal, np.zeros(len(diagonal))
        self._steps, self._changes = [], []  # s, y
        self._pulled, self._stretched = [], []  # coupling A s, and B0 s
        self._bent = self._seen = np.zeros((0, 0))  # S^T B0 S, and the lower half of S^T Y
        self._secants = None
        for step, change in zip(secants.steps, secants.changes, strict=True):
            self.learn(step, change)
        self._secants = secants

    def learn(self, step, change):
        """Take in the pair s (n,), y (n,) [J]; the oldest one is dropped beyond MEMORY."""
        self._secants = None
        if len(self._steps) == MEMORY:
            for rows in (self._steps, self._changes, self._pulled, self._stretched):
                del rows[0]
            self._bent, self._seen = self._bent[1:, 1:], self._seen[1:, 1:]
        step, change = np.ascontiguousarray(step), np.ascontiguousarray(change)
        self._steps.append(step)
        self._changes.append(change)
        self._pulled.append(self._pull(step))
        self._stretched.append(self._pulled[-1] + self._diagonal * step)
        self._bent = _bordered(self._bent, [dot(step, other) for other in self._stretched])
        self._seen = _bordered(self._seen, [dot(step, other) for other in self._changes])

    def rebased(self, diagonal):
        """The SecantMetric of the same pairs over diag(diagonal) + coupling A; same bits as new.

        Products with A and those of steps with changes are taken over.
        """
        other = SecantMetric(Secants.none(len(diagonal)), self._stiffness, self._coupling, diagonal)
        other._steps, other._changes = list(self._steps), list(self._changes)
        other._pulled, other._seen = list(self._pulled), self._seen
        for step, pulled in zip(self._steps, self._pulled):
            other._stretched.append(pulled + diagonal * step)
            row = [dot(step, stretched) for stretched in other._stretched]
            other._bent = _bordered(other._bent, row)
        other._secants = self._secants
        return other

    def _pull(self, step):
        """coupling A s (n,)."""
        a, nothing = self._stiffness, np.zeros((0, len(step)), np.float32)
        pattern = unsigned(a.indptr), unsigned(a.indices)
        matrix = (*pattern, a.data, self._coupling, self._none)
        out = np.empty(len(step))
        with threads_that_pay(len(step)):
            multiply(*matrix, nothing, np.zeros(0), step, out)
        return out

    @property
    def secants(self):
        """The pairs that it knows, as Secants: the same object until it learns another."""
        if self._secants is None:
            shape = (-1, len(self._diagonal))
            steps, changes = (
                np.array(rows).reshape(shape) for rows in (self._steps, self._changes)
            )
            self._secants = Secants(steps, changes)
        return self._secants

    def low_rank_part(self):
        """W and C of B = B0 + W^T C W.

        Returns
        -------
        learned : (2 k, n) float32 array
        core : (2 k, 2 k) float array
        """
        diagonal = self._diagonal
        bent, seen = np.diag(self._bent), np.diag(self._seen)
        if not len(bent):
            return np.zeros((0, len(diagonal)), np.float32), np.zeros((0, 0))
        keep = np.flatnonzero(bent > LEAST_STEP * bent.max())
        gap = np.where(bent > seen, bent - seen, 1.0)
        share = np.where(seen < DAMPING * bent, (1.0 - DAMPING) * bent / gap, 1.0)
        sy = share * self._seen + (1.0 - share) * self._bent  # y damped: share y + rest B0 s
        kept = np.ix_(keep, keep)
        sbs, sy = self._bent[kept], sy[kept]
        lower, squares = np.tril(sy, -1), np.diag(np.diag(sy))
        middle = np.block([[sbs, lower], [lower.T, -squares]])
        scale = 1.0 / np.sqrt(np.abs(np.diag(middle)))
        unit = float(diagonal.sum())  # W without unit: single precision rounds at any scale alike
        learned = np.empty((2 * len(keep), len(diagonal)), np.float32)
        first, second = np.split(scale / np.sqrt(unit), 2)
        for k, pair in enumerate(keep):
            stretched = self._stretched[pair]
            np.multiply(first[k], stretched, out=learned[k], casting="same_kind")
            own = second[k] * share[pair] * self._changes[pair]
            if share[pair] < 1.0:
                own += second[k] * (1.0 - share[pair]) * stretched
            learned[len(keep) + k] = own
        core = -unit * np.linalg.inv(middle * scale * scale[:, None])
        return learned, 0.5 * (core + core.T)


def _bordered(square, row):
    """The symmetric matrix (k + 1, k + 1) of one (k, k) and a last row (k + 1,)."""
    out = np.empty((len(row), len(row)))
    out[:-1, :-1] = square
    out[-1], out[:, -1] = row, row
    return out
