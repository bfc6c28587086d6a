"""Scattered values by blended local interpolants."""

import numba
import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from meshes import InvalidCase, InvalidMesh
from rbf import fit_local
from rbf.local import grow_tree
from tests.rbf.test_values import jittered_grid, smooth


def quadratic(points):
    """A polynomial of degree 2 with all its terms, and its gradient."""
    x, y, z = points.T
    value = 1.0 + x - 2.0 * y + 0.5 * z + x**2 - y**2 + 3.0 * z**2 + x * y - 2.0 * x * z + y * z
    slopes = 1 + 2 * x + y - 2 * z, -2 - 2 * y + x + z, 0.5 + 6 * z - 2 * x + y
    return value, np.stack(slopes, axis=1)


def test_values_are_met_and_polynomials_of_degree_two_are_reproduced():
    rng = np.random.default_rng(0)
    points, queries = rng.random((1500, 3)), rng.random((400, 3)) * 1.06 - 0.03
    interpolant = fit_local(points, quadratic(points)[0])
    assert interpolant.patches > 20
    value, gradient = interpolant.value_and_gradient(queries)
    np.testing.assert_allclose(value, quadratic(queries)[0], atol=1e-9)
    np.testing.assert_allclose(gradient, quadratic(queries)[1], atol=1e-7)
    interpolant = fit_local(points, smooth(points))
    np.testing.assert_allclose(interpolant.value(points), smooth(points), atol=1e-11)
    assert interpolant.value_error < 1e-11


def test_blend_of_another_librarys_interpolants():
    rng = np.random.default_rng(2)
    points, queries = rng.random((600, 3)), rng.random((60, 3))
    values = rng.standard_normal(600)
    _, middles, reaches, members = grow_tree(points, 80, 0.25)
    assert min(len(inside) for inside in members) > 15
    top, bottom = np.zeros(60), np.zeros(60)
    for middle, reach, inside in zip(middles, reaches, members, strict=True):
        u = np.abs(queries - middle) / reach
        weight = np.prod(np.maximum(1.0 - u, 0.0) ** 3 * (3.0 * u + 1.0), axis=1)
        peer = RBFInterpolator(points[inside], values[inside], kernel="quintic", degree=2)
        top += weight * peer(queries)
        bottom += weight
    value = fit_local(points, values, least=1).value(queries)
    np.testing.assert_allclose(value, top / bottom, rtol=1e-8, atol=1e-8)


def test_order_of_convergence():
    queries = np.random.default_rng(9).random((4000, 3))
    sizes, errors = (9, 17), []  # boxes halve with the spacing
    for n in sizes:
        points = jittered_grid(n)
        error = fit_local(points, smooth(points)).value(queries) - smooth(queries)
        errors.append(np.sqrt(np.mean(error**2)))
    assert np.log2(errors[0] / errors[1]) > 2.9, errors
    assert errors[1] < 2e-5


def test_gradient_is_the_derivative_of_the_value():
    rng = np.random.default_rng(4)
    points = rng.random((800, 3))
    interpolant = fit_local(points, rng.standard_normal(800))
    queries, step = rng.random((300, 3)), 1e-5 * np.eye(3)
    slopes = [interpolant.value(queries + e) - interpolant.value(queries - e) for e in step]
    gradient = interpolant.gradient(queries)
    np.testing.assert_allclose(gradient, np.stack(slopes, axis=1) / 2e-5, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_scales_do_not_matter(scale):
    rng = np.random.default_rng(0)
    points, queries = rng.random((300, 3)), rng.random((50, 3))
    one = fit_local(points, smooth(points)).value(queries)
    other = fit_local(points * scale, smooth(points) / scale).value(queries * scale)
    np.testing.assert_allclose(other * scale, one, rtol=1e-7)


def test_any_density_and_shape():
    rng = np.random.default_rng(1)
    crowd = np.vstack([rng.random((300, 3)), 0.5 + 1e-3 * rng.standard_normal((2000, 3))])
    flat = np.hstack([rng.random((500, 2)), np.zeros((500, 1))])
    ball = rng.standard_normal((500, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    line = np.linspace(0.0, 1.0, 200)[:, None] * [1.0, 2.0, 3.0]
    for points in (crowd, flat, ball, line, points_of_a_few()):
        interpolant = fit_local(points, smooth(points))
        np.testing.assert_allclose(interpolant.value(points), smooth(points), atol=1e-8)
        assert np.isfinite(interpolant.value(0.5 * (points[1:] + points[:-1]))).all()
    near = crowd[300:] + 2e-4
    np.testing.assert_allclose(fit_local(crowd, smooth(crowd)).value(near), smooth(near), atol=1e-6)


def points_of_a_few():
    """Fewer points than a polynomial of degree 2 has terms."""
    return np.random.default_rng(0).random((5, 3))


def test_outside_the_data_there_is_no_value():
    points = np.random.default_rng(0).random((2000, 3))
    interpolant = fit_local(points, smooth(points))
    queries = np.array([[0.5, 0.5, 0.5], [-0.02, 0.5, 0.5], [2, 0.5, 0.5], [np.nan, 0, 0]])
    np.testing.assert_array_equal(np.isfinite(interpolant.value(queries)), [1, 1, 0, 0])
    np.testing.assert_allclose(
        interpolant.distance_to_data(queries[:3]),
        np.linalg.norm(queries[:3, None] - points, axis=2).min(axis=1),
    )
    assert interpolant.value(np.empty((0, 3))).shape == (0,)


def test_threads_and_other_queries_change_no_bit():
    rng = np.random.default_rng(3)
    points, queries = rng.random((3000, 3)), rng.random((5000, 3))
    before, results = numba.get_num_threads(), []
    try:
        for threads in {1, before}:
            numba.set_num_threads(threads)
            results.append(fit_local(points, smooth(points)).value(queries))
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(results[0], results[-1])
    interpolant = fit_local(points, smooth(points))
    np.testing.assert_array_equal(interpolant.value(queries[:2000]), results[0][:2000])


def test_duplicates_are_averaged_and_bad_input_is_named():
    points = np.random.default_rng(0).random((200, 3))
    doubled = np.vstack([points, points[:10]])
    interpolant = fit_local(doubled, np.concatenate([np.ones(200), 3.0 * np.ones(10)]))
    assert interpolant.welded == 10
    np.testing.assert_allclose(interpolant.value(points[:10]), 2.0, atol=1e-9)
    with pytest.raises(InvalidCase, match="most"):
        fit_local(points, np.ones(200), most=2)
    with pytest.raises(InvalidMesh, match="not finite"):
        fit_local(points, np.full(200, np.nan))
    with pytest.raises(InvalidCase, match="two distinct"):
        fit_local(points[:1], np.ones(1))
    with pytest.raises(InvalidCase, match=r"\(n, 3\)"):
        interpolant.value(points[0])
