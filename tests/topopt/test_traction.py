"""Clipping against the slow twin, and tractions whose force and moments are exact."""

from itertools import pairwise

import numpy as np
import pytest

from meshes.structured import bcc_box
from tests.topopt.reference_clip import clip_polygon, polygon_area
from topopt.problem import Box
from topopt.regions import clip_triangles, contains, half_spaces, tolerance_of
from topopt.traction import facet_areas, traction_forces

INF = np.inf


def random_triangles(count=400, seed=3):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3, 3))


@pytest.mark.parametrize(
    "region",
    [
        Box((-0.4, -0.3, -0.5), (0.3, 0.5, 0.2)),
        Box((-INF, -0.3, -INF), (INF, INF, 0.2)),
        Box((-INF,) * 3, (INF,) * 3),
        Box((0.1, 0.1, 0.1), (0.10001, 0.9, 0.9)),
    ],
)
def test_clipped_areas_are_those_of_the_twin(region):
    corners = random_triangles()
    points, facets = corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3)
    pieces = clip_triangles(corners, region, 0.0)
    area = facet_areas(points, facets)
    found = np.bincount(pieces.parent, pieces.share * area[pieces.parent], minlength=len(corners))
    wanted = [polygon_area(clip_polygon(list(triangle), region)) for triangle in corners]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14)
    assert np.count_nonzero(found) > 5


def test_pieces_lie_in_the_region_and_in_their_parents():
    corners, region = random_triangles(), Box((-0.4, -0.3, -0.5), (0.3, 0.5, 0.2))
    pieces = clip_triangles(corners, region, 0.0)
    assert pieces.barycentric.min() >= -1e-15
    np.testing.assert_allclose(pieces.barycentric.sum(axis=2), 1.0, atol=1e-14)
    placed = pieces.barycentric @ corners[pieces.parent]
    assert contains(region, placed.reshape(-1, 3), 1e-13).all()
    assert np.all(np.diff(pieces.parent) >= 0)


def test_triangles_in_the_plane_of_a_face_are_inside_and_neighbours_outside_are_not():
    flat = np.array([[[0.0, 0, 1], [1, 0, 1], [0, 1, 1]]])
    above = np.array([[[0.0, 0, 1], [1, 0, 1], [0, 1, 2]]])
    for shift in (0.0, 3e-10, -3e-10):
        region = Box((-1, -1, 1 + shift), (2, 2, 1 + shift))
        assert clip_triangles(flat, region, 1e-9).share == pytest.approx([1.0], abs=1e-15)
        assert len(clip_triangles(above, region, 1e-9).parent) == 0
    far = Box((-1, -1, 1 + 3e-9), (2, 2, 1 + 3e-9))
    assert len(clip_triangles(flat, far, 1e-9).parent) == 0


def test_faces_at_infinity_are_no_half_spaces():
    assert len(half_spaces(Box((-INF, 0, -INF), (INF, INF, 3)))) == 2
    with pytest.raises(TypeError, match="no such region"):
        half_spaces("deck")


@pytest.mark.parametrize("scale", [1.0, 0.001, 2.0**40])
def test_force_and_moments_are_exact_where_the_mesh_does_not_follow_the_patch(scale):
    lower, upper = np.zeros(3), scale * np.array([5.0, 1.5, 2.0])
    mesh = bcc_box(lower, upper, (7, 3, 4))
    (x0, x1), (y0, y1) = scale * np.array([[0.31, 1.77], [0.22, 1.03]])
    region = Box((x0, y0, upper[2]), (x1, y1, upper[2]))
    q = np.array([30.0, -20.0, -2400.0])
    forces, area = traction_forces(mesh.points, mesh.facets, region, q, tolerance_of(mesh.points))
    wanted = q * (x1 - x0) * (y1 - y0)
    np.testing.assert_allclose(forces.sum(axis=0), wanted, rtol=1e-13)
    assert area == pytest.approx((x1 - x0) * (y1 - y0), rel=1e-13)
    centre = np.array([(x0 + x1) / 2, (y0 + y1) / 2, upper[2]])
    moment = np.cross(mesh.points, forces).sum(axis=0)
    np.testing.assert_allclose(
        moment, np.cross(centre, wanted), rtol=0, atol=1e-13 * np.linalg.norm(wanted) * upper[0]
    )


def test_forces_are_zero_away_from_the_patch():
    mesh = bcc_box((0, 0, 0), (5, 1.5, 2), (10, 3, 4))
    region = Box((0.0, 0.0, 2.0), (1.0, 1.0, 2.0))
    forces, _ = traction_forces(mesh.points, mesh.facets, region, (0, 0, -1), 1e-9)
    loaded = np.flatnonzero(forces[:, 2])
    assert len(loaded) and np.all(mesh.points[loaded, 2] == 2.0)
    assert np.all(mesh.points[loaded, :2] <= 1.5)
    assert np.all(forces[:, 2] <= 0) and not forces[:, :2].any()


def test_a_linear_traction_potential_is_integrated_exactly():
    """sum f_i u(x_i) is the work of the traction on any linear displacement."""
    mesh = bcc_box((0, 0, 0), (5, 1.5, 2), (6, 2, 3))
    region = Box((0.4, -INF, 0.7), (INF, INF, 1.9))  # two end strips and the far end
    corners = mesh.points[mesh.facets]
    forces, _ = traction_forces(mesh.points, mesh.facets, region, (1.0, 0.0, 0.0), 1e-9)
    work = 0.0
    for triangle in corners:
        polygon = clip_polygon(list(triangle), region)
        for b, c in pairwise(polygon[1:]):
            centroid = (polygon[0] + b + c) / 3.0
            work += polygon_area([polygon[0], b, c]) * (2.0 + centroid @ [0.3, -0.5, 0.7])
    found = forces[:, 0] @ (2.0 + mesh.points @ [0.3, -0.5, 0.7])
    assert found == pytest.approx(work, rel=1e-13)
