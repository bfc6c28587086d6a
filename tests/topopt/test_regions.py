"""Slabs, spheres, cylinders and surfaces as regions: areas, moments, and which side is inside."""

from dataclasses import replace

import numpy as np
import pytest

from meshes import TriMesh
from meshes.structured import bcc_box
from tests import shapes
from topopt.problem import Box, Cylinder, Slab, Sphere, SurfaceRegion
from topopt.regions import (
    clip_triangles,
    contains,
    grown,
    half_spaces,
    in_words,
    signed_distance,
    tolerance_of,
)
from topopt.traction import facet_areas, facet_mass, traction_forces

MESH = bcc_box((0, 0, 0), (5.0, 1.5, 2.0), (7, 3, 4))
RADIUS = 0.47
CENTRE = np.array([2.13, 0.71, 2.0])


def force_on(region, scale=1.0):
    points = MESH.points * scale
    facets = MESH.facets[MESH.points[MESH.facets][:, :, 2].min(axis=1) == 2.0]  # the top
    forces, area = traction_forces(points, facets, region, (0, 0, -1.0), tolerance_of(points))
    return points, forces, area


@pytest.mark.parametrize("scale", [1.0, 1e-9, 2.0**40])
@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_a_disc_has_its_area_and_its_centre_on_any_mesh(kind, scale):
    centre = CENTRE * scale
    region = Sphere(tuple(centre), RADIUS * scale)
    if kind == "cylinder":
        ends = (centre + [0, 0, dz * scale] for dz in (-0.3, 0.2))
        region = Cylinder(*map(tuple, ends), RADIUS * scale)
    points, forces, area = force_on(region, scale)
    wanted = np.pi * (RADIUS * scale) ** 2
    assert area == pytest.approx(wanted, rel=2e-4)
    assert -forces[:, 2].sum() == pytest.approx(area, rel=1e-12)
    middle = (forces[:, 2] @ points) / forces[:, 2].sum()
    np.testing.assert_allclose(middle, centre, atol=1e-4 * RADIUS * scale)


def test_a_tiny_sphere_on_a_huge_triangle_is_found():
    corners = np.array([[[0.0, 0, 0], [50, 0, 0], [0, 50, 0]]])
    pieces = clip_triangles(corners, Sphere((11.3, 17.9, 0.0), 0.01), 1e-5)
    assert pieces.share.sum() * 1250.0 == pytest.approx(np.pi * 1e-4, rel=2e-4)


def test_pieces_cover_the_intersection_once_and_lie_in_the_region():
    corners = np.random.default_rng(3).uniform(-1.0, 1.0, (60, 3, 3))
    for region in (Sphere((0.1, 0, 0), 0.6), Cylinder((-0.5, 0, 0), (0.5, 0.2, 0), 0.4)):
        pieces = clip_triangles(corners, region, 0.0)
        placed = (pieces.barycentric @ corners[pieces.parent]).reshape(-1, 3)
        assert signed_distance(region, placed).max() < 1e-3
        share = np.bincount(pieces.parent, pieces.share, minlength=len(corners))
        rng = np.random.default_rng(4)  # against points thrown at the triangles
        weights = rng.dirichlet((1.0, 1.0, 1.0), (len(corners), 4000))
        thrown = np.einsum("nsk,nki->nsi", weights, corners)
        inside = contains(region, thrown.reshape(-1, 3), 0.0).reshape(len(corners), -1)
        np.testing.assert_allclose(share, inside.mean(axis=1), atol=0.04)
        assert share.max() > 0.05 and (share == 0.0).any()


