"""How much to smooth: the ridge from the noise, or from the data alone."""

import numpy as np
import pytest

from meshes import InvalidCase
from rbf import fit_hermite, fit_values
from rbf.kernels import KERNELS
from rbf.ridge import _misfit
from rbf.system import PointSystem
from tests.rbf import reference
from tests.shapes import icosphere

NOISE = 0.05


def noisy_values(n=600):
    rng = np.random.default_rng(0)
    points = rng.random((n, 3))
    exact = np.sin(4 * points[:, 0]) * np.cos(3 * points[:, 1]) + points[:, 2] ** 2
    return points, exact, exact + NOISE * rng.standard_normal(n)


def test_score_is_that_of_the_dense_matrices():
    points, _, values = noisy_values(60)
    kernel, ridge = KERNELS["wendland_c2"], 0.1

    def make_system(ridge):
        return PointSystem(points, points[:, None], kernel.order, ridge)

    right = values[make_system(0.0).site_order, None]
    signs = np.sign(np.random.default_rng(1).standard_normal((200, 60, 1)))
    misfit, score = _misfit(make_system, right, ridge, 40, signs)
    sites = make_system(0.0).sites
    matrix = reference.value_matrix(kernel, sites)
    rest = np.eye(60) - matrix @ np.linalg.inv(matrix + ridge * np.eye(60))
    deviation = rest @ right[:, 0]
    assert misfit == pytest.approx(np.sqrt(np.mean(deviation**2)), rel=1e-3)
    expected = np.mean(deviation**2) / (np.trace(rest) / 60) ** 2
    assert score == pytest.approx(expected, rel=0.05)


def test_discrepancy_principle_leaves_the_noise():
    points, _, values = noisy_values()
    fit = fit_values(points, values, support_radius=0.6, noise=NOISE)
    assert fit.report.misfit == pytest.approx(NOISE, rel=0.02)
    deviation = fit.value(points) - values
    assert np.sqrt(np.mean(deviation**2)) == pytest.approx(fit.report.misfit, rel=1e-4)


def test_cross_validation_is_near_the_best_ridge():
    points, exact, values = noisy_values()
    chosen = fit_values(points, values, support_radius=0.6, ridge="gcv")
    error = np.std(chosen.value(points) - exact)
    others = [
        np.std(fit_values(points, values, 0.6, ridge=ridge).value(points) - exact)
        for ridge in 10.0 ** np.arange(-4, 3)
    ]
    assert error < 1.1 * min(others)
    assert error < 0.7 * NOISE


def test_noisy_surface():
    mesh = icosphere(2)
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(mesh.points))
    points = mesh.points * (1.0 + noise)[:, None]
    rough = np.std(np.linalg.norm(fit_hermite(points, mesh.points).project(mesh.points)[0], axis=1))
    for options in ({"noise": 0.01}, {"ridge": "gcv"}):
        surface = fit_hermite(points, mesh.points, **options)
        smooth = np.linalg.norm(surface.project(mesh.points)[0], axis=1)
        assert np.std(smooth) < 0.6 * rough
        assert surface.report.ridge > 0.0
    with pytest.raises(InvalidCase, match="noise"):
        fit_hermite(points, mesh.points, noise=-1.0)
    with pytest.raises(InvalidCase, match="gcv"):
        fit_hermite(points, mesh.points, ridge="lots")
