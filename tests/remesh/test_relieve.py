"""The largest gaps: measured both ways, and made smaller without bad triangles."""

import numpy as np
import pytest

from meshes.closest_point import ClosestPoint
from remesh import RemeshSettings, remesh
from remesh.carrier import make_carrier
from remesh.collapse import collapse_short_edges
from remesh.connectivity import HINT, ORIGIN
from remesh.embedding import smallest_angles
from remesh.gap_kernels import lattice_gap, squared_to_rows
from remesh.halfedge import WorkMesh
from remesh.relieve import gaps_of, lattice_points, relieve_gaps
from tests.remesh import reference
from tests.remesh.shapes import cylinder, revolved
from tests.shapes import icosphere


def spiked_sphere(subdivisions=4):
    """A work mesh that has lost a bump of its carrier."""
    sphere = icosphere(subdivisions)
    points = sphere.points.copy()
    spike = points[int(np.argmax(points @ np.array([0.3, 0.5, 0.8])))]
    points *= 1.0 + 0.2 * np.exp(-((points - spike) ** 2).sum(axis=1) / 0.1**2)[:, None]
    work = WorkMesh(make_carrier(sphere.with_points(points)))
    for _ in range(2):
        collapse_short_edges(work, 0.25, 0.55, 0.0, (0.0, 0.0, 0.1))
        work.compact()
    return work


def missed(work):
    """Largest distance of the carrier's points from the work mesh."""
    mesh, _ = work.to_mesh()
    return ClosestPoint(mesh.points, mesh.faces).query(work.carrier.mesh.points)[2].max()


def test_the_lattice_has_its_corners_and_midpoints_first():
    lattice = lattice_points(6)
    assert len(lattice) == 28 == len(np.unique(lattice, axis=0))
    np.testing.assert_allclose(lattice.sum(axis=1), 1.0, atol=1e-15)
    assert set(lattice[:6].ravel()) == {0.0, 0.5, 1.0}


@pytest.mark.parametrize("seed", range(4))
def test_distances_to_rows_agree_with_the_slow_twin(seed):
    rng = np.random.default_rng(seed)
    rows = np.zeros((3, 8))
    rows[:, :3] = rng.normal(size=(3, 3)) * [1.0, 10.0**-seed, 1.0]
    for point in rng.normal(size=(50, 3)):
        found = np.sqrt(squared_to_rows(rows, 0, 1, 2, point))
        expected = np.linalg.norm(point - reference.closest_on_triangle(point, rows[:, :3]))
        assert found == pytest.approx(expected, abs=1e-7)


def test_gaps_agree_with_the_slow_twin():
    work = spiked_sphere(3)
    lattice = lattice_points(2)
    targets, gaps, _ = gaps_of(work, 0.02, lattice)
    carrier = work.carrier.mesh
    mesh, _ = work.to_mesh()
    for t in np.argsort(-gaps)[:2]:
        a, b, c = work.halves[3 * t : 3 * t + 3, ORIGIN]
        points = lattice @ work.rows[[a, b, c], :3]
        expected = max(reference.closest_distance(p, carrier) for p in points)
        found = lattice_gap(work.links, work.rows, a, b, c, targets, 1e-3, 0.0)
        assert found == pytest.approx(expected, abs=1e-9)
        assert work.links[a, HINT] >= 0
    listed = targets[2][targets[1][gaps.argmax()] : targets[1][gaps.argmax() + 1]]
    seen = max(reference.closest_distance(targets[0][i], mesh) for i in listed)
    assert gaps.max() == pytest.approx(seen) and seen >= missed(work) - 1e-12


def test_a_spike_that_triangles_miss_is_reached():
    work = spiked_sphere()
    before = missed(work)
    corners, _ = work.corner_rows()
    least = smallest_angles(work.rows[corners, :3]).min()
    left = relieve_gaps(work, 0.03, 0.0, (0.0, 5.0, 0.0))
    assert before > 0.1 and missed(work) < 0.5 * before
    assert left == 0 or missed(work) > 0.03
    corners, _ = work.corner_rows()
    assert smallest_angles(work.rows[corners, :3]).min() >= min(5.0, least) - 1e-9
    assert not reference.broken_links(work)


def test_gaps_that_are_small_enough_are_left_alone():
    work = spiked_sphere()
    before = work.rows.copy()
    assert relieve_gaps(work, 1.0, 0.0, (0.0, 5.0, 0.0)) == 0
    np.testing.assert_array_equal(work.rows, before)


@pytest.mark.parametrize("shape", ["ring of facets", "cylinder"])
def test_no_point_of_a_remeshed_surface_with_bends_is_missed(shape):
    """Facets that meet at 20 to 30 degrees are no features, but triangles must not cut across."""
    if shape == "cylinder":
        part = cylinder(around=18)
    else:
        angle = np.linspace(-np.pi / 2, np.pi / 2, 9)
        part = revolved(np.stack([np.cos(angle), 1.4 * np.sin(angle)], axis=1), around=18)
    result = remesh(part, None, RemeshSettings(vertices=700, sigma=0.05 * part.diagonal))
    mesh = result.mesh
    distance = ClosestPoint(mesh.points, mesh.faces).query(part.points)[2]
    rms = np.sqrt(np.mean(distance**2))
    area = np.linalg.norm(
        np.cross(*(mesh.points[mesh.faces[:, k]] - mesh.points[mesh.faces[:, 0]] for k in (1, 2))),
        axis=1,
    )
    assert distance.max() < max(6.0 * rms, 0.04 * np.sqrt(2.3 * area.sum() / len(mesh.faces)))
    assert result.statistics.self_intersecting_faces == 0
    assert result.statistics.inverted_faces == 0
