"""What past steps tell about the second derivative of J: the metric's low-rank part.

With steps s_k and changes of the gradient y_k, the limited-memory BFGS metric over a base B0 is

    B = B0 - [B0 S, Y] [[S^T B0 S, L], [L^T, -E]]^-1 [B0 S, Y]^T,   S^T Y = L + E + upper part,

L strictly lower triangular, E diagonal. It is positive definite if all s_k.y_k > 0; where J bends
downward along s_k, y_k is moved towards B0 s_k (Powell's damping).
"""

from dataclasses import dataclass

import numpy as np

from topopt.low_rank_kernels import gram

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

    def after(self, step, change):
        """These and one more pair, the oldest dropped beyond MEMORY."""
        return Secants(
            np.vstack([self.steps, step])[-MEMORY:], np.vstack([self.changes, change])[-MEMORY:]
        )


def low_rank_part(secants, stiffness, coupling, diagonal):
    """W and C of B = B0 + W^T C W, with B0 = diag(D) + coupling A.

    Parameters
    ----------
    secants : Secants
        With at least one pair.
    stiffness : (n, n) CSR matrix [m]
        A.
    coupling : float
    diagonal : (n,) float array
        D > 0.

    Returns
    -------
    learned : (2 k, n) float32 array
    core : (2 k, 2 k) float array

    Notes
    -----
    R. Byrd, J. Nocedal, R. Schnabel, Representations of quasi-Newton matrices and their use in
    limited memory methods, Math. Programming 63 (1994), theorem 2.3; damping: M. Powell (1978).
    """
    s, y = secants.steps, secants.changes
    base = diagonal * s
    base += coupling * (stiffness @ s.T).T
    sbs, sy = gram(s, base), gram(s, y)
    bent, seen = np.diag(sbs), np.diag(sy)
    keep = np.flatnonzero(bent > LEAST_STEP * bent.max())
    gap = np.where(bent > seen, bent - seen, 1.0)
    share = np.where(seen < DAMPING * bent, (1.0 - DAMPING) * bent / gap, 1.0)
    sy = share * sy + (1.0 - share) * sbs  # of y damped: share y + (1 - share) B0 s
    kept = np.ix_(keep, keep)
    sbs, sy = sbs[kept], sy[kept]
    lower, squares = np.tril(sy, -1), np.diag(np.diag(sy))
    middle = np.block([[sbs, lower], [lower.T, -squares]])
    scale = 1.0 / np.sqrt(np.abs(np.diag(middle)))
    unit = float(diagonal.sum())  # W without unit: single precision rounds at any scale alike
    learned = np.empty((2 * len(keep), s.shape[1]), np.float32)
    first, second = np.split(scale / np.sqrt(unit), 2)
    for k, pair in enumerate(keep):
        np.multiply(first[k], base[pair], out=learned[k], casting="same_kind")
        own = second[k] * share[pair] * y[pair]
        if share[pair] < 1.0:
            own += second[k] * (1.0 - share[pair]) * base[pair]
        learned[len(keep) + k] = own
    core = -unit * np.linalg.inv(middle * scale * scale[:, None])
    return learned, 0.5 * (core + core.T)
