"""The matrix-free system, the preconditioner, and conjugate gradients."""

import tracemalloc

import numpy as np
import pytest

from meshes import NotConverged
from rbf import fit_hermite
from rbf.kernels import KERNELS
from rbf.solve import Preconditioner, solve
from rbf.system import HermiteSystem, PointSystem
from tests.rbf import reference
from tests.shapes import icosphere


def hermite_system(kernel="wendland_c2", ridge=0.0, radius=0.9):
    points = icosphere(1).points
    return HermiteSystem(points * radius, points, KERNELS[kernel].order, ridge)


def triple_system(offset=0.05):
    points = icosphere(1).points
    triples = np.stack([points, (1 + offset) * points, (1 - offset) * points], axis=1)
    return PointSystem(points, triples, KERNELS["wendland_c2"].order)


def apply(operator, system):
    """The matrix of a linear operator(x, out), column by column."""
    n, m = len(system.sites), system.unknowns_per_site
    columns = []
    for unit in np.eye(n * m):
        out = np.empty((n, m))
        operator(unit.reshape(n, m), out)
        columns.append(out.ravel())
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("kernel", ["wendland_c2", "wendland_c4", "wendland_c6"])
def test_hermite_product_is_the_matrix(kernel):
    system = hermite_system(kernel, ridge=0.01)
    expected = reference.hermite_matrix(KERNELS[kernel], system.sites, system.normals)
    expected[::2, ::2] += 0.01 * np.eye(len(system.sites))
    np.testing.assert_allclose(apply(system.multiply, system), expected, atol=1e-12)


def test_triple_product_is_the_matrix():
    system = triple_system()
    expected = reference.value_matrix(KERNELS["wendland_c2"], system.positions)
    np.testing.assert_allclose(apply(system.multiply, system), expected, atol=1e-13)


@pytest.mark.parametrize("make", [hermite_system, triple_system])
def test_preconditioner_is_the_sum_of_small_inverses(make):
    system = make()
    preconditioner = Preconditioner(system, 6)
    m = system.unknowns_per_site
    if make is hermite_system:
        matrix = reference.hermite_matrix(KERNELS["wendland_c2"], system.sites, system.normals)
    else:
        matrix = reference.value_matrix(KERNELS["wendland_c2"], system.positions)
    starts, groups = preconditioner.group_start, []
    width = 6 + np.diff(starts).max()
    for group, columns in enumerate(preconditioner.columns()):
        own = np.arange(starts[group], starts[group + 1])
        np.testing.assert_array_equal(columns[-len(own) :], own)
        distance = np.linalg.norm(system.sites[:, None] - system.sites[own], axis=2).min(axis=1)
        earlier = columns[: -len(own)]
        assert (earlier < own[0]).all()
        assert len(columns) <= width
        passed_over = np.setdiff1d(np.arange(own[0]), earlier)
        within_reach = distance[passed_over] < 0.5  # half a support is looked through
        if len(columns) == width:
            assert (distance[passed_over][within_reach] >= distance[earlier].max()).all()
        else:
            assert not within_reach.any()
        groups.append((columns, len(own)))
    expected = reference.approximate_inverse(matrix, groups, m)
    have = apply(preconditioner.apply, system)
    np.testing.assert_allclose(have, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())
    assert preconditioner.bad_pivots == 0


def test_with_all_neighbours_the_preconditioner_is_the_inverse():
    points = np.random.default_rng(0).random((40, 3)) * 0.4  # all within one another's reach
    system = PointSystem(points, points[:, None], KERNELS["wendland_c2"].order)
    product = apply(system.multiply, system) @ apply(Preconditioner(system, 40).apply, system)
    np.testing.assert_allclose(product, np.eye(40), atol=1e-2)


def test_solution_is_that_of_a_direct_solver():
    system = hermite_system()
    right = np.random.default_rng(0).standard_normal((len(system.sites), 2))
    solution = solve(system, right, 1e-11)
    matrix = reference.hermite_matrix(KERNELS["wendland_c2"], system.sites, system.normals)
    expected = np.linalg.solve(matrix, right.ravel())
    np.testing.assert_allclose(solution.x.ravel(), expected, rtol=1e-6, atol=1e-7)
    residual = right.ravel() - matrix @ solution.x.ravel()
    assert np.linalg.norm(residual) / np.linalg.norm(right) == pytest.approx(
        solution.residual, rel=0.1
    )
    assert solution.residual <= 1e-11


def test_condition_of_the_preconditioned_system():
    system = hermite_system()
    preconditioner = Preconditioner(system, 20)
    right = np.random.default_rng(1).standard_normal((len(system.sites), 2))
    estimate = solve(system, right, 1e-10, 20).condition
    product = apply(preconditioner.apply, system) @ apply(system.multiply, system)
    eigenvalues = np.sort(np.linalg.eigvals(product).real)
    assert estimate == pytest.approx(eigenvalues[-1] / eigenvalues[0], rel=0.05)


def test_iterations_do_not_grow_with_the_size():
    counts = []
    for subdivisions in (2, 4):
        mesh = icosphere(subdivisions)
        scale = 2.0**subdivisions / 6.6
        system = HermiteSystem(mesh.points * scale, mesh.points, 1)
        right = np.tile([0.0, 0.2], (len(mesh.points), 1))
        counts.append(solve(system, right, 1e-10).iterations)
    assert counts[1] <= 1.5 * counts[0]
    assert counts[1] < 30


def test_memory_of_a_fit_stays_below_two_kilobytes_a_vertex():
    count = 20_000  # 1060 bytes a vertex from 5,000 to 60,000
    k = np.arange(count) + 0.5
    height, angle = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5**0.5) * k
    ring = np.sqrt(1.0 - height**2)
    points = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    tracemalloc.start()
    try:
        fit_hermite(points, points)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert 500 * count < peak < 2000 * count


def test_zero_right_side_and_start():
    system = hermite_system()
    zero = solve(system, np.zeros((len(system.sites), 2)))
    assert zero.iterations == 0
    assert not zero.x.any()
    right = np.ones((len(system.sites), 2))
    again = solve(system, right, 1e-6, start=solve(system, right, 1e-9).x)
    assert again.iterations <= 1


def test_stalling_says_what_to_change():
    system = hermite_system(radius=1.0)
    right = np.ones((len(system.sites), 2))
    with pytest.raises(NotConverged, match="ridge") as caught:
        solve(system, right, 1e-10, iterations=3)
    assert len(caught.value.history) == 3


@pytest.mark.parametrize("scale", [1e-60, 1e60])
def test_size_of_the_right_side_does_not_matter(scale):
    system = hermite_system()
    right = np.random.default_rng(2).standard_normal((len(system.sites), 2))
    plain, scaled = solve(system, right, 1e-8), solve(system, scale * right, 1e-8)
    assert scaled.iterations == plain.iterations
    np.testing.assert_allclose(scaled.x / scale, plain.x, rtol=1e-9, atol=1e-12)
