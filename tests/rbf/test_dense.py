"""Global kernels, their polynomial tail, and the greedy choice of centres."""

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from meshes import InvalidCase, InvalidMesh, NotConverged
from rbf import KERNELS, fit_global, fit_greedy

GLOBAL = [name for name, kernel in KERNELS.items() if not kernel.compact]


def data(n=200, seed=0):
    points = np.random.default_rng(seed).random((n, 3))
    return points, np.sin(3 * points[:, 0]) * points[:, 1] + points[:, 2] ** 2


@pytest.mark.parametrize("name", GLOBAL)
def test_same_as_scipy(name):
    points, values = data()
    queries, _ = data(100, 1)
    interpolant = fit_global(points, values, kernel=name, scale=0.3)
    np.testing.assert_allclose(interpolant.value(points), values, atol=1e-6)
    degree = KERNELS[name].polynomial_order - 1
    peer = RBFInterpolator(points, values, kernel=name, epsilon=1 / 0.3, degree=degree)
    np.testing.assert_allclose(interpolant.value(queries), peer(queries), atol=1e-6)
    assert interpolant.residual < 1e-8
    assert interpolant.condition > 1.0


@pytest.mark.parametrize(("name", "degree"), [("multiquadric", 0), ("cubic", 1)])
def test_polynomials_of_the_tail_are_reproduced(name, degree):
    points, _ = data(60)
    queries, _ = data(50, 1)
    plane = np.array([0.3, -2.0, 1.0]) * degree
    interpolant = fit_global(points, 5.0 + points @ plane, kernel=name)
    np.testing.assert_allclose(interpolant.value(3 * queries), 5.0 + 3 * queries @ plane, atol=1e-8)
    np.testing.assert_allclose(interpolant.gradient(queries), np.tile(plane, (50, 1)), atol=1e-7)


def test_condition_is_about_right():
    points, values = data(80)
    interpolant = fit_global(points, values, kernel="inverse_multiquadric", scale=0.2)
    matrix = KERNELS["inverse_multiquadric"](np.linalg.norm(points[:, None] - points, axis=2) / 0.2)
    assert interpolant.condition == pytest.approx(np.linalg.cond(matrix, 1), rel=0.5)


def test_limits_are_stated():
    points, values = data(5001)
    with pytest.raises(InvalidCase, match="limited to 5000 points, got 5001"):
        fit_global(points, values)
    points, values = data(50)
    with pytest.raises(NotConverged, match="reduce scale"):
        fit_global(points, values, kernel="gaussian", scale=100.0)
    with pytest.raises(InvalidCase, match="in a plane"):
        fit_global(points * [1, 1, 0], values)
    with pytest.raises(InvalidCase, match="not global"):
        fit_global(points, values, kernel="wendland_c2")
    with pytest.raises(InvalidCase, match="scale"):
        fit_global(points, values, scale=-1.0)
    with pytest.raises(InvalidMesh, match="as many values"):
        fit_global(points, values[1:])


def test_duplicates_are_averaged_and_ridge_smooths():
    points, values = data(100)
    doubled = fit_global(np.vstack([points, points[:5]]), np.append(values, values[:5]))
    assert doubled.welded == 5
    np.testing.assert_allclose(doubled.value(points), values, atol=1e-8)
    noisy = values + 0.1 * np.random.default_rng(0).standard_normal(100)
    queries, exact = data(300, 1)
    errors = []
    for ridge in (0.0, 0.3):
        fit = fit_global(points, noisy, kernel="inverse_multiquadric", ridge=ridge)
        errors.append(np.std(fit.value(queries) - exact))
    assert errors[1] < 0.8 * errors[0]


def test_greedy_centres_meet_the_tolerance_with_fewer_points():
    points, values = data(1500)
    # a feature in one corner: that is where centres are needed
    values = values + np.exp(-((points - 0.1) ** 2).sum(axis=1) / 0.01)
    fit = fit_greedy(points, values, 0.01)
    assert len(fit.centres) < 700
    assert len(np.unique(fit.centres)) == len(fit.centres) == fit.counts[-1]
    error = np.abs(fit.interpolant.value(points) - values)
    assert error.max() <= 0.01
    assert error.max() == pytest.approx(fit.largest[-1])
    assert fit.rms[-1] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert (np.diff(fit.counts) > 0).all()
    near = (np.linalg.norm(points - 0.1, axis=1) < 0.2).mean()
    chosen = (np.linalg.norm(points[fit.centres] - 0.1, axis=1) < 0.2).mean()
    assert chosen > 2 * near
    rng = np.random.default_rng(0)
    at_random = rng.choice(1500, len(fit.centres), replace=False)
    blind = fit_global(points[at_random], values[at_random]).value(points) - values
    assert error.max() < 0.5 * np.abs(blind).max()


def test_greedy_with_compact_support_and_limits():
    points, values = data(400)
    fit = fit_greedy(points, values, 0.05, kernel="wendland_c2", support_radius=1.0)
    assert fit.largest[-1] <= 0.05
    assert len(fit.centres) < 300
    stopped = fit_greedy(points, values, 1e-12, most=100)
    assert len(stopped.centres) == 100
    with pytest.raises(InvalidCase, match="support_radius"):
        fit_greedy(points, values, 0.1, kernel="wendland_c2")
    with pytest.raises(InvalidCase, match="growth"):
        fit_greedy(points, values, 0.1, growth=1.0)
