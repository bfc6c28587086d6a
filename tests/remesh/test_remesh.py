"""Whole surfaces: valid, fine as asked, true to features, planes, scale and rotation."""

import numpy as np
import pytest

from meshes import InvalidCase, InvalidMesh, PlaneSurface, TriMesh
from meshes.features import find_features
from meshes.quality import corner_normals, signed_volume
from meshes.self_intersection import self_intersecting_faces
from meshes.topology import feature_corners, topology
from rbf import fit_surface
from remesh import RemeshSettings, TriangleSurface, remesh
from remesh.embedding import corner_edge_lengths, face_corner_embedding, smallest_angles
from remesh.recipe import choose_recipe
from tests.remesh.shapes import cut_sphere, cylinder, hemisphere, jittered, revolved, rotation
from tests.shapes import SphereSurface, TorusSurface, cube, icosphere, torus


def check(mesh, genus=0, loops=0, worst=10.0, mean=45.0):
    """Manifold, without self-intersections, well shaped; returns the smallest angles."""
    found = topology(mesh.faces, len(mesh.points))
    assert found.manifold and found.oriented
    assert (found.genus, found.boundary_loops, found.components) == (genus, loops, 1)
    assert found.vertices == len(mesh.points)
    assert not self_intersecting_faces(mesh.points, mesh.faces).any()
    angles = smallest_angles(mesh.points[mesh.faces])
    assert angles.min() >= worst
    assert angles.mean() >= mean
    return angles


