"""Scattered values: reproduction, orders, duplicates."""

import numpy as np
import pytest

from meshes import InvalidCase, InvalidMesh
from rbf import fit_levels, fit_values
from rbf.levels import thin_out


def smooth(points):
    """A smooth function on the unit cube."""
    x, y, z = points.T
    return np.sin(2.0 * x + 0.3) * np.cos(1.5 * y) + np.exp(-z) * x


def jittered_grid(n):
    """n^3 points of the unit cube, its boundary included, shaken by a fifth of the spacing."""
    rng = np.random.default_rng(n)
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, n)] * 3), axis=-1).reshape(-1, 3)
    shaken = grid + rng.uniform(-0.2, 0.2, grid.shape) / (n - 1)
    inner = (grid > 0) & (grid < 1)
    return np.where(inner, shaken, grid)


@pytest.mark.parametrize("kernel", ["wendland_c0", "wendland_c2", "wendland_c4", "wendland_c6"])
def test_values_are_reproduced(kernel):
    points = np.random.default_rng(0).random((400, 3))
    values = smooth(points)
    interpolant = fit_values(points, values, support_radius=0.4, kernel=kernel, tolerance=1e-10)
    np.testing.assert_allclose(interpolant.value(points), values, atol=1e-7)
    assert interpolant.report.value_error < 1e-8


@pytest.mark.parametrize(
    ("kernel", "order"), [("wendland_c0", 1.7), ("wendland_c2", 2.7), ("wendland_c4", 3.7)]
)
def test_orders_at_fixed_support(kernel, order):
    rng = np.random.default_rng(9)
    queries = rng.random((4000, 3))
    sizes, errors = (7, 10, 14), []
    for n in sizes:
        points = jittered_grid(n)
        interpolant = fit_values(
            points, smooth(points), support_radius=1.0, kernel=kernel, tolerance=1e-10,
            neighbours=60,
        )  # fmt: skip
        error = interpolant.value(queries) - smooth(queries)
        errors.append(np.sqrt(np.mean(error**2)))
    fitted = -np.polyfit(np.log(np.array(sizes) - 1.0), np.log(errors), 1)[0]
    assert fitted > order, (errors, fitted)


def test_welded_values_are_averaged():
    points = np.random.default_rng(0).random((50, 3))
    doubled = np.vstack([points, points[:10]])
    values = np.concatenate([np.ones(50), 3.0 * np.ones(10)])
    interpolant = fit_values(doubled, values, support_radius=0.7)
    assert interpolant.report.welded == 10
    np.testing.assert_allclose(interpolant.value(points[:10]), 2.0, atol=1e-6)
    np.testing.assert_allclose(interpolant.value(points[10:]), 1.0, atol=1e-6)


def test_scaling_of_values_and_points():
    points = np.random.default_rng(0).random((100, 3))
    one = fit_values(points, smooth(points), support_radius=0.5)
    other = fit_values(points * 1e-9, 1e12 * smooth(points), support_radius=0.5e-9)
    queries = points * 0.9 + 0.05
    np.testing.assert_allclose(other.value(queries * 1e-9), 1e12 * one.value(queries), rtol=1e-6)
    np.testing.assert_allclose(
        other.gradient(queries * 1e-9) / 1e21, one.gradient(queries), rtol=1e-5, atol=1e-5
    )


def test_distance_to_data_tells_where_the_interpolant_means_something():
    points = np.random.default_rng(0).random((100, 3))
    interpolant = fit_values(points, smooth(points), support_radius=0.5)
    queries = np.array([points[3], [1.8, 0.5, 0.5], [0.5, 0.5, 0.5]])
    distance = interpolant.distance_to_data(queries)
    np.testing.assert_allclose(
        distance, np.linalg.norm(queries[:, None] - points, axis=2).min(axis=1), atol=1e-15
    )
    np.testing.assert_array_equal(interpolant.is_supported(queries), distance < 0.5)


def test_zero_values_and_bad_input():
    points = np.random.default_rng(0).random((30, 3))
    assert not fit_values(points, np.zeros(30), support_radius=0.5).value(points).any()
    with pytest.raises(InvalidMesh, match="as many values"):
        fit_values(points, np.zeros(29))
    with pytest.raises(InvalidMesh, match="values has 1 rows"):
        fit_values(points, np.append(np.zeros(29), np.inf))
    with pytest.raises(InvalidCase, match="compactly supported"):
        fit_values(points, np.zeros(30), kernel="gaussian")


def test_levels_reproduce_values_and_beat_one_level():
    points = np.random.default_rng(0).random((3000, 3))
    queries = np.random.default_rng(1).random((1000, 3))
    several = fit_levels(points, smooth(points), tolerance=1e-9)
    assert len(several.levels) == 4
    np.testing.assert_allclose(several.value(points), smooth(points), atol=1e-6)
    one = fit_levels(points, smooth(points), levels=1)
    errors = [np.std(fit.value(queries) - smooth(queries)) for fit in (several, one)]
    assert errors[0] < 0.2 * errors[1]
    value, gradient = several.value_and_gradient(queries)
    np.testing.assert_array_equal(value, several.value(queries))
    np.testing.assert_array_equal(gradient, several.gradient(queries))
    step = 1e-5 * np.eye(3)
    slopes = [several.value(queries + e) - several.value(queries - e) for e in step]
    np.testing.assert_allclose(gradient, np.stack(slopes, axis=1) / 2e-5, atol=1e-4)
    assert several.hessian(queries[:3]).shape == (3, 3, 3)


def test_levels_without_points_are_left_out():
    points = np.random.default_rng(0).random((60, 3))
    assert len(fit_levels(points, smooth(points), levels=9).levels) < 4
    with pytest.raises(InvalidCase, match="levels"):
        fit_levels(points, smooth(points), levels=0)


def test_thinning_keeps_one_point_in_each_cube():
    points = np.random.default_rng(0).random((500, 3))
    kept = thin_out(points, 0.25)
    cells = np.floor((points - points.min(axis=0)) / 0.25).astype(int)
    assert len(np.unique(cells[kept], axis=0)) == len(kept) == len(np.unique(cells, axis=0))
