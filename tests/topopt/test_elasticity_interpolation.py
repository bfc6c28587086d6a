"""mean(phi^3) on a tet, its derivative, and P1 geometry."""

import numba
import numpy as np
import pytest
from numpy.testing import assert_allclose

from meshes.errors import InvalidMesh
from meshes.structured import bcc_box
from meshes.tet_mesh import TetMesh
from tests.topopt import reference_elasticity as twin
from topopt.geometry import NodeCorners, mass_product, morton_order, tet_geometry
from topopt.interpolation import (
    mean_cube,
    mean_cube_bend,
    mean_cube_pullback,
    stiffness_factor,
    stiffness_slope,
)


@pytest.fixture(scope="module")
def mesh():
    return twin.perturbed_box((0, -1, 2), (1, 1, 3), (2, 3, 2))


@pytest.fixture
def phi(mesh):
    return np.random.default_rng(1).random(len(mesh.points))


def test_mean_cube_is_exact(mesh, phi):
    assert_allclose(mean_cube(phi, mesh.tets), twin.mean_cube(phi, mesh.tets), rtol=1e-13)


def test_stiffness_factor_is_one_in_material_and_r_in_void(mesh):
    ones = np.ones(len(mesh.points))
    assert_allclose(stiffness_factor(ones, mesh.tets, 1e-4), 1.0, rtol=1e-14)
    assert_allclose(stiffness_factor(0 * ones, mesh.tets, 1e-4), 1e-4, rtol=1e-14)


def test_pullback_is_the_derivative_of_the_weighted_sum(mesh, phi):
    rng = np.random.default_rng(2)
    weights, direction = rng.random(len(mesh.tets)), rng.standard_normal(len(phi))
    step = 1e-5
    ahead, behind = (
        weights @ mean_cube(phi + s * direction, mesh.tets) for s in (step, -step)
    )  # central differences of a cubic: the error is step^2 times its third derivative
    slope = mean_cube_pullback(phi, mesh.tets, weights) @ direction
    assert slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-8)


def test_slope_and_bend_are_derivatives_along_a_direction(mesh, phi):
    rng = np.random.default_rng(5)
    still, moving = rng.random((2, len(mesh.tets)))
    direction, step = rng.standard_normal(len(phi)), 1e-5
    moved = [phi + s * direction for s in (step, -step)]
    ahead, behind = (stiffness_factor(values, mesh.tets, 0.01) for values in moved)
    slope = stiffness_slope(phi, direction, mesh.tets, 0.01)
    assert_allclose(slope, (ahead - behind) / (2 * step), atol=1e-9)
    ahead, behind = (mean_cube_pullback(values, mesh.tets, still) for values in moved)
    expected = (ahead - behind) / (2 * step) + mean_cube_pullback(phi, mesh.tets, moving)
    bend = mean_cube_bend(phi, direction, mesh.tets, still, moving)
    assert_allclose(bend, expected, atol=1e-9)


def test_sums_at_nodes_are_scattered_ones_on_any_threads(mesh):
    local = np.random.default_rng(6).random((len(mesh.tets), 4))
    expected = np.zeros(len(mesh.points))
    np.add.at(expected, mesh.tets, local)
    corners = NodeCorners(mesh.tets, len(mesh.points))
    before = numba.get_num_threads()
    try:
        for threads in {1, min(2, numba.config.NUMBA_NUM_THREADS)}:
            numba.set_num_threads(threads)
            np.testing.assert_array_equal(corners.sums(local), expected)
    finally:
        numba.set_num_threads(before)


def test_geometry_against_inverse_matrices(mesh):
    geometry = tet_geometry(mesh)
    for e in range(0, len(mesh.tets), 7):
        assert_allclose(geometry.gradients[e], twin.gradients(mesh, e), rtol=0, atol=1e-12)
    assert geometry.volumes.sum() == pytest.approx(2.0, rel=1e-14)
    assert geometry.lumped_mass.sum() == pytest.approx(2.0, rel=1e-14)
    assert geometry.lumped_mass @ mesh.points[:, 2] == pytest.approx(2.0 * 2.5, rel=1e-13)


def test_geometry_refuses_an_inverted_tet(mesh):
    tets = mesh.tets.copy()
    tets[5] = tets[5, [1, 0, 2, 3]]
    broken = TetMesh(mesh.points, tets, mesh.facets, mesh.facet_patch, mesh.patches)
    with pytest.raises(InvalidMesh, match=r"1 of .* tet 5"):
        tet_geometry(broken)


def test_mass_product_integrates_products_of_linear_functions(mesh):
    x, _, z = mesh.points.T
    product = mass_product(mesh.tets, tet_geometry(mesh).volumes, z)
    # int x z over [0, 1] x [-1, 1] x [2, 3]
    assert product @ x == pytest.approx(0.5 * 2 * 2.5, rel=1e-13)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_morton_order_keeps_neighbours_near_at_every_scale(scale):
    mesh = bcc_box((0, 0, 0), (scale, scale, scale), (8, 8, 8))
    order = morton_order(mesh.points)
    assert_allclose(np.sort(order), np.arange(len(order)))
    steps = np.linalg.norm(np.diff(mesh.points[order], axis=0), axis=1)
    shuffled = np.random.default_rng(0).permutation(len(order))
    far = np.linalg.norm(np.diff(mesh.points[shuffled], axis=0), axis=1)
    assert steps.mean() < 0.25 * far.mean()
