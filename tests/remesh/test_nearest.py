"""Closest points on the carrier, and points on feature curves."""

import numpy as np
import pytest

from remesh.carrier import make_carrier
from remesh.curves import curve_length, curve_point
from remesh.nearest import walk
from remesh.triangle_surface import TriangleSurface
from tests.remesh import reference
from tests.remesh.shapes import cut_sphere, cylinder, hemisphere, jittered
from tests.shapes import icosphere


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_closest_points_are_the_closest_of_all_triangles(scale):
    mesh = jittered(icosphere(1, radius=scale), 0.3, 0)
    carrier = make_carrier(mesh)
    mesh = carrier.mesh
    rng = np.random.default_rng(2)
    points = scale * rng.normal(size=(25, 3))
    hints = rng.integers(0, len(mesh.faces), 25)
    faces, where = carrier.locate(points, hints)
    for point, face, (v, w, square) in zip(points, faces, where):
        a, b, c = mesh.points[mesh.faces[face]]
        foot = a + v * (b - a) + w * (c - a)
        distance = reference.closest_distance(point, mesh)
        assert np.linalg.norm(foot - point) == pytest.approx(distance, rel=1e-9)
        assert np.sqrt(square) == pytest.approx(distance, rel=1e-9)


def test_closest_points_stay_in_the_patch_of_the_hint():
    carrier = make_carrier(cylinder(around=12, rings=4))
    mesh = carrier.mesh
    points = np.random.default_rng(3).normal(size=(8, 3))
    for label in range(len(mesh.labels)):
        hint = np.flatnonzero(mesh.face_labels == label)[0]
        faces, where = carrier.locate(points, np.full(8, hint))
        assert (mesh.face_labels[faces] == label).all()
        for point, square in zip(points, where[:, 2]):
            expected = reference.closest_distance(point, mesh, label)
            assert np.sqrt(square) == pytest.approx(expected, rel=1e-9)


def test_triangle_surface_is_a_signed_distance():
    surface = TriangleSurface(icosphere(3))
    points = np.random.default_rng(4).normal(size=(50, 3))
    radius = np.linalg.norm(points, axis=1)
    value, gradient = surface.value_and_gradient(points)
    np.testing.assert_allclose(value, radius - 1.0, atol=0.01)
    cosine = np.einsum("ij,ij->i", gradient, points) / radius
    assert cosine.min() > 0.995
    foot, normals = surface.project(points)
    np.testing.assert_allclose(np.linalg.norm(foot, axis=1), 1.0, atol=0.01)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


@pytest.mark.parametrize("make", [cylinder, hemisphere, cut_sphere])
def test_curves_cover_all_feature_edges_and_are_walked_by_arc_length(make):
    carrier = make_carrier(make())
    curves = carrier.curves
    assert sum(len(path) - 1 for path in curves.vertices) == len(carrier.mesh.feature_edges)
    out = np.empty(9)
    for i, path in enumerate(curves.vertices):
        points = carrier.mesh.points[path]
        total = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        assert curve_length(curves.arrays, i) == pytest.approx(total)
        for s in np.linspace(0.0, total, 7):
            curve_point(curves.arrays, i, s, out)
            np.testing.assert_allclose(out[:3], reference.point_on_polyline(points, s), atol=1e-12)
            np.testing.assert_allclose(np.linalg.norm(out[3:].reshape(2, 3), axis=1), 1.0)
        if curves.arrays[3][i]:
            first = out.copy()
            curve_point(curves.arrays, i, 0.3 * total, first)
            curve_point(curves.arrays, i, -0.7 * total, out)
            np.testing.assert_allclose(first, out, atol=1e-12)


def test_normals_beside_a_rim_are_those_of_cap_and_side():
    carrier = make_carrier(cut_sphere(level=0.4))
    mesh, curves = carrier.mesh, carrier.curves
    (path,) = curves.vertices
    nodes = curves.arrays[1]
    sides = np.stack([nodes[:, 4:7], nodes[:, 7:10]])
    cap = sides[..., 2].argmax(axis=0)
    assert (cap == cap[0]).all()
    np.testing.assert_allclose(sides[cap[0]], np.tile([0.0, 0.0, 1.0], (len(path), 1)))
    rim = mesh.points[path]
    assert np.einsum("ij,ij->i", sides[1 - cap[0]], rim).min() > 0.99


def test_walks_reach_the_nearest_point_of_a_smooth_surface():
    carrier = make_carrier(icosphere(3))
    mesh = carrier.mesh
    rng = np.random.default_rng(6)
    hints = rng.integers(0, len(mesh.faces), 40)
    middles = mesh.points[mesh.faces[hints]].mean(axis=1)
    points = middles + 0.2 * rng.normal(size=(40, 3)) * (1.0 - np.abs(middles))
    points *= 1.02 / np.linalg.norm(points, axis=1)[:, None]
    far = 0
    for point, hint in zip(points, hints):
        face, v, w, square = walk(carrier.reference, *point, hint)
        a, b, c = mesh.points[mesh.faces[face]]
        foot = a + v * (b - a) + w * (c - a)
        assert np.sqrt(square) == pytest.approx(np.linalg.norm(point - foot), rel=1e-9)
        assert np.sqrt(square) == pytest.approx(reference.closest_distance(point, mesh), rel=1e-6)
        far += face != hint
    assert far > 20