def outward_cosine(mesh, surface):
    """Least cosine of faces' normals to the surface's normals at their corners."""
    corners = mesh.points[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    gradient = surface.gradient(mesh.points)
    gradient /= np.linalg.norm(gradient, axis=1)[:, None]
    return np.einsum("md,mkd->mk", normal, gradient[mesh.faces]).min()


@pytest.mark.parametrize("algorithm", ["pliant", "thesis"])
@pytest.mark.parametrize("sigma", [0.0, 0.6])
def test_sphere(sigma, algorithm):
    surface = SphereSurface()
    settings = RemeshSettings(edge_length=0.25, sigma=sigma, algorithm=algorithm)
    result = remesh(icosphere(3), surface, settings)
    mesh = result.mesh
    check(mesh, worst=25.0)
    assert outward_cosine(mesh, surface) > 0.9
    assert np.abs(surface.value(mesh.points)).max() < 0.02
    flat = corner_edge_lengths(mesh.points[mesh.faces])
    normals = surface.gradient(mesh.points)[mesh.faces]
    full = corner_edge_lengths(face_corner_embedding(mesh.points, mesh.faces, normals, sigma))
    np.testing.assert_allclose(full, flat * np.sqrt(1.0 + sigma**2), rtol=0.05)
    assert full.mean() == pytest.approx(0.25, rel=0.1 if algorithm == "pliant" else 0.2)
    assert np.mean((full > 0.125) & (full < 0.375)) > 0.99
    assert result.statistics.inverted_faces == result.statistics.self_intersecting_faces == 0


@pytest.mark.parametrize("algorithm", ["pliant", "thesis"])
def test_torus(algorithm):
    surface = TorusSurface()
    settings = RemeshSettings(edge_length=0.16, sigma=0.2, algorithm=algorithm)
    mesh = remesh(torus(), surface, settings).mesh
    check(mesh, genus=1, worst=15.0, mean=40.0)
    assert outward_cosine(mesh, surface) > 0.8
    assert np.abs(surface.value(mesh.points)).max() < 0.01


def test_vertex_count_and_volume_are_met():
    mesh = jittered(icosphere(3), 0.1, 0)
    for vertices in (60, 500, 1500):
        result = remesh(mesh, settings=RemeshSettings(vertices=vertices))
        assert abs(len(result.mesh.points) - vertices) <= 0.02 * vertices
        assert signed_volume(result.mesh) == pytest.approx(signed_volume(mesh), rel=1e-3)
        check(result.mesh, worst=20.0, mean=48.0)


@pytest.mark.parametrize("sigma", [0.0, 0.3])
def test_the_count_is_met_where_most_vertices_are_on_curves(sigma):
    """Rims of 96 edges each, that as few vertices cannot follow to 3 % of an edge."""
    disc = cylinder(height=0.3, around=96, rings=3)
    for vertices in (40, 60, 200):
        result = remesh(disc, settings=RemeshSettings(vertices=vertices, sigma=sigma))
        assert abs(len(result.mesh.points) - vertices) <= max(0.02 * vertices, 1.0)
        assert result.statistics.inverted_faces == 0
        assert topology(result.mesh.faces, len(result.mesh.points)).watertight


def test_sigma_makes_triangles_follow_curvature():
    surface = TorusSurface()
    angles = []
    for sigma in (0.0, 0.5):
        settings = RemeshSettings(vertices=800, sigma=sigma)
        mesh = remesh(torus(), surface, settings).mesh
        normals = surface.gradient(mesh.points)[mesh.faces]
        corners = face_corner_embedding(mesh.points, mesh.faces, normals, 0.5)
        angles.append(smallest_angles(corners).mean())
    assert angles[1] > angles[0] + 3.0


def test_edges_on_a_torus_are_as_long_as_its_curvatures_say():
    """l3 = l6 / sqrt(1 + sigma^2 kappa^2) along both principal directions."""
    surface, sigma = TorusSurface(major=1.0, minor=0.3), 0.3
    settings = RemeshSettings(vertices=1500, sigma=sigma)
    mesh = remesh(torus(), surface, settings).mesh
    ends = np.unique(np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    a, b = mesh.points[ends[:, 0]], mesh.points[ends[:, 1]]
    middle, step = 0.5 * (a + b), b - a
    length = np.linalg.norm(step, axis=1)
    turn = surface.gradient(a) - surface.gradient(b)
    length6 = np.sqrt(length**2 + sigma**2 * (turn**2).sum(axis=1)).mean()
    ring = np.hypot(middle[:, 0], middle[:, 1])
    around = np.stack([-middle[:, 1], middle[:, 0], np.zeros(len(middle))], axis=1) / ring[:, None]
    cosine = np.abs(np.einsum("ij,ij->i", step, around)) / length
    outward = (ring - surface.major) / surface.minor
    for chosen, curvature in (
        (cosine < 0.25, np.full(len(ring), 1.0 / surface.minor)),
        (cosine > 0.97, outward / ring),
    ):
        expected = length6 / np.sqrt(1.0 + (sigma * curvature[chosen]) ** 2)
        assert chosen.sum() > 100
        assert (length[chosen] / expected).mean() == pytest.approx(1.0, abs=0.15)


def test_lengths_on_a_fitted_sphere_follow_its_curvature():
    """6D lengths by the normals of a fitted interpolant: l3 sqrt(1 + sigma^2 / R^2)."""
    radius, sigma = 2.0, 0.8
    sphere = icosphere(3, radius=radius)
    surface = fit_surface(sphere)
    mesh = remesh(sphere, surface, RemeshSettings(vertices=400, sigma=sigma)).mesh
    check(mesh, worst=25.0)
    normals = surface.gradient(mesh.points)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    flat = corner_edge_lengths(mesh.points[mesh.faces])
    corners = face_corner_embedding(mesh.points, mesh.faces, normals[mesh.faces], sigma)
    expected = flat * np.sqrt(1.0 + (sigma / radius) ** 2)
    np.testing.assert_allclose(corner_edge_lengths(corners), expected, rtol=0.05)


def test_the_last_passes_improve_the_worst_angles_of_the_space_asked_for():
    source, sigma = jittered(torus(), 0.1, 7), 0.4
    worst = {}
    for quality in (None, "3d", "6d"):
        result = remesh(source, settings=RemeshSettings(vertices=600, sigma=sigma, quality=quality))
        mesh = result.mesh
        check(mesh, genus=1, worst=15.0, mean=40.0)
        assert result.statistics.inverted_faces == 0
        assert len(mesh.points) == pytest.approx(600, rel=0.02)
        corners = face_corner_embedding(mesh.points, mesh.faces, corner_normals(mesh), sigma)
        flat = corners[:, :, :3]
        worst[quality] = smallest_angles(flat).min(), smallest_angles(corners).min()
    assert worst["3d"][0] > worst[None][0] + 10.0
    assert worst["6d"][1] > worst[None][1] + 2.0


def test_cube_keeps_edges_corners_and_planes():
    mesh = find_features(cube())
    result = remesh(mesh, settings=RemeshSettings(vertices=500)).mesh
    check(result, worst=25.0)
    assert len(result.points) == pytest.approx(500, rel=0.02)
    corners = result.points[feature_corners(result)]
    assert {tuple(p) for p in corners} == {tuple(p) for p in mesh.points}
    for label, patch in enumerate(result.labels):
        points = result.points[np.unique(result.faces[result.face_labels == label])]
        assert np.abs(patch.plane.signed_distance(points)).max() == 0.0
    ends = result.points[result.feature_edges]
    flat = np.isclose(ends, 0.0, atol=0.0) | np.isclose(ends, 1.0, atol=0.0)
    assert (flat.all(axis=1).sum(axis=1) >= 2).all()
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum() == pytest.approx(12.0)
    assert signed_volume(result) == pytest.approx(1.0, abs=1e-12)


def test_cylinder_keeps_caps_and_rims():
    mesh = cylinder()
    result = remesh(mesh, settings=RemeshSettings(vertices=600, sigma=0.3)).mesh
    check(result, worst=15.0, mean=42.0)
    assert len(result.labels) == 3
    for label, patch in enumerate(result.labels):
        points = result.points[np.unique(result.faces[result.face_labels == label])]
        if patch.plane is None:
            assert np.abs(np.hypot(points[:, 0], points[:, 1]) - 1.0).max() < 0.01
        else:
            assert np.abs(patch.plane.signed_distance(points)).max() == 0.0
    rim = np.linalg.norm(np.diff(result.points[result.feature_edges], axis=1), axis=2).sum()
    assert rim == pytest.approx(4 * np.pi, rel=0.02)


def test_cut_sphere_keeps_cap_and_rim():
    mesh = cut_sphere(level=0.4)
    surfaces = [SphereSurface(), PlaneSurface(mesh.labels[1].plane)]
    result = remesh(mesh, surfaces, RemeshSettings(vertices=600)).mesh
    check(result, worst=20.0)
    cap = np.unique(result.faces[result.face_labels == 1])
    assert (result.points[cap, 2] == 0.4).all()
    rim = np.unique(result.feature_edges)
    radius = np.hypot(result.points[rim, 0], result.points[rim, 1])
    np.testing.assert_allclose(radius, np.sqrt(1 - 0.16), atol=0.004)
    ball = np.setdiff1d(np.unique(result.faces[result.face_labels == 0]), rim)
    np.testing.assert_allclose(np.linalg.norm(result.points[ball], axis=1), 1.0, atol=0.01)


def test_open_boundary_stays_where_it_is():
    mesh = hemisphere(4)
    result = remesh(mesh, settings=RemeshSettings(vertices=400)).mesh
    check(result, loops=1, worst=15.0)
    before = TriangleSurface(mesh).carrier.mesh
    rim, edges = result.points[np.unique(result.feature_edges)], before.feature_edges
    a, b = before.points[edges[:, 0]], before.points[edges[:, 1]]
    for point in rim:
        s = np.clip(np.einsum("ij,ij->i", point - a, b - a) / ((b - a) ** 2).sum(axis=1), 0, 1)
        assert np.linalg.norm(a + s[:, None] * (b - a) - point, axis=1).min() < 1e-12


def test_fixed_boundary_is_kept_bit_by_bit():
    mesh = hemisphere(3)
    settings = RemeshSettings(vertices=600, fix_boundary=True)
    result = remesh(mesh, settings=settings).mesh
    check(result, loops=1, worst=8.0, mean=42.0)
    before = TriangleSurface(mesh).carrier.mesh
    kept = {frozenset(map(tuple, before.points[edge])) for edge in before.feature_edges}
    found = {frozenset(map(tuple, result.points[edge])) for edge in result.feature_edges}
    assert kept == found


def test_tips_are_not_cut_off():
    """A cone's tip is finer than the triangles asked for, and stays."""
    height = 3.0
    z = np.linspace(0.0, 1.0, 30)[1:-1]
    mesh = find_features(revolved([(0, 0), (1, 0), *((1 - s, height * s) for s in z), (0, height)]))
    result = remesh(mesh, settings=RemeshSettings(vertices=200)).mesh
    check(result, worst=10.0, mean=42.0)
    assert result.points[:, 2].max() == height


def test_powers_of_two_change_nothing_but_the_scale():
    mesh = jittered(torus(n_major=24, n_minor=12), 0.1, 1)
    first = remesh(mesh, settings=RemeshSettings(vertices=250, sigma=0.1)).mesh
    for power in (-30, 20):
        scale = 2.0**power
        scaled = mesh.with_points(scale * mesh.points)
        settings = RemeshSettings(vertices=250, sigma=scale * 0.1)
        other = remesh(scaled, settings=settings).mesh
        np.testing.assert_array_equal(first.faces, other.faces)
        np.testing.assert_array_equal(scale * first.points, other.points)


def test_scale_and_rotation_change_little():
    mesh = jittered(torus(n_major=36, n_minor=16), 0.1, 1)
    first = remesh(mesh, settings=RemeshSettings(edge_length=0.2, sigma=0.1)).mesh
    angle = smallest_angles(first.points[first.faces]).mean()
    for scale, turn in (
        (1e-3, np.eye(3)),
        (1e3, np.eye(3)),
        (1.0, rotation(0)),
        (7.0, rotation(1)),
    ):
        moved = mesh.with_points(scale * (mesh.points @ turn.T + 3.0))
        settings = RemeshSettings(edge_length=0.2 * scale, sigma=0.1 * scale)
        other = remesh(moved, settings=settings).mesh
        assert len(other.points) == pytest.approx(len(first.points), rel=0.05)
        found = smallest_angles(other.points[other.faces]).mean()
        assert found == pytest.approx(angle, rel=0.03)


def test_two_runs_are_the_same():
    mesh = jittered(icosphere(3), 0.2, 3)
    settings = RemeshSettings(vertices=300, sigma=0.3, smoothing=5)
    first, second = remesh(mesh, settings=settings).mesh, remesh(mesh, settings=settings).mesh
    np.testing.assert_array_equal(first.points, second.points)
    np.testing.assert_array_equal(first.faces, second.faces)


def test_smoothing_the_carrier_tames_jagged_input():
    mesh = jittered(icosphere(4), 0.3, 3)
    surface = TriangleSurface(mesh)
    result = remesh(mesh, surface, RemeshSettings(vertices=800, smoothing=10)).mesh
    check(result, worst=25.0, mean=50.0)
    assert np.abs(np.linalg.norm(result.points, axis=1) - 1.0).mean() < 0.01
    assert signed_volume(result) == pytest.approx(signed_volume(mesh), rel=1e-3)


def bad_meshes():
    sphere = icosphere(1)
    two = np.concatenate([sphere.faces, [[0, 1, 2]]])
    nan = sphere.points.copy()
    nan[3] = np.nan
    turned = sphere.faces.copy()
    turned[5] = turned[5][::-1]
    return {
        "no faces": TriMesh(sphere.points, np.zeros((0, 3), int)),
        "not finite": TriMesh(nan, sphere.faces),
        "not an oriented manifold": TriMesh(sphere.points, two),
        "oriented differently": TriMesh(sphere.points, turned),
    }


@pytest.mark.parametrize("words", list(bad_meshes()))
def test_bad_input_is_refused_in_a_sentence(words):
    with pytest.raises(InvalidMesh, match=words):
        remesh(bad_meshes()[words])


@pytest.mark.parametrize(
    "options",
    [
        {"vertices": 100, "edge_length": 1.0},
        {"vertices": 2},
        {"edge_length": 0.0},
        {"sigma": -1.0},
        {"iterations": 0},
        {"algorithm": "magic"},
        {"smoothing": -1},
        {"quality": "4d"},
        {"quality": "3d", "algorithm": "thesis"},
    ],
    ids=str,
)
def test_bad_settings_are_refused(options):
    with pytest.raises(InvalidCase):
        RemeshSettings(**options)


@pytest.mark.parametrize("unit", [1e-3, 1.0])
def test_a_long_sigma_may_stretch_triangles_between_creases(unit):
    """Plain angles of 24 degrees that a long sigma cannot keep would fold the surface instead."""
    mesh = cylinder()
    mesh = mesh.with_points(unit * mesh.points)
    least = [
        choose_recipe(RemeshSettings(**size, sigma=sigma * unit), mesh, jagged=False).least3
        for size in ({"edge_length": 0.2 * unit}, {"vertices": 600})
        for sigma in (0.2, 1.2)
    ]
    assert least == [24.0, 12.0, 24.0, 12.0]
    smooth = icosphere(2)
    assert choose_recipe(RemeshSettings(vertices=600, sigma=0.1), smooth, False).least3 == 12.0
