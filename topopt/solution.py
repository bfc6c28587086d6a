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
    """

    displacement: np.ndarray
    residual_vector: np.ndarray
    iterations: int
    history: tuple[float, ...]
    solver: str
