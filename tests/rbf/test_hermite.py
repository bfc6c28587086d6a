"""Surfaces through points and normals: Hermite form and offset triples."""

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshes import ImplicitSurface, InvalidCase, InvalidMesh
from rbf import fit_hermite, fit_offsets, pca_normals, vertex_normals
from rbf.spacing import point_spacing
from tests.shapes import TorusSurface, icosphere, torus

FORMS = [fit_hermite, fit_offsets]
KERNELS = ["wendland_c2", "wendland_c4", "wendland_c6"]


def plane_grid(n=12, spacing=1.0):
    """Points of a square grid in the plane z = 0, and their normals."""
    x, y = np.meshgrid(np.arange(n) * spacing, np.arange(n) * spacing)
    points = np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1)
    return points, np.tile([0.0, 0.0, 1.0], (n * n, 1))


@pytest.mark.parametrize("kernel", KERNELS)
def test_hermite_reproduces_values_and_slopes(kernel):
    mesh = torus(n_major=36, n_minor=14)
    normals = vertex_normals(mesh)
    surface = fit_hermite(mesh.points, normals, tolerance=1e-9, kernel=kernel)
    value, gradient = surface.value_and_gradient(mesh.points)
    assert np.abs(value).max() < 1e-7 * surface.support_radius
    np.testing.assert_allclose(np.einsum("ij,ij->i", gradient, normals), 1.0, atol=1e-6)
    assert surface.residual <= 1e-9
    assert np.abs(value).max() == pytest.approx(surface.report.value_error, rel=0.5)
    assert isinstance(surface, ImplicitSurface)


def test_offsets_reproduce_their_triples():
    mesh = torus(n_major=36, n_minor=14)
    normals = vertex_normals(mesh)
    surface = fit_offsets(mesh.points, normals, tolerance=1e-9)
    for shift in (0.0, surface.offset, -surface.offset):
        values = surface.value(mesh.points + shift * normals)
        np.testing.assert_allclose(values, shift, atol=1e-7 * surface.support_radius)


@pytest.mark.parametrize("fit", FORMS)
def test_distance_to_a_sphere_falls_with_order_two_or_more(fit):
    errors = []
    for subdivisions in (1, 2, 3):
        mesh = icosphere(subdivisions, 2.0, (1.0, -2.0, 0.5))
        surface = fit(mesh.points, vertex_normals(mesh))
        points, _ = surface.project(mesh.points[mesh.faces].mean(axis=1))
        radius = np.linalg.norm(points - [1.0, -2.0, 0.5], axis=1)
        errors.append(np.sqrt(np.mean((radius - 2.0) ** 2)))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders[-1] > 1.8, orders
    assert errors[-1] < 4e-4  # R/5000


@pytest.mark.parametrize("exponent", [-30, 30])
def test_powers_of_two_scale_the_result_bit_by_bit(exponent):
    mesh, scale = icosphere(2), 2.0**exponent
    points = mesh.points * [1.0, 0.7, 0.4]
    normals = vertex_normals(mesh.with_points(points))
    one, other = fit_hermite(points, normals), fit_hermite(points * scale, normals)
    queries = points * 1.02
    value, gradient = one.value_and_gradient(queries)
    scaled_value, scaled_gradient = other.value_and_gradient(queries * scale)
    np.testing.assert_array_equal(scaled_value, value * scale)
    np.testing.assert_array_equal(scaled_gradient, gradient)
    np.testing.assert_array_equal(
        other.project(queries * scale)[0], one.project(queries)[0] * scale
    )


@pytest.mark.parametrize("scale", [1e-9, 1e9])
@pytest.mark.parametrize("fit", FORMS)
def test_tiny_and_huge_surfaces(fit, scale):
    mesh = icosphere(2, scale, (3 * scale, 0, 0))
    surface = fit(mesh.points, vertex_normals(mesh))
    points, normals = surface.project(mesh.points * 1.01)
    offset = points - [3 * scale, 0, 0]
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), scale, rtol=2e-3)
    np.testing.assert_allclose(normals, offset / scale, atol=0.03)


def test_one_and_two_threads_give_the_same_bits():
    mesh = torus()
    normals, queries = vertex_normals(mesh), mesh.points * 1.01
    results = []
    before = numba.get_num_threads()
    try:
        for threads in {1, before}:
            numba.set_num_threads(threads)
            surface = fit_hermite(mesh.points, normals)
            results.append([*surface.value_and_gradient(queries), *surface.project(queries)])
    finally:
        numba.set_num_threads(before)
    for have, want in zip(results[0], results[-1]):
        np.testing.assert_array_equal(have, want)


@pytest.mark.parametrize("distance", [0.0, 1e-12, 1e-7, 1e-3, 1e-2])
@pytest.mark.parametrize("fit", FORMS)
def test_near_duplicates_do_no_harm(fit, distance):
    mesh = icosphere(2)
    rng = np.random.default_rng(0)
    spacing = point_spacing(mesh.points)
    extra = mesh.points[:40] + distance * spacing * rng.uniform(-1, 1, (40, 3))
    points = np.vstack([mesh.points, extra])
    normals = points / np.linalg.norm(points, axis=1)[:, None]
    surface = fit(points, normals)
    if distance <= 1e-7:
        assert surface.report.welded == 40
        assert surface.report.damped == 0
    else:
        assert surface.report.damped > 40
    centroids, _ = surface.project(mesh.points[mesh.faces].mean(axis=1))
    distance = np.abs(np.linalg.norm(centroids, axis=1) - 1.0)
    assert distance.max() < 0.02 * spacing


