"""The multigrid cycle: smooth, correct from the coarser level, smooth again.

The smoother is Chebyshev iteration with block Jacobi, aimed at the upper part of the spectrum of
D^-1 A, [lower, upper] x lambda_max. It is a polynomial in D^-1 A, hence symmetric, and has no
order of nodes that threads could disturb.

A V-cycle visits each level once. With three or more levels the errors of the coarse corrections
add up, so that a level in the middle is solved by two steps of conjugate gradients with the cycle
below as preconditioner instead (K-cycle, Notay and Vassilevski 2008): that is cheap where the
level is small.
"""

from contextlib import contextmanager
from dataclasses import dataclass

import numba
import numpy as np

from topopt.multigrid import cycle_kernels as kernels

SINGLE = np.float32
SERIAL_BYTES = 2**21  # a matrix of this size takes a core about 0.2 ms


@dataclass(frozen=True)
class CycleSettings:
    """How a cycle is run.

    Parameters
    ----------
    degree : int
        Chebyshev degree of the smoother, before and after.
    lower, upper : float
        The interval it damps, in units of lambda_max(D^-1 A).
    krylov_unknowns : int
        Levels of at most so many unknowns (below the finest, above the coarsest) are solved by
        two steps of conjugate gradients (K-cycle); 0 gives a V-cycle.
    """

    degree: int = 2
    lower: float = 0.2
    upper: float = 1.1
    krylov_unknowns: int = 6000


def apply_cycle(levels, settings, depth=0):
    """Put an approximation of A^-1 f into x of levels[depth], for the f that stands there."""
    with threads_that_pay(levels[depth]):
        _apply_cycle(levels, settings, depth)


@contextmanager
def threads_that_pay(level):
    """One thread where a level's matrix is so small that waking the others costs more."""
    threads = numba.get_num_threads()
    if level.blocks.nbytes < SERIAL_BYTES:
        numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(threads)


def _apply_cycle(levels, settings, depth):
    level = levels[depth]
    if level.transfer is None:
        kernels.dense_product(level.dense_inverse, level.f, level.x)
        return
    coarse = levels[depth + 1]
    smooth_from_zero(level, settings.degree, settings.lower, settings.upper)
    level.take_residual(level.f, level.x, level.residual)
    level.restrict(coarse)
    if coarse.transfer is not None and _is_small(coarse, settings):
        solve_by_krylov(levels, settings, depth + 1)
    else:
        apply_cycle(levels, settings, depth + 1)
    level.prolong(coarse)
    smooth(level, settings.degree, settings.lower, settings.upper)


def _is_small(level, settings):
    return level.f.size <= settings.krylov_unknowns


def chebyshev_steps(degree, lower, upper):
    """Momentum and gain of each Chebyshev step on the interval [lower, upper].

    step_k = momentum_k step_(k-1) + gain_k D^-1 (f - A x_(k-1));  x_k = x_(k-1) + step_k.
    """
    centre, radius = (upper + lower) / 2.0, (upper - lower) / 2.0
    ratio = radius / centre
    steps = [(0.0, 1.0 / centre)]
    for _ in range(degree - 1):
        following = 1.0 / (2.0 * centre / radius - ratio)
        steps.append((following * ratio, 2.0 * following / radius))
        ratio = following
    return steps


def smooth_from_zero(level, degree, lower, upper):
    """x = the smoother's answer to f, from x = 0; the first step needs no product with A."""
    steps = chebyshev_steps(degree, lower * level.largest, upper * level.largest)
    kernels.first_step(
        level.chunks, level.inverse, level.f, SINGLE(steps[0][1]), level.step, level.x
    )
    _go_on(level, steps[1:])


def smooth(level, degree, lower, upper):
    """Improve x by the smoother."""
    _go_on(level, chebyshev_steps(degree, lower * level.largest, upper * level.largest))


def _go_on(level, steps):
    for momentum, gain in steps:
        level.apply_step(level.f, level.x, SINGLE(momentum), SINGLE(gain), level.other)
        level.x, level.other = level.other, level.x


def solve_by_krylov(levels, settings, depth):
    """Two steps of flexible conjugate gradients on levels[depth], the cycle as preconditioner."""
    with threads_that_pay(levels[depth]):
        _solve_by_krylov(levels, settings, depth)


def _solve_by_krylov(levels, settings, depth):
    level = levels[depth]
    f, zero = level.f.copy(), np.zeros_like(level.f)
    apply_cycle(levels, settings, depth)
    first = level.x.copy()
    a_first = np.empty_like(f)
    level.take_residual(zero, first, a_first)  # -A c
    energy = -kernels.inner_product(first, a_first)
    if not energy > 0.0:
        return
    along = kernels.inner_product(first, f) / energy
    level.f += SINGLE(along) * a_first
    apply_cycle(levels, settings, depth)
    second = level.x
    coupling = -kernels.inner_product(second, a_first) / energy
    second -= SINGLE(coupling) * first  # A-orthogonal to first
    a_second = level.residual
    level.take_residual(zero, second, a_second)
    energy = -kernels.inner_product(second, a_second)
    along_second = kernels.inner_product(second, level.f) / energy if energy > 0.0 else 0.0
    second *= SINGLE(along_second)
    second += SINGLE(along) * first
    level.f[:] = f
