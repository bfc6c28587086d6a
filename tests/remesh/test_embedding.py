"""Lengths and angles in six dimensions."""

import numpy as np
import pytest

from remesh import embedding
from tests.remesh import reference
from tests.shapes import icosphere


@pytest.fixture
def lines():
    rng = np.random.default_rng(1)
    lines = rng.normal(size=(30, 8))
    lines[:, 3:6] /= np.linalg.norm(lines[:, 3:6], axis=1)[:, None]
    return lines


@pytest.mark.parametrize("sigma", [0.0, 0.7])
def test_kernels_agree_with_the_definition(lines, sigma):
    psi = embedding.embed(lines[:, :3], lines[:, 3:6], sigma)
    for a, b, c in np.arange(30).reshape(-1, 3):
        length = embedding.squared_length(lines, a, b, sigma**2)
        assert length == pytest.approx(reference.squared_length(lines[a], lines[b], sigma))
        tangent = embedding.triangle_tangent(lines, a, b, c, sigma**2)
        angle = np.degrees(np.arctan(tangent))
        assert angle == pytest.approx(reference.smallest_angle(psi[a], psi[b], psi[c]), abs=1e-6)
        normal = embedding.agreement(lines, a, b, c)
        assert normal == pytest.approx(reference.agreement(lines[[a, b, c]]), abs=1e-12)


def test_degenerate_triangles_have_angle_zero_and_no_normal():
    lines = np.zeros((3, 8))
    lines[:, 0] = [0.0, 1.0, 3.0]
    lines[:, 5] = 1.0
    assert embedding.triangle_tangent(lines, 0, 1, 2, 0.0) == pytest.approx(0.0, abs=1e-6)
    assert embedding.agreement(lines, 0, 1, 2) <= 0.0


def test_area_and_angles_of_many_triangles_at_once(lines):
    corners = lines[:, :6].reshape(10, 3, 6)
    angles = [reference.smallest_angle(*c) for c in corners]
    np.testing.assert_allclose(embedding.smallest_angles(corners), angles, atol=1e-6)
    flat = corners[:, :, :3]
    area = np.linalg.norm(np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]), axis=1) / 2
    assert embedding.embedded_area(flat) == pytest.approx(area.sum())


def test_length_on_a_sphere_is_stretched_by_sigma_over_radius():
    radius, sigma = 2.0, 1.3
    sphere = icosphere(2, radius=radius)
    normals = sphere.points / radius
    corners = embedding.face_corner_embedding(
        sphere.points, sphere.faces, normals[sphere.faces], sigma
    )
    flat = embedding.corner_edge_lengths(sphere.points[sphere.faces])
    expected = flat * np.sqrt(1.0 + (sigma / radius) ** 2)
    np.testing.assert_allclose(embedding.corner_edge_lengths(corners), expected, rtol=1e-12)


def test_quick_arc_tangent():
    tangents = np.linspace(0.0, np.sqrt(3.0), 200)
    for factor in (1e-20, 1.0, 1e18):
        found = [embedding.degrees_of(factor * t, factor) for t in tangents]
        np.testing.assert_allclose(found, np.degrees(np.arctan(tangents)), atol=7e-5)
