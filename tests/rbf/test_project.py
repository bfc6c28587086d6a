"""Projection on the zero set."""

import numpy as np
import pytest

from meshes import InvalidCase
from rbf import fit_hermite, fit_offsets, fit_values, vertex_normals
from tests.shapes import TorusSurface, icosphere, torus


@pytest.fixture(scope="module")
def sphere():
    mesh = icosphere(3)
    return mesh, fit_hermite(mesh.points, vertex_normals(mesh))


def centroids(mesh):
    return mesh.points[mesh.faces].mean(axis=1)


@pytest.mark.parametrize("fit", [fit_hermite, fit_offsets])
def test_projected_points_lie_on_the_zero_set(fit):
    mesh = torus(n_major=60, n_minor=24)
    surface = fit(mesh.points, vertex_normals(mesh))
    rng = np.random.default_rng(0)
    start = centroids(mesh) * (1 + 0.03 * rng.standard_normal((len(mesh.faces), 1)))
    points, normals = surface.project(start)
    value, gradient = surface.value_and_gradient(points)
    assert np.abs(value).max() < 1.001e-6 * surface.support_radius
    length = np.linalg.norm(gradient, axis=1)
    np.testing.assert_allclose(normals, gradient / length[:, None], atol=1e-6)
    exact = TorusSurface()
    assert np.abs(exact.value(points)).max() < 1e-3
    assert np.einsum("ij,ij->i", normals, exact.gradient(points)).min() > 0.999


def test_projection_goes_about_along_the_normal(sphere):
    mesh, surface = sphere
    start = 1.05 * mesh.points[::3]
    points, normals = surface.project(start)
    np.testing.assert_allclose(points, mesh.points[::3], atol=3e-3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)


def test_vertices_stay_and_take_no_step(sphere):
    mesh, surface = sphere
    points, _, steps = surface.project_with_steps(mesh.points)
    assert not steps.any()
    np.testing.assert_allclose(points, mesh.points, atol=1e-14)


def test_walk_is_the_formula_and_converges_fast(sphere):
    mesh, surface = sphere
    start = centroids(mesh) * 1.03
    points, _, steps = surface.project_with_steps(start)
    assert steps.max() <= 4
    walked, residuals = start, [np.abs(surface.value(start)).max()]
    for taken in range(1, 4):
        value, gradient = surface.value_and_gradient(walked)
        slope2 = np.maximum((gradient**2).sum(axis=1), 0.04)
        walked = walked - (value / slope2)[:, None] * gradient
        residuals.append(np.abs(surface.value(walked)).max())
        done = steps == taken
        np.testing.assert_allclose(points[done], walked[done], atol=1e-12)
    assert residuals[1] < 0.1 * residuals[0]
    assert residuals[2] < 0.05 * residuals[1]
    assert residuals[3] < 0.05 * residuals[2]


def test_steps_are_clipped(sphere):
    mesh, surface = sphere
    start = mesh.points[:50] * (1 + 0.1 * surface.support_radius)
    longest = 0.01
    _, _, steps = surface.project_with_steps(start, longest_step=longest)
    assert steps.min() >= 8


def test_thesis_variant_renews_the_gradient_every_third_step(sphere):
    mesh, surface = sphere
    start = centroids(mesh) * 1.03
    points, normals, steps = surface.project_with_steps(start, refresh_gradient=3)
    assert np.abs(surface.value(points)).max() < 1.001e-6 * surface.support_radius
    gradient = surface.gradient(points)  # the normal is that of the point reached
    gradient /= np.linalg.norm(gradient, axis=1)[:, None]
    np.testing.assert_allclose(normals, gradient, atol=1e-6)
    walked, seen = start, 0
    for step in range(steps.max() + 1):
        done = steps == step
        np.testing.assert_allclose(points[done], walked[done], atol=1e-10)
        seen += done.sum()
        if step % 3 == 0:
            gradient = surface.gradient(walked)
        slope2 = (gradient**2).sum(axis=1)
        walked = walked - (surface.value(walked) / slope2)[:, None] * gradient
    assert seen == len(points)
    assert steps.max() > 3
    with pytest.raises(InvalidCase, match="refresh_gradient"):
        surface.project(start, refresh_gradient=0)


def test_points_without_support_or_way_come_back_as_nan(sphere):
    _, surface = sphere
    far = np.array([[5.0, 0, 0], [0, 0, 0], [np.nan, 0, 0], [1.01, 0, 0]])
    points, normals = surface.project(far)
    assert np.isnan(points[:3]).all()
    assert np.isnan(normals[:3]).all()
    assert np.linalg.norm(points[3]) == pytest.approx(1.0, abs=1e-3)


def test_the_edge_of_the_support_is_not_taken_for_the_surface(sphere):
    _, surface = sphere
    # |S| falls to 0 there, and so does its gradient
    edge = np.array([[1.0 + 0.995 * surface.support_radius, 0, 0]])
    edge = edge[surface.is_supported(edge)]
    value = surface.value(edge)
    assert np.isnan(surface.project(edge, tolerance=2 * np.abs(value).max())[0]).all()


def test_long_walks_are_binned_anew(sphere):
    mesh, surface = sphere
    start = mesh.points[:200] * (1.0 + 0.19 * surface.support_radius)
    points, _, steps = surface.project_with_steps(start)
    assert steps.min() >= 3
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=1e-3)


def test_scattered_distances_are_projected_too():
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.5, 1.5, (2000, 3))
    surface = fit_values(points, np.linalg.norm(points, axis=1) - 1.0, support_radius=0.8)
    start = rng.standard_normal((50, 3))
    start *= (rng.uniform(0.9, 1.1, 50) / np.linalg.norm(start, axis=1))[:, None]
    projected, _ = surface.project(start)
    np.testing.assert_allclose(surface.value(projected), 0.0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(projected, axis=1), 1.0, atol=0.02)
