"""A field carried from mesh to mesh: location against a slow twin, exactness, order, volume."""

import numba
import numpy as np
import pytest

from meshes import PhaseField
from meshes.structured import bcc_box
from tests.topopt.reference_transfer import integral, value_at
from topopt.geometry import tet_geometry
from topopt.transfer import TetLocator, transferred

SIZE = np.array([3.0, 1.0, 2.0])


def box(cells, scale=1.0):
    return bcc_box((0, 0, 0), scale * SIZE, cells)


def smooth(points):
    return 0.5 + 0.5 * np.sin(2.0 * points @ np.array([1.0, 0.5, -0.7]))


@pytest.fixture(scope="module")
def coarse():
    return box((3, 2, 2))


@pytest.mark.parametrize("scale", [1.0, 1e-9, 1e9])
def test_points_are_found_as_by_the_twin(scale):
    mesh = box((3, 2, 2), scale)
    rng = np.random.default_rng(0)
    values = rng.random(len(mesh.points))
    inside = scale * SIZE * rng.random((15, 3))
    on_sides = scale * SIZE * rng.integers(0, 5, (15, 3)) / 4.0
    points = np.concatenate([inside, on_sides, mesh.points[:10]])
    nodes, weights = TetLocator(mesh).weights(points)
    assert weights.min() >= 0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-14)
    found = np.einsum("ka,ka->k", weights, values[nodes])
    expected = [value_at(mesh, values, point) for point in points]
    np.testing.assert_allclose(found, expected, atol=1e-8)
    np.testing.assert_allclose(
        np.einsum("ka,kai->ki", weights, mesh.points[nodes]), points, atol=1e-8 * scale
    )


def test_points_outside_take_the_nearest_of_the_boundary(coarse):
    outside = np.array([[-0.5, 0.5, 1.0], [3.2, 1.4, -0.3], [1.0, 0.5, 2.0 + 1e-12]])
    nodes, weights = TetLocator(coarse).weights(outside)
    at = np.einsum("ka,kai->ki", weights, coarse.points[nodes])
    np.testing.assert_allclose(at, np.clip(outside, 0.0, SIZE), atol=1e-9)


def test_every_number_of_threads_finds_the_same(coarse):
    points = SIZE * np.random.default_rng(1).random((20_000, 3))
    results, before = [], numba.get_num_threads()
    for threads in (1, numba.config.NUMBA_NUM_THREADS):
        numba.set_num_threads(threads)
        results.append(TetLocator(coarse).weights(points))
    numba.set_num_threads(before)
    for one, two in zip(*results):
        np.testing.assert_array_equal(one, two)


def test_linear_functions_are_carried_over_exactly(coarse):
    fine = box((5, 3, 4))
    plane = np.array([0.1, 0.2, 0.15])
    found = transferred(PhaseField(coarse, 0.05 + coarse.points @ plane), fine)
    np.testing.assert_allclose(found, 0.05 + fine.points @ plane, atol=1e-10)


def test_the_same_mesh_gives_the_same_field(coarse):
    values = np.random.default_rng(2).random(len(coarse.points))
    np.testing.assert_allclose(transferred(PhaseField(coarse, values), coarse), values, atol=1e-9)


def test_error_falls_with_the_square_of_the_edge_length():
    """On meshes that do not contain each other; the field itself is on a much finer one."""
    errors = []
    for cells in (1, 2):
        finer, mesh = box((9 * cells, 5 * cells, 7 * cells)), box((3 * cells, cells, 2 * cells))
        found = transferred(PhaseField(finer, smooth(finer.points)), mesh)
        gap = found - smooth(mesh.points)
        mass = tet_geometry(mesh).lumped_mass
        errors.append(np.sqrt(mass @ gap**2 / mass.sum()))
    assert 1.6 < np.log2(errors[0] / errors[1]) < 2.6


def test_volume_is_kept_up_to_quadrature(coarse):
    """An interface sharper than either mesh: the points of the quadrature miss its kinks."""
    values = np.where(np.linalg.norm(coarse.points, axis=1) < 1.5, 1.0, 0.0)
    for cells, allowed in (((5, 3, 4), 3e-2), ((14, 5, 9), 4e-3)):
        found = transferred(PhaseField(coarse, values), box(cells))
        kept = integral(box(cells), found) / integral(coarse, values)
        assert kept == pytest.approx(1.0, abs=allowed)
        assert found.min() > -0.35 and found.max() < 1.35
