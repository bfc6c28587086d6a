"""Remeshing within an error bound: it holds, is proved, and few triangles need it."""

import numpy as np
import pytest

from meshes import InvalidCase
from meshes.closest_point import ClosestPoint, two_sided_distance
from meshes.features import find_features
from meshes.quality import signed_volume
from meshes.self_intersection import self_intersecting_faces
from meshes.topology import edge_table, topology
from remesh import RemeshSettings, TriangleSurface, remesh
from remesh.dense import dense_triangulation
from remesh.embedding import smallest_angles
from tests.remesh.shapes import closed_shapes, cylinder, hemisphere, jittered
from tests.shapes import SphereSurface, cube, icosphere, torus


def check(mesh, source, error, proved):
    """Same topology, no self-intersection, and the bound holds for samples."""
    found, before = (topology(m.faces, len(m.points)) for m in (mesh, source))
    assert found.manifold and found.oriented
    assert found.genus == before.genus
    assert found.boundary_loops == before.boundary_loops
    assert not self_intersecting_faces(mesh.points, mesh.faces).any()
    assert proved <= error
    assert two_sided_distance(source, mesh, samples=30_000)[1] <= proved + 1e-12


@pytest.mark.parametrize("name", list(closed_shapes()))
def test_the_bound_holds(name):
    source = find_features(jittered(closed_shapes()[name], 0.03, 2))
    error = 0.05
    result = remesh(source, settings=RemeshSettings(max_error=error))
    found = result.statistics
    check(result.mesh, source, error, found.proved_distance)
    assert found.vertices < 0.6 * len(source.points)
    assert found.proved_normal_angle < 90.0
    assert found.inverted_faces == 0


def test_a_sphere_needs_as_many_vertices_as_theory_says():
    """With vertices off the surface a triangle's sagitta, l^2 / (6 R) of circumradius, is shared.

    The best triangulation has its corners as far outside as its centres are inside.
    """
    source, error = icosphere(5), 4e-3
    result = remesh(source, settings=RemeshSettings(max_error=error)).mesh
    # equilateral with side l: sagitta l^2 / 6 = 2 error; 4 pi / (sqrt(3) / 4 l^2) faces
    best = 0.5 * 4.0 * np.pi / (np.sqrt(3.0) / 4.0 * 12.0 * error)
    assert best < len(result.points) < 2.0 * best


def test_planes_creases_and_corners_stay():
    source = find_features(jittered_cube())
    result = remesh(source, settings=RemeshSettings(max_error=0.01)).mesh
    assert len(result.points) == 8
    assert signed_volume(result) == pytest.approx(1.0, abs=1e-12)
    tube = cylinder()
    result = remesh(tube, settings=RemeshSettings(max_error=0.02))
    check(result.mesh, tube, 0.02, result.statistics.proved_distance)
    for label, patch in enumerate(result.mesh.labels):
        vertices = np.unique(result.mesh.faces[result.mesh.face_labels == label])
        if patch.plane is not None:
            assert np.abs(patch.plane.signed_distance(result.mesh.points[vertices])).max() == 0.0


def jittered_cube():
    """A cube of many triangles."""
    return remesh(find_features(cube()), settings=RemeshSettings(vertices=300)).mesh


def test_open_boundaries_stay_loops_and_fixed_ones_their_bits():
    source = hemisphere(4)
    result = remesh(source, settings=RemeshSettings(max_error=0.02))
    check(result.mesh, source, 0.02, result.statistics.proved_distance)
    fixed = remesh(source, settings=RemeshSettings(max_error=0.02, fix_boundary=True)).mesh
    rims = []
    for mesh in (source, fixed):
        table = edge_table(mesh.faces)
        ends = mesh.points[table.edges[table.count == 1]]
        rims.append({frozenset(map(tuple, edge)) for edge in ends})
    assert rims[0] == rims[1]


def test_lengths_and_normals_are_held():
    source, error = icosphere(4), 0.02
    plain = remesh(source, settings=RemeshSettings(max_error=error))
    held = remesh(source, settings=RemeshSettings(max_error=error, max_normal_angle=12.0))
    assert plain.statistics.proved_normal_angle > 12.0
    assert held.statistics.proved_normal_angle <= 12.0 + 1e-6
    assert held.statistics.vertices > plain.statistics.vertices
    for options, longest in (
        ({"max_length": 0.2}, 0.2),
        ({"edge_length": 0.2, "sigma": 1.0}, 0.15),
    ):
        mesh = remesh(source, settings=RemeshSettings(max_error=error, **options)).mesh
        ends = mesh.points[edge_table(mesh.faces).edges]
        assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max() <= longest
    short = remesh(source, settings=RemeshSettings(max_error=1e-4, min_length=0.15))
    assert short.statistics.vertices < 0.7 * len(source.points)
    assert short.statistics.proved_distance > 1e-4


