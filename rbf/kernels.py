"""Radial kernels: Wendland's with compact support, and the global ones of the thesis.

With r = |x - y| / c (c the support radius, or the scale of a global kernel) a kernel is given by
its profile phi(r) and the chain

    f1 = phi' / r,    f2 = f1' / r,    f3 = f2' / r,

from which every derivative of phi(|d|) follows, d = (x - y) / c:

    gradient  f1 d,    Hessian  f1 I + f2 d d^T,
    third     f2 (I x d, symmetrised) + f3 d x d x d.

Wendland's functions are normalised to phi(0) = 1 (the thesis prints phi_{3,2} with phi(0) = 3).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from meshes import InvalidCase

C0, C2, C4, C6 = 0, 1, 2, 3  # orders k of phi_{3,k}


@dataclass(frozen=True)
class Kernel:
    """A radial kernel.

    Parameters
    ----------
    name : str
    formula : str
        phi(r) as it would be written down; t = max(1 - r, 0).
    chain : callable
        r (array) -> (phi, f1, f2, f3); entries that do not exist at r = 0 are infinite or NaN.
    compact : bool
        Vanishes for r >= 1.
    smoothness : float
        Number of continuous derivatives of phi(|x|); infinite for the analytic ones.
    polynomial_order : int
        Order m of conditional positive definiteness: polynomials of degree < m must be added
        (0: positive definite, nothing is added).
    order : int
        k of phi_{3,k} for Wendland's functions, -1 for the others.
    sign : float
        Sign with which the quadratic form is positive on the admissible coefficients.
    """

    name: str
    formula: str
    chain: Callable
    compact: bool
    smoothness: float
    polynomial_order: int = 0
    order: int = -1
    sign: float = 1.0

    def __call__(self, r):
        """The profile phi at r >= 0."""
        return self.chain(np.asarray(r, dtype=float))[0]

    def derivative(self, r):
        """phi'(r) = f1 r."""
        r = np.asarray(r, dtype=float)
        first = self.chain(r)[1]
        return np.where(r > 0, first * r, -2.0 if self.order == C0 else 0.0)


def _wendland_c0(r):
    t = np.maximum(1.0 - r, 0.0)
    inside = r < 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        third = np.where(inside, -6.0 / r**5, 0.0)
        return t**2, -2.0 * t / r, np.where(inside, 2.0 / r**3, 0.0), third


def _wendland_c2(r):
    t = np.maximum(1.0 - r, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        third = -60.0 * t * (1.0 + r) / r**3
        return t**4 * (4 * r + 1), -20.0 * t**3, 60.0 * t**2 / r, third


def _wendland_c4(r):
    t = np.maximum(1.0 - r, 0.0)
    value = t**6 * (35 * r**2 + 18 * r + 3) / 3.0
    with np.errstate(divide="ignore", invalid="ignore"):
        return value, -56.0 / 3.0 * t**5 * (5 * r + 1), 560.0 * t**4, -2240.0 * t**3 / r


def _wendland_c6(r):
    t = np.maximum(1.0 - r, 0.0)
    value = t**8 * (32 * r**3 + 25 * r**2 + 8 * r + 1)
    first = -22.0 * t**7 * (16 * r**2 + 7 * r + 1)
    return value, first, 528.0 * t**6 * (6 * r + 1), -22176.0 * t**5


def _gaussian(r):
    e = np.exp(-(r**2))
    return e, -2.0 * e, 4.0 * e, -8.0 * e


def _multiquadric(r):
    q = np.sqrt(1.0 + r**2)
    return q, 1.0 / q, -1.0 / q**3, 3.0 / q**5


def _inverse_multiquadric(r):
    q = np.sqrt(1.0 + r**2)
    return 1.0 / q, -1.0 / q**3, 3.0 / q**5, -15.0 / q**7


def _cubic(r):
    with np.errstate(divide="ignore"):
        return r**3, 3.0 * r, 3.0 / r, -3.0 / r**3


KERNELS = {
    kernel.name: kernel
    for kernel in (
        Kernel("wendland_c0", "t^2", _wendland_c0, True, 0, order=C0),
        Kernel("wendland_c2", "t^4 (4 r + 1)", _wendland_c2, True, 2, order=C2),
        Kernel("wendland_c4", "t^6 (35 r^2 + 18 r + 3) / 3", _wendland_c4, True, 4, order=C4),
        Kernel("wendland_c6", "t^8 (32 r^3 + 25 r^2 + 8 r + 1)", _wendland_c6, True, 6, order=C6),
        Kernel("gaussian", "exp(-r^2)", _gaussian, False, np.inf),
        Kernel("multiquadric", "sqrt(1 + r^2)", _multiquadric, False, np.inf, 1, sign=-1.0),
        Kernel("inverse_multiquadric", "1 / sqrt(1 + r^2)", _inverse_multiquadric, False, np.inf),
        Kernel("cubic", "r^3", _cubic, False, 2, 2),
    )
}


def find_kernel(name, compact=None, least_smoothness=0):
    """Look a kernel up by name.

    Raises
    ------
    InvalidCase
        If there is none of that name, or it is not of the kind asked for.
    """
    if name not in KERNELS:
        raise InvalidCase(f"kernel {name!r} is unknown: choose one of {', '.join(KERNELS)}")
    kernel = KERNELS[name]
    if compact is not None and kernel.compact != compact:
        kind = "compactly supported" if compact else "global"
        names = ", ".join(k.name for k in KERNELS.values() if k.compact == compact)
        raise InvalidCase(f"kernel {name!r} is not {kind}, which is needed here: choose {names}")
    if kernel.smoothness < least_smoothness:
        fitting = [k for k in KERNELS.values() if compact is None or k.compact == compact]
        names = ", ".join(k.name for k in fitting if k.smoothness >= least_smoothness)
        raise InvalidCase(
            f"kernel {name!r} is only C{kernel.smoothness:g} and C{least_smoothness} is needed "
            f"here: choose one of {names}"
        )
    return kernel
