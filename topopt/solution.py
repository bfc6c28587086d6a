"""What every linear solver hands back."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Solution:
    """What a linear solver hands back.

    Parameters
    ----------
    displacement : (n, 3) float array [m]
    residual_vector : (n, 3) float array [N]
        f - K u, computed from the displacement itself.
    iterations : int
    history : tuple of float
        Relative residual norms, oldest first.
    solver : str
        Who solved it.
    error_energy : float [J]
        Estimate of r . K^-1 r for the residual r, the squared energy norm of the error; where
        iterations have to tell, that of the last but one: three to thirty times as much.
    """

    displacement: np.ndarray
    residual_vector: np.ndarray
    iterations: int
    history: tuple[float, ...]
    solver: str
    error_energy: float