def test_points_in_a_plane_give_the_plane():
    points, normals = plane_grid()
    surface = fit_hermite(points, normals)
    inside = points[(np.abs(points[:, :2] - 5.5) < 4).all(axis=1)] + [0.5, 0.5, 0.3]
    projected, up = surface.project(inside)
    np.testing.assert_allclose(projected[:, 2], 0.0, atol=1e-5)
    np.testing.assert_allclose(up, np.tile([0, 0, 1.0], (len(up), 1)), atol=1e-5)


def test_one_point():
    with pytest.raises(InvalidCase, match="give support_radius"):
        fit_hermite([[1.0, 2, 3]], [[0, 0, 1.0]])
    with pytest.raises(InvalidCase, match="give support_radius"):
        fit_hermite([[1.0, 2, 3]] * 30, [[0, 0, 1.0]] * 30)
    surface = fit_hermite([[1.0, 2, 3]], [[0, 0, 2.0]], support_radius=1.0)
    value, gradient = surface.value_and_gradient(np.array([[1.0, 2, 3], [1, 2, 3.01]]))
    np.testing.assert_allclose(value, [0.0, 0.01], atol=4e-4)
    np.testing.assert_allclose(gradient[0], [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("gap", [3.0, 1.0, 0.5])
def test_two_sheets_closer_than_the_support_stay_apart(gap):
    points, normals = plane_grid(10)
    below = points - [0, 0, gap]
    surface = fit_hermite(np.vstack([points, below]), np.vstack([normals, -normals]))
    middle = points[(np.abs(points[:, :2] - 4.5) < 3).all(axis=1)] + [0.5, 0.5, 0.0]
    upper, up = surface.project(middle + [0, 0, 0.02])
    lower, down = surface.project(middle - [0, 0, gap + 0.02])
    np.testing.assert_allclose(upper[:, 2], 0.0, atol=0.01)
    np.testing.assert_allclose(lower[:, 2], -gap, atol=0.01)
    assert up[:, 2].min() > 0.99
    assert down[:, 2].max() < -0.99


def test_bad_input_is_named():
    points, normals = plane_grid(4)
    broken = points.copy()
    broken[3, 1] = np.nan
    with pytest.raises(InvalidMesh, match=r"1 rows that are not finite \(the first is row 3\)"):
        fit_hermite(broken, normals)
    with pytest.raises(InvalidMesh, match="normals has 1 rows"):
        fit_hermite(points, broken)
    with pytest.raises(InvalidMesh, match="as many normals"):
        fit_hermite(points, normals[1:])
    with pytest.raises(InvalidMesh, match="normals are zero"):
        fit_hermite(points, np.zeros_like(normals))
    with pytest.raises(InvalidMesh, match="n > 0"):
        fit_hermite(np.empty((0, 3)), np.empty((0, 3)))
    for keyword in ({"support_radius": -1.0}, {"tolerance": 0.0}, {"ridge": -1.0},
                    {"neighbours": 0}, {"kernel": "wendland_c0"}):  # fmt: skip
        with pytest.raises(InvalidCase, match=next(iter(keyword)).split("_")[0]):
            fit_hermite(points, normals, **keyword)
    with pytest.raises(InvalidCase, match="offset"):
        fit_offsets(points, normals, offset=-1.0)


def test_ridge_smooths_noise():
    mesh = icosphere(3)
    rng = np.random.default_rng(0)
    noisy = mesh.points * (1.0 + 0.01 * rng.standard_normal(len(mesh.points)))[:, None]
    deviation = []
    for ridge in (0.0, 0.1):
        surface = fit_hermite(noisy, mesh.points, ridge=ridge)
        projected, _ = surface.project(mesh.points)
        deviation.append(np.std(np.linalg.norm(projected, axis=1)))
    assert deviation[1] < 0.6 * deviation[0]
    assert np.mean(np.linalg.norm(projected, axis=1)) == pytest.approx(1.0, abs=2e-3)


def test_points_without_normals():
    exact = TorusSurface()
    mesh = torus(n_major=60, n_minor=24)
    surface = fit_hermite(mesh.points, pca_normals(mesh.points))
    points, normals = surface.project(mesh.points[mesh.faces].mean(axis=1))
    assert np.abs(exact.value(points)).max() < 2e-3
    assert np.einsum("ij,ij->i", normals, exact.gradient(points)).min() > 0.99


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    st.integers(2, 40),
    st.integers(0, 10**6),
    st.sampled_from([1e-9, 1.0, 1e9]),
    st.sampled_from(["blob", "plane", "line", "clusters"]),
)
def test_any_points_give_an_interpolant(count, seed, scale, kind):
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((count, 3))
    if kind in ("plane", "line"):
        points[:, 2 if kind == "plane" else slice(1, 3)] = 0.0
    if kind == "clusters":
        points = np.round(points) + 1e-6 * points
    normals = rng.standard_normal((count, 3))
    surface = fit_hermite(points * scale, normals, support_radius=2.0 * scale)
    kept = count - surface.report.welded
    assert kept == len(surface.points)
    value, gradient = surface.value_and_gradient(surface.points)
    if surface.report.damped == 0:
        assert np.abs(value).max() < 1e-6 * scale
    slopes = np.einsum("ij,ij->i", gradient, surface.normals)
    np.testing.assert_allclose(slopes, 1.0, atol=1e-5)
