"""Feature edges that follow their curve, and vertices drawn to what triangles miss."""

import numpy as np

from meshes.closest_point import ClosestPoint
from meshes.features import find_features
from remesh.adjust import free_rows
from remesh.carrier import make_carrier
from remesh.collapse import collapse_short_edges
from remesh.embedding import smallest_angles
from remesh.follow import chord_gap, fit_curves, split_far_edges
from remesh.halfedge import WorkMesh
from remesh.reach import reach_far_points
from tests.remesh import reference
from tests.remesh.shapes import cylinder, revolved
from tests.shapes import icosphere


def farthest_from_curve(work):
    """Largest distance of the carrier's feature vertices from the work mesh's feature edges."""
    mesh, _ = work.to_mesh()
    ends = mesh.points[mesh.feature_edges]
    before = work.carrier.mesh
    worst = 0.0
    for p in before.points[np.unique(before.feature_edges)]:
        step = ends[:, 1] - ends[:, 0]
        along = np.einsum("ij,ij->i", p - ends[:, 0], step) / (step**2).sum(axis=1)
        foot = ends[:, 0] + np.clip(along, 0.0, 1.0)[:, None] * step
        worst = max(worst, np.linalg.norm(foot - p, axis=1).min())
    return worst


def coarse_cylinder():
    """A cylinder whose rims have been collapsed to few edges."""
    work = WorkMesh(make_carrier(cylinder(around=48, rings=12)))
    for _ in range(6):
        collapse_short_edges(work, 0.5, 1.2, 0.0, (0.0, 0.0, 0.1))
        work.compact()
    return work


def test_edges_far_from_their_curve_are_split():
    work = coarse_cylinder()
    before = farthest_from_curve(work)
    assert before > 0.03
    while split_far_edges(work, 0.02, 0.1):
        pass
    assert farthest_from_curve(work) <= 0.02
    assert not reference.broken_links(work)


def test_curve_vertices_move_to_the_nodes_that_leave_least():
    """The gap of a chord is measured at the nodes between, and vertices move to such nodes."""
    work = coarse_cylinder()
    starts, nodes = work.curves[:2]
    ends = np.empty((2, 9))
    length = nodes[starts[1] - 1, 3]
    total, worst, at = chord_gap(work.curves, 0, 0.1 * length, 0.3 * length, ends)
    inside = (nodes[: starts[1], 3] > 0.1 * length) & (nodes[: starts[1], 3] < 0.3 * length)
    a, b = ends[0, :3], ends[1, :3]
    away = [
        np.linalg.norm(np.cross(p - a, b - a)) / np.linalg.norm(b - a)
        for p in nodes[: starts[1]][inside, :3]
    ]
    assert np.sqrt(worst) == max(away) or np.isclose(np.sqrt(worst), max(away))
    assert nodes[: starts[1]][inside][np.argmax(away), 3] == at
    assert total > 0.0
    before = farthest_from_curve(work)
    assert fit_curves(work, (0.0, 0.0, 0.0), passes=1) > 0
    assert farthest_from_curve(work) <= before
    assert not reference.broken_links(work)


def test_a_vertex_is_drawn_to_a_spike_that_triangles_miss():
    sphere = icosphere(4)
    points = sphere.points.copy()
    spike = int(np.argmax(points @ np.array([0.3, 0.5, 0.8])))
    points[spike] *= 1.2
    work = WorkMesh(make_carrier(sphere.with_points(points)))
    collapse_short_edges(work, 0.4, 0.9, 0.0, (0.0, 0.0, 0.1))
    work.compact()

    def missed():
        mesh, _ = work.to_mesh()
        return ClosestPoint(mesh.points, mesh.faces).query(points[[spike]])[2][0]

    before = missed()
    assert before > 0.1
    rows = reach_far_points(work, free_rows(work), 0.3, 0.0, (0.0, 5.0, 0.0))
    assert len(rows) > 0
    assert missed() < 0.5 * before
    mesh, _ = work.to_mesh()
    assert smallest_angles(mesh.points[mesh.faces]).min() > 1.0


def test_planes_nearly_across_an_axis_are_exactly_so():
    plain = revolved([(0, 0), (1, 0), (1, 0.5), (1, 1), (0, 1)], around=24)
    rng = np.random.default_rng(0)
    noisy = plain.with_points(plain.points + 1e-6 * rng.uniform(-1, 1, plain.points.shape))
    planes = [patch.plane for patch in find_features(noisy).labels if patch.plane is not None]
    assert len(planes) == 2
    for plane in planes:
        assert sorted(map(abs, plane.normal)) == [0.0, 0.0, 1.0]
