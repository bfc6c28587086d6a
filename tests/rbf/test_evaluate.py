"""The cell evaluator against the sum over all centres."""

import itertools

import numpy as np
import pytest

from meshes import InvalidCase
from rbf import evaluate_kernels, fit_hermite
from rbf.cell_kernels import MAX_RUNS, REACH, neighbour_runs
from rbf.cells import CellGrid, sorting_order
from rbf.evaluate_kernels import LANES
from rbf.interpolant import NO_RUNS
from rbf.kernels import KERNELS
from rbf.sum_kernels import ROWS, sum_form
from tests.rbf import reference
from tests.shapes import icosphere

CASES = [
    ("wendland_c0", False),
    ("wendland_c2", False),
    ("wendland_c2", True),
    ("wendland_c4", False),
    ("wendland_c4", True),
    ("wendland_c6", True),
]


def evaluate(kernel, hermite, queries, centres):
    """The compiled sum for centres (m, 7) in any order."""
    grid, form = CellGrid(centres[:, :3]), sum_form(kernel.order, hermite)
    queries, order, keys, starts = grid.bin_queries(queries)
    rows = np.zeros((ROWS[type(form)], len(centres) + LANES))
    rows[:, : len(centres)] = centres[grid.order, : len(rows)].T
    values, gradients = np.empty(len(queries)), np.empty((len(queries), 3))
    results = *NO_RUNS, (1.0, 1.0), values, gradients
    cells = form, queries, order, keys, starts, rows, grid.arrays
    evaluate_kernels.evaluate(0, len(keys), *cells, *results)
    return values, gradients


