"""Feature edges that follow their curve."""

import numpy as np

from meshes.features import find_features
from remesh.carrier import make_carrier
from remesh.collapse import collapse_short_edges
from remesh.follow import chord_gap, fit_curves, split_far_edges
from remesh.halfedge import WorkMesh
from remesh.optimise import optimise_vertices
from tests.remesh import reference
from tests.remesh.shapes import cylinder, revolved


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
    assert fit_curves(work, (0.0, 0.0, 0.0), 0.0, passes=1) > 0
    assert farthest_from_curve(work) <= before
    assert not reference.broken_links(work)


def test_no_vertex_on_a_crease_moves_so_that_its_edges_come_to_be_too_far_off():
    for bound, held in ((0.01, True), (1.0, False)):
        work = coarse_cylinder()
        while split_far_edges(work, 0.01, 0.1):
            pass
        moved, _ = optimise_vertices(work, 0.0, 0.3, 8, sweeps=5, along_curves=bound)
        assert moved > 0
        assert (farthest_from_curve(work) <= 0.01) == held


def test_planes_nearly_across_an_axis_are_exactly_so():
    plain = revolved([(0, 0), (1, 0), (1, 0.5), (1, 1), (0, 1)], around=24)
    rng = np.random.default_rng(0)
    noisy = plain.with_points(plain.points + 1e-6 * rng.uniform(-1, 1, plain.points.shape))
    planes = [patch.plane for patch in find_features(noisy).labels if patch.plane is not None]
    assert len(planes) == 2
    for plane in planes:
        assert sorted(map(abs, plane.normal)) == [0.0, 0.0, 1.0]
