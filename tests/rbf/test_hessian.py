"""Second derivatives and curvatures."""

import numpy as np
import pytest

from meshes import InvalidCase
from rbf import fit_global, fit_hermite, fit_values, principal_curvatures, vertex_normals
from tests.shapes import TorusSurface, icosphere, torus


def differences(gradient, points, step):
    """Second derivatives by central differences of the gradient."""
    columns = [(gradient(points + step * e) - gradient(points - step * e)) for e in np.eye(3)]
    return np.stack(columns, axis=2) / (2 * step)


HERMITE = ["wendland_c4", "wendland_c6"]
VALUES = ["wendland_c2", "wendland_c4", "wendland_c6"]
GLOBAL = ["cubic", "gaussian", "multiquadric", "inverse_multiquadric"]


def make_fit(form, kernel):
    """An interpolant, and points to differentiate at."""
    if form == "hermite":
        mesh = icosphere(2)
        return fit_hermite(mesh.points, mesh.points, kernel=kernel), mesh.points[::7] * 1.02
    points = np.random.default_rng(0).random((300, 3))
    values = np.sin(3 * points[:, 0]) * points[:, 1] + points[:, 2] ** 2
    if form == "values":
        return fit_values(points, values, 0.6, kernel=kernel), points[::9] + 0.013
    return fit_global(points, values, kernel=kernel), points[::9] + 0.013


@pytest.mark.parametrize(
    ("form", "kernel"),
    [("hermite", name) for name in HERMITE]
    + [("values", name) for name in VALUES]
    + [("global", name) for name in GLOBAL],
)
def test_hessian_is_the_derivative_of_the_gradient(form, kernel):
    interpolant, points = make_fit(form, kernel)
    hessian = interpolant.hessian(points)
    scale = np.abs(hessian).max()
    np.testing.assert_allclose(hessian, np.swapaxes(hessian, 1, 2), atol=1e-12 * scale)
    coarse = np.abs(differences(interpolant.gradient, points, 2e-3) - hessian).max()
    fine = np.abs(differences(interpolant.gradient, points, 2e-4) - hessian).max()
    assert fine < 0.02 * scale
    assert fine < 0.3 * coarse


def test_second_derivatives_that_do_not_exist_are_refused():
    mesh = icosphere(1)
    with pytest.raises(InvalidCase, match="wendland_c4"):
        fit_hermite(mesh.points, mesh.points).hessian(mesh.points)
    points = np.random.default_rng(0).random((50, 3))
    with pytest.raises(InvalidCase, match="wendland_c2"):
        fit_values(points, points[:, 0], 0.7, kernel="wendland_c0").hessian(points)


def test_no_second_derivatives_outside_the_support():
    mesh = icosphere(1)
    surface = fit_hermite(mesh.points, mesh.points, support_radius=0.6, kernel="wendland_c4")
    hessian = surface.hessian(np.array([[1.0, 0, 0], [1.7, 0, 0], [50.0, 0, 0]]))
    assert np.isfinite(hessian[0]).all()
    assert np.isnan(hessian[1:]).all()


@pytest.mark.parametrize("kernel", HERMITE)
def test_curvatures_of_a_torus(kernel):
    mesh = torus(1.0, 0.4, 32, 16)
    exact = TorusSurface(1.0, 0.4).gradient(mesh.points)
    surface = fit_hermite(mesh.points, exact, kernel=kernel)
    middles, _ = surface.project(mesh.points[mesh.faces].mean(axis=1))
    radius = np.hypot(middles[:, 0], middles[:, 1])
    expected = np.stack([np.full(len(middles), 2.5), (radius - 1.0) / 0.4 / radius], axis=1)
    np.testing.assert_allclose(surface.curvatures(middles), expected, atol=0.02)


def test_principal_curvatures_of_a_quadric():
    # S = z - (a x^2 + b y^2) / 2 has curvatures -a and -b at the origin
    gradients = np.array([[0.0, 0, 2.0], [0, 0, 0]])
    hessians = np.tile(np.diag([-2.0 * 3.0, 2.0 * 1.5, 7.0]), (2, 1, 1))
    curvatures = principal_curvatures(gradients, hessians)
    np.testing.assert_allclose(curvatures[0], [1.5, -3.0])
    assert np.isnan(curvatures[1]).all()


def test_condition_number_is_that_of_the_matrix():
    from rbf.kernels import KERNELS
    from tests.rbf import reference

    mesh = icosphere(1)
    surface = fit_hermite(mesh.points, vertex_normals(mesh), support_radius=0.9)
    before = surface.value(mesh.points * 1.01)
    matrix = reference.hermite_matrix(KERNELS["wendland_c2"], mesh.points / 0.9, surface.normals)
    eigenvalues = np.linalg.eigvalsh(matrix)
    assert surface.condition_number() == pytest.approx(eigenvalues[-1] / eigenvalues[0], rel=0.02)
    np.testing.assert_array_equal(surface.value(mesh.points * 1.01), before)