def test_a_surface_region_is_the_polyhedron():
    """A tilted cube given as a surface against the same cube by half-spaces."""
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    box = shapes.cube(1.2)
    low = np.array([1.4, 0.2, 1.3])
    middle = box.points.mean(axis=0)
    points = (box.points - middle) @ turn.T + middle + low
    region = SurfaceRegion(TriMesh(points, box.faces))

    def exact(x):
        return (np.abs((x - middle - low) @ turn) - 0.6).max(axis=1)

    x = np.random.default_rng(6).uniform(0.5, 3.5, (4000, 3))
    found = signed_distance(region, x)
    np.testing.assert_array_equal(found < 0.0, exact(x) < 0.0)
    inside = exact(x) < 0.0
    assert inside.sum() > 50
    np.testing.assert_allclose(found[inside], exact(x)[inside], atol=1e-12)
    corners_and_edges = np.concatenate(
        [points, (points[box.faces[:, 0]] + points[box.faces[:, 1]]) / 2]
    )
    outward = corners_and_edges - (middle + low)
    assert np.all(signed_distance(region, corners_and_edges + 0.01 * outward) > 0.0)
    assert np.all(signed_distance(region, corners_and_edges - 0.01 * outward) < 0.0)

    _, _, area = force_on(region)
    pieces = MESH.points[MESH.facets[MESH.points[MESH.facets][:, :, 2].min(axis=1) == 2.0]]
    weights = np.random.default_rng(7).dirichlet((1.0, 1.0, 1.0), (len(pieces), 3000))
    thrown = np.einsum("nsk,nki->nsi", weights, pieces).reshape(-1, 3)
    share = (exact(thrown).reshape(len(pieces), -1) < 0.0).mean(axis=1)
    flat = np.arange(3 * len(pieces)).reshape(-1, 3)
    wanted = share @ facet_areas(pieces.reshape(-1, 3), flat)
    assert area == pytest.approx(wanted, rel=0.02)


def test_a_surface_that_is_not_convex_leaves_its_hollow_out():
    region = SurfaceRegion(shapes.torus(1.0, 0.3))
    x = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.2, 0, 0], [0, -1.0, 0.1], [0, 0, 0.1], [1.5, 0, 0]])
    np.testing.assert_array_equal(contains(region, x, 0.0), [False, True, True, True, False, False])


def test_the_side_is_told_beyond_sharp_edges_and_corners_too():
    """A flat tetrahedron: beyond its edges points lie behind one of the two faces."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.4, 0.3, 0.1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    x = np.random.default_rng(8).uniform([-0.5, -0.5, -0.3], [1.5, 1.5, 0.4], (20000, 3))
    barycentric = np.linalg.solve(
        np.vstack([points.T, np.ones(4)]), np.vstack([x.T, np.ones(20000)])
    )
    inside = (barycentric > 0.0).all(axis=0)
    assert inside.sum() > 50
    region = SurfaceRegion(TriMesh(points, faces))
    np.testing.assert_array_equal(contains(region, x, 0.0), inside)


def test_a_slab_of_any_direction():
    normal = (1.0, 2.0, -0.5)
    flat = np.array([[[0.0, 0, 0], [2, -1, 0], [1, 0, 2]]])  # in the plane through the origin
    plane = Slab((0, 0, 0), normal)
    assert len(half_spaces(plane)) == 2
    assert clip_triangles(flat, plane, 1e-9).share == pytest.approx([1.0])
    assert len(clip_triangles(flat + [0, 0, 1e-3], plane, 1e-9).parent) == 0
    thick = replace(plane, thickness=0.1)
    assert clip_triangles(flat + [0, 0.02, 0], thick, 1e-9).share == pytest.approx([1.0])
    box = Box((0.0, -np.inf, -np.inf), (0.3, np.inf, np.inf))
    same = Slab((0.15, 7.0, 7.0), (-3.0, 0.0, 0.0), 0.3)
    for a, b in zip(
        facet_mass(MESH.points, MESH.facets, box, 1e-9),
        facet_mass(MESH.points, MESH.facets, same, 1e-9),
    ):
        np.testing.assert_allclose(a, b, atol=1e-14)


@pytest.mark.parametrize(
    "region",
    [
        Box((0, 0, 0), (1, 1, 1)),
        Slab((0, 0, 0), (0, 0, 2.0), 0.5),
        Sphere((0, 0, 0), 1.0),
        Cylinder((0, 0, 0), (0, 0, 2.0), 1.0),
        SurfaceRegion(shapes.cube(1.0), name="part.stl"),
    ],
)
def test_grown_regions_have_moved_borders(region):
    x = np.array([[0.1, 0.2, z] for z in np.linspace(-3, 3, 601)])
    before, after = (contains(r, x, 1e-9) for r in (region, grown(region, 0.1)))
    assert 19 <= after.sum() - before.sum() <= 21
    assert np.all(after[before])
    assert "\n" not in in_words(region) and len(in_words(region)) > 10