class Ear:
    """The unit sphere with an ear over a direction, too narrow for the vertices beside it to see.

    S = |x| - 1 - height exp(-|x / |x| - direction|^2 / width^2)
    """

    def __init__(self, direction, height=0.15, width=0.12):
        self.direction, self.height, self.width = direction, height, width

    def _radius(self, points):
        size = np.linalg.norm(points, axis=1)
        away = points / size[:, None] - self.direction
        square = (away**2).sum(axis=1) / self.width**2
        return size, 1.0 + self.height * np.exp(-square)

    def value(self, points):
        size, radius = self._radius(points)
        return size - radius

    def gradient(self, points):
        steps = 1e-6 * np.eye(3)
        slopes = [(self.value(points + e) - self.value(points - e)) / 2e-6 for e in steps]
        return np.stack(slopes, axis=1)

    def value_and_gradient(self, points):
        return self.value(points), self.gradient(points)

    def project(self, points):
        size, radius = self._radius(points)
        moved = points * (radius / size)[:, None]
        normal = self.gradient(moved)
        return moved, normal / np.linalg.norm(normal, axis=1)[:, None]


def test_an_ear_between_vertices_is_seen_by_the_interpolants_values():
    """The thesis's 4.2.1: the normals, and S, at all vertices are those of a plain sphere."""
    sphere, error = icosphere(1), 0.01
    middle = sphere.points[sphere.faces[7, :2]].sum(axis=0)
    ear = Ear(middle / np.linalg.norm(middle))
    assert np.abs(ear.value(sphere.points)).max() < 2e-3
    _, gap = dense_triangulation(sphere, [ear], 0.1 * error)
    assert gap <= 0.1 * error
    result = remesh(sphere, ear, RemeshSettings(max_error=error)).mesh
    assert np.linalg.norm(result.points, axis=1).max() > 1.15 - error
    assert np.abs(ear.value(result.points[result.faces].mean(axis=1))).max() < 2.0 * error


def test_an_analytic_sphere_is_met_from_a_coarse_input():
    error = 2e-3
    result = remesh(icosphere(2), SphereSurface(), RemeshSettings(max_error=error))
    assert result.statistics.vertices > len(icosphere(2).points)
    truth = icosphere(6)
    assert two_sided_distance(truth, result.mesh, samples=30_000)[1] <= error * 1.1


def test_scaling_by_powers_of_two_changes_nothing():
    source = jittered(torus(n_major=24, n_minor=12), 0.05, 1)
    first = remesh(source, settings=RemeshSettings(max_error=0.03)).mesh
    for scale in (2.0**-30, 2.0**20):
        scaled = source.with_points(scale * source.points)
        other = remesh(scaled, settings=RemeshSettings(max_error=0.03 * scale)).mesh
        np.testing.assert_array_equal(first.faces, other.faces)
        np.testing.assert_array_equal(scale * first.points, other.points)


def test_triangle_surfaces_and_angles():
    source = torus()
    result = remesh(source, TriangleSurface(source), RemeshSettings(max_error=0.02, least_angle=15))
    assert smallest_angles(result.mesh.points[result.mesh.faces]).min() > 5.0
    distance = ClosestPoint(source.points, source.faces).query(result.mesh.points)[2]
    assert distance.max() <= result.statistics.proved_distance


@pytest.mark.parametrize(
    "options",
    [
        {"max_error": 0.0},
        {"max_error": -1.0},
        {"max_error": float("nan")},
        {"max_error": 1.0, "vertices": 100},
        {"max_error": 1.0, "algorithm": "thesis"},
        {"max_error": 1.0, "smoothing": 3},
        {"max_error": 1.0, "max_normal_angle": 0.0},
        {"max_error": 1.0, "min_length": 2.0, "max_length": 1.0},
        {"max_error": 1.0, "least_angle": 40.0},
        {"max_normal_angle": 10.0},
    ],
    ids=str,
)
def test_bad_settings_are_refused(options):
    with pytest.raises(InvalidCase):
        RemeshSettings(**options)