@pytest.mark.parametrize(("name", "hermite"), CASES)
def test_evaluator_equals_the_sum_over_all_centres(name, hermite):
    rng = np.random.default_rng(3)
    centres = np.hstack([rng.random((150, 3)) * 3, rng.standard_normal((150, 4))])
    if not hermite:
        centres[:, 4:] = 0.0
    queries = rng.random((300, 3)) * 6 - 1.5
    queries[0] = centres[7, :3]  # a query on a centre
    values, gradients = evaluate(KERNELS[name], hermite, queries, centres)
    expected = reference.kernel_sum(KERNELS[name], queries, centres)
    assert 50 < expected[2].sum() < 280
    skip = slice(1, None) if name == "wendland_c0" else slice(None)  # no gradient on a centre
    np.testing.assert_allclose(values, expected[0], rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(gradients[skip], expected[1][skip], rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize("count", [evaluate_kernels.DENSE, evaluate_kernels.VERY_DENSE])
def test_many_queries_in_a_cell_are_summed_up_part_by_part(count):
    rng = np.random.default_rng(6)
    centres = np.hstack([rng.random((80, 3)) * 3, rng.standard_normal((80, 4))])
    queries = 1.0 + 0.45 * rng.random((count, 3))
    values, gradients = evaluate(KERNELS["wendland_c2"], True, queries, centres)
    some = slice(None, None, 8)
    expected = reference.kernel_sum(KERNELS["wendland_c2"], queries[some], centres)
    np.testing.assert_allclose(values[some], expected[0], rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(gradients[some], expected[1], rtol=1e-10, atol=1e-11)
    assert np.isfinite(values).all()


@pytest.mark.parametrize("sides", [2, 4])
def test_queries_are_divided_among_the_parts_of_their_box(sides):
    points = np.random.default_rng(0).random((100, 3))
    points[:, 2] = 0.25  # a box without height
    order, box = np.arange(100)[::-1].copy(), np.empty((2, 3))
    evaluate_kernels.bounds(points, order, 10, 90, box)
    places, starts = np.empty(80, np.int64), np.empty(sides**3 + 1, np.int64)
    evaluate_kernels.divide(points, order, 10, 90, box, sides, places, starts)
    assert starts[0] == 0
    assert starts[-1] == 80
    assert (np.diff(starts) >= 0).all()
    np.testing.assert_array_equal(np.sort(places), np.sort(order[10:90]))
    part = 2.0 * box[1, :2].max() / sides
    for start, end in itertools.pairwise(starts):
        if end > start:
            assert np.ptp(points[places[start:end]], axis=0).max() <= part


def test_runs_do_not_depend_on_the_cell_before():
    rng = np.random.default_rng(0)
    grid = CellGrid(rng.random((500, 3)) * [2, 2, 30])
    keys = rng.permutation(np.concatenate([grid.keys, grid.keys + 1, np.repeat(grid.keys, 2)]))
    for sequence in (np.sort(keys), keys):
        around, runs = np.full((MAX_RUNS + 1, 2), -1), np.zeros((2, MAX_RUNS, 2), np.int64)
        for key in sequence:
            count = neighbour_runs(key, REACH, grid.arrays, around, runs[0])
            fresh = np.full_like(around, -1)
            assert count == neighbour_runs(key, REACH, grid.arrays, fresh, runs[1])
            np.testing.assert_array_equal(runs[0, :count], runs[1, :count])


@pytest.mark.parametrize("limit", [50, 2.0**62])
def test_numbers_are_sorted_and_equal_ones_stay_in_order(limit):
    numbers = np.random.default_rng(0).integers(0, 50, 300)
    np.testing.assert_array_equal(sorting_order(numbers, limit), np.argsort(numbers, kind="stable"))


def test_outside_the_support_there_is_no_value():
    centres = np.zeros((1, 7))
    centres[0, 3] = 1.0
    queries = np.array([[0.999, 0, 0], [1.001, 0, 0], [-3, 0, 0], [0, 0, 1e6], [np.nan, 0, 0]])
    values, gradients = evaluate(KERNELS["wendland_c2"], True, queries, centres)
    assert np.isfinite(values[0])
    assert np.isnan(values[1:]).all()
    assert np.isnan(gradients[1:]).all()


def test_thin_structure_in_a_huge_box_takes_no_grid_of_the_box():
    rng = np.random.default_rng(0)
    ends = np.array([[0.0, 0, 0], [9e5, 9e5, 9e5]])
    centres = np.vstack([end + rng.random((20, 3)) for end in ends])
    grid = CellGrid(centres)
    assert sum(array.nbytes for array in grid.arrays) < 10_000
    weights = rng.standard_normal((40, 4))
    queries = centres[[3, 33]] + 0.3
    values, _ = evaluate(KERNELS["wendland_c2"], True, queries, np.hstack([centres, weights]))
    expected = reference.kernel_sum(KERNELS["wendland_c2"], queries, np.hstack([centres, weights]))
    np.testing.assert_allclose(values, expected[0], rtol=1e-8)
    with pytest.raises(InvalidCase, match="remove far outliers"):
        CellGrid(np.array([[0.0, 0, 0], [2e6, 0, 0]]))


def test_gradient_is_the_derivative_of_the_value():
    mesh = icosphere(2)
    surface = fit_hermite(mesh.points, mesh.points)
    points = mesh.points[::5] * 1.03 + 0.01
    gradient = surface.gradient(points)
    errors = []
    for step in (2e-3, 1e-3):
        shifted = [
            surface.value(points + step * e) - surface.value(points - step * e) for e in np.eye(3)
        ]
        errors.append(np.abs(np.stack(shifted, axis=1) / (2 * step) - gradient).max())
    assert errors[1] < 1e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)


def test_value_and_gradient_are_consistent_and_keep_the_order_of_the_queries():
    mesh = icosphere(2)
    surface = fit_hermite(mesh.points, mesh.points)
    points = mesh.points * np.linspace(0.9, 1.1, len(mesh.points))[:, None]
    value, gradient = surface.value_and_gradient(points)
    np.testing.assert_array_equal(surface.value(points), value)
    np.testing.assert_array_equal(surface.gradient(points), gradient)
    np.testing.assert_allclose(value, np.linalg.norm(points, axis=1) - 1.0, atol=0.02)
    one_by_one = np.concatenate([surface.value(p[None]) for p in points[:20]])
    np.testing.assert_allclose(value[:20], one_by_one, atol=1e-12)
    with pytest.raises(InvalidCase, match=r"\(n, 3\)"):
        surface.value(points[0])
    assert surface.value(np.empty((0, 3))).shape == (0,)
