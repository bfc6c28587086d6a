"""Radial kernels: normalisation, derivatives, definiteness."""

import numpy as np
import pytest
from numba import njit

from meshes import InvalidCase
from rbf.kernels import KERNELS, find_kernel
from rbf.profiles import PROFILES, wendland_chain, wendland_value

WENDLAND = [kernel for kernel in KERNELS.values() if kernel.compact]


@pytest.mark.parametrize("kernel", KERNELS.values(), ids=lambda k: k.name)
def test_chain_is_the_derivative_of_the_one_before(kernel):
    r, step = np.linspace(0.05, 0.95, 19), 1e-6
    above, below = kernel.chain(r + step), kernel.chain(r - step)
    for order in range(3):
        slope = (above[order] - below[order]) / (2 * step)
        np.testing.assert_allclose(kernel.chain(r)[order + 1], slope / r, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("kernel", WENDLAND, ids=lambda k: k.name)
def test_wendland_is_one_at_the_centre_and_zero_outside(kernel):
    assert kernel(0.0) == 1.0
    assert not kernel(np.array([1.0, 1.5, 10.0])).any()
    assert kernel(0.999) > 0.0


@pytest.mark.parametrize("kernel", WENDLAND, ids=lambda k: k.name)
def test_wendland_is_as_smooth_as_its_name_says(kernel):
    # the even extension phi(|x|) has `smoothness` continuous derivatives at 0: the first odd
    # power in its expansion is 2 k + 1 (phi_{3,k} = 1 + c2 r^2 + ... + c r^(2k+1)); at r = 1 it
    # vanishes like t^(k+2)
    r = np.linspace(0.0, 0.4, 200)
    powers = np.polynomial.polynomial.polyfit(r, kernel(r), 12)
    odd = [p for p in range(1, 12, 2) if abs(powers[p]) > 1e-3]
    assert odd[0] == 2 * kernel.order + 1
    t = np.array([1e-2, 1e-3])
    decay = np.diff(np.log(kernel(1.0 - t))) / np.diff(np.log(t))
    assert decay == pytest.approx(2 * kernel.order + 2, abs=0.1)


@pytest.mark.parametrize("kernel", KERNELS.values(), ids=lambda k: k.name)
def test_definite_on_the_coefficients_that_polynomials_do_not_see(kernel):
    points = np.random.default_rng(1).random((60, 3))
    matrix = kernel(np.linalg.norm(points[:, None] - points[None], axis=2)) * kernel.sign
    degree = kernel.polynomial_order
    tail = np.hstack([np.ones((60, 1)), points])[:, : (0, 1, 4)[degree]]
    if degree:
        null = np.linalg.svd(tail.T)[2][tail.shape[1] :].T
        assert np.linalg.eigvalsh(matrix)[0] < 0.0  # without the tail it is not definite
        matrix = null.T @ matrix @ null
    assert np.linalg.eigvalsh(matrix)[0] > -1e-14 * np.abs(matrix).max() * 60


@njit
def _compiled_values(profile, r, values):
    for i in range(r.size):
        values[i] = wendland_value(profile, r[i])


@njit
def _compiled_chain(profile, r, chain):
    for i in range(r.size):
        chain[0, i], chain[1, i], chain[2, i] = wendland_chain(profile, r[i] * r[i])


@pytest.mark.parametrize("kernel", WENDLAND, ids=lambda k: k.name)
def test_compiled_profile_is_the_same(kernel):
    r = np.linspace(1e-3, 1.2, 50)
    profile, expected = PROFILES[kernel.order], kernel.chain(r)
    values, chain = np.empty(50), np.empty((3, 50))
    _compiled_values(profile, r, values)
    np.testing.assert_allclose(values, expected[0], rtol=1e-13, atol=1e-15)
    if kernel.order > 0:
        _compiled_chain(profile, r, chain)
        for have, want in zip(chain, expected[:3]):
            np.testing.assert_allclose(have, want, rtol=1e-12, atol=1e-12)


def test_unknown_or_unfit_kernels_are_named():
    with pytest.raises(InvalidCase, match="wendland_c2"):
        find_kernel("wendland")
    with pytest.raises(InvalidCase, match="not compactly supported"):
        find_kernel("gaussian", compact=True)
    with pytest.raises(InvalidCase, match="only C0"):
        find_kernel("wendland_c0", least_smoothness=2)
