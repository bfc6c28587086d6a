"""Bounds of distances and normals: closed forms, and never below what dense samples find."""

import numpy as np
import pytest

from meshes import TriMesh
from meshes.closest_point import ClosestPoint, sample_surface
from meshes.distance_bound import distance_bounds, face_bounds
from tests.shapes import cube, icosphere, torus


def sheet(height=0.0, tilt=0.0, turned=False):
    """The unit square of two triangles, cut along either diagonal."""
    points = np.array([(0, 0, height), (1, 0, height), (1, 1, height + tilt), (0, 1, height)])
    faces = [(0, 1, 3), (1, 2, 3)] if turned else [(0, 1, 2), (0, 2, 3)]
    return TriMesh(points.astype(float), np.array(faces))


def test_parallel_sheets():
    of_a, of_b = distance_bounds(sheet(), sheet(height=0.25))
    for bounds in (of_a, of_b):
        np.testing.assert_allclose(bounds.upper, 0.25)
        np.testing.assert_allclose(bounds.lower, 0.25)
        np.testing.assert_allclose(bounds.angle, 0.0, atol=1e-6)


def test_the_other_diagonal_is_as_far_as_the_middle():
    """All vertices are common, so that samples at vertices see nothing at all."""
    tilt = 0.5
    of_a, _ = distance_bounds(sheet(tilt=tilt), sheet(tilt=tilt, turned=True))
    # On the first one's diagonal (s, s, tilt s) the distances from the second one's two planes,
    # tilt s and tilt (1 - s) / |(-tilt, -tilt, 1)|, are the same at the worst point.
    expected = tilt / (1.0 + np.sqrt(1.0 + 2.0 * tilt**2))
    assert of_a.upper.max() == pytest.approx(expected, rel=0.011)
    assert of_a.upper.max() >= expected * (1 - 1e-12)
    assert of_a.lower.max() <= expected * (1 + 1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_bounds_hold_for_dense_samples_and_are_sharp(scale):
    rng = np.random.default_rng(0)
    a = icosphere(2, radius=scale)
    b = icosphere(3, radius=scale)
    b = b.with_points(b.points * rng.uniform(0.97, 1.03, (len(b.points), 1)))
    both = distance_bounds(a, b)
    upper, lower = max(bounds.upper.max() for bounds in both), 0.0
    for here, there, bounds in zip((a, b), (b, a), both, strict=True):
        search = ClosestPoint(there.points, there.faces)
        points, faces = sample_surface(here.points, here.faces, 20000, rng)
        distance = search.query(points)[2]
        assert (distance <= bounds.upper[faces] * (1 + 1e-12)).all()
        assert (bounds.lower <= bounds.upper * (1 + 1e-12)).all()
        at_place = search.query(bounds.place)[2]
        sharp = bounds.lower > 0.98 * upper  # below, places are where normals differ most
        np.testing.assert_allclose(at_place[sharp], bounds.lower[sharp], rtol=1e-9)
        lower = max(lower, distance.max(), at_place.max())
    assert upper <= 1.02 * lower


def test_a_large_sphere_around_a_small_one():
    of_a, of_b = distance_bounds(icosphere(4, radius=1.0), icosphere(4, radius=1.5))
    assert of_a.upper.max() == pytest.approx(0.5, rel=0.01)
    assert of_b.upper.max() == pytest.approx(0.5, rel=0.01)


def test_normals_are_found_within_the_limit():
    """Of a cube from itself, of a ring from a finer one, of a sheet from a face that looks down."""
    box = cube()
    search = ClosestPoint(box.points, box.faces)
    bounds = face_bounds(box, search, limit=0.01, floor=0.01, angle=1.0)
    assert bounds.angle.max() < 1.0
    ring = torus(n_major=24, n_minor=12)
    finer = torus(n_major=48, n_minor=24)
    search = ClosestPoint(finer.points, finer.faces)
    bounds = face_bounds(ring, search, limit=0.05, floor=0.05, angle=10.0)
    assert 1.0 < bounds.angle.max() < 25.0
    flat = face_bounds(sheet(), ClosestPoint(box.points, box.faces), limit=0.1, floor=0.1)
    assert flat.angle.max() == pytest.approx(180.0)  # the cube's bottom looks down
