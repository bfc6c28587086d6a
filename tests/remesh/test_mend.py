"""The worst angles are raised to a floor by changed edges, and what does not help is undone."""

import numpy as np
import pytest

from meshes import TriMesh
from meshes.topology import topology
from remesh.carrier import make_carrier
from remesh.connectivity import BASE, EDGES, KIND, ORIGIN, TRIANGLES, following
from remesh.embedding import smallest_angles
from remesh.halfedge import WorkMesh
from remesh.mend import MOST_ADDED, Mender, changes_at, raise_worst
from remesh.region import Region
from remesh.split import split_long_edges
from tests.remesh.reference import broken_links
from tests.remesh.shapes import cylinder, hemisphere, jittered
from tests.shapes import icosphere, torus

SHAPES = {
    "sphere": lambda: jittered(icosphere(3), 0.3, 3),
    "torus": lambda: jittered(torus(), 0.3, 4),
    "cylinder": lambda: cylinder(around=24, rings=8),
    "open": lambda: jittered(hemisphere(3), 0.3, 5),
}


def work_of(shape):
    work = WorkMesh(make_carrier(SHAPES[shape]()))
    split_long_edges(work, 1.1 * np.median(edge_lengths(work)), 0.0, 0.2)
    work.compact()
    return work


def edge_lengths(work):
    first, last = work.edge_rows()
    return np.linalg.norm(work.rows[first, :3] - work.rows[last, :3], axis=1)


def angles(work):
    return smallest_angles(work.rows[work.corner_rows()[0], :3])


def used(work):
    """All that is in use, for comparison."""
    rows, triangles = work.counts[0], work.counts[TRIANGLES]
    return [work.counts.copy(), *(a[:n].copy() for a, n in (
        (work.halves, 3 * triangles), (work.labels, triangles), (work.links, rows),
        (work.rows, rows),
    ))]  # fmt: skip


@pytest.mark.parametrize("shape", list(SHAPES))
def test_deficits_are_those_of_the_angles(shape):
    work = work_of(shape)
    mender = Mender(work, 40.0, 0.0, 0.2, 0.1)
    corners, live = work.corner_rows()
    held = (work.links[work.links[corners, BASE], KIND] != 0).sum(axis=1) >= 2
    floors = np.where(held, mender.floors[1], 40.0)
    expected = np.maximum(floors - angles(work), 0.0)
    np.testing.assert_allclose(mender.deficits(live), expected, atol=1e-3)
    total, _ = mender.cost(live)
    assert total == pytest.approx((expected**2).sum(), rel=1e-4)
    listed = mender.below_floor()
    assert len(listed) == (expected > 1e-9).sum() and mender.worst(live) == listed[0]


@pytest.mark.parametrize("shape", list(SHAPES))
def test_every_change_can_be_undone(shape):
    work = work_of(shape)
    mender = Mender(work, 40.0, 0.0, 0.2, 0.1)
    made, kinds = 0, set()
    for t in mender.below_floor()[:2]:
        region = Region(work, t, 6)
        before, state = used(work), region.state()
        for kind, h in changes_at(work.halves, int(t)):
            if mender.change(region, kind, h, int(t)):
                made += 1
                kinds.add(kind)
                assert made % 8 or broken_links(work) == []
            region.restore(state)
            for old, new in zip(before, used(work)):
                np.testing.assert_array_equal(old, new)
    assert made > 10 and len(kinds) == 4


@pytest.mark.parametrize("shape", list(SHAPES))
def test_the_floor_is_reached_and_the_surface_stays_what_it_is(shape):
    work = work_of(shape)
    mesh, _ = work.to_mesh()
    before, worst = topology(mesh.faces, len(mesh.points)), angles(work).min()
    floor = worst + 3.0
    assert raise_worst(work, floor, 0.0, 0.2, 0.1) == 0
    held = min(floor, 23.0)
    assert angles(work).min() >= held - 1e-3 > worst
    assert broken_links(work) == []
    mesh, _ = work.to_mesh()
    after = topology(mesh.faces, len(mesh.points))
    assert (after.genus, after.boundary_loops) == (before.genus, before.boundary_loops)


def test_floors_out_of_reach_do_no_harm():
    """Two changes in a row are tried around many triangles, and mostly undone."""
    work = WorkMesh(make_carrier(jittered(icosphere(2), 0.3, 3)))
    before = np.sort(angles(work))
    assert raise_worst(work, 50.0, 0.0, 0.2, 0.1) > 0
    assert broken_links(work) == []
    after = np.sort(angles(work))
    assert (
        after[0] > before[0]
        and np.maximum(50.0 - after, 0.0).sum() < 0.7 * np.maximum(50.0 - before, 0.0).sum()
    )


def test_the_count_stays_within_its_share():
    work = WorkMesh(make_carrier(jittered(hemisphere(2), 0.5, 1)))
    count = work.vertices
    assert MOST_ADDED * count < 1.0
    raise_worst(work, 35.0, 0.0, -1.0, 0.1)
    assert work.vertices <= count


def test_three_neighbours_with_four_edges_each_are_mended():
    """No place of the vertices has angles of 37 degrees there: edges must change."""
    work = WorkMesh(make_carrier(icosphere(3)))
    h = int(np.flatnonzero(work.halves[:, ORIGIN] == 200)[0])
    for k in (h, following(h)):
        split_one(work, k)
    assert work.links[:, EDGES].min() <= 4
    least = angles(work).min()
    far = np.linalg.norm(work.rows[:, :3] - work.rows[200, :3], axis=1) > 1.0
    kept = {tuple(p) for p in work.rows[far & (work.links[:, BASE] >= 0), :3]}
    assert least < 30.0
    assert raise_worst(work, 36.0, 0.0, 0.2, 0.1) == 0
    assert angles(work).min() > 35.99
    assert kept <= {tuple(p) for p in work.rows[: work.counts[0], :3]}


def split_one(work, h):
    """Split one edge in the middle."""
    mender = Mender(work, 1.0, 0.0, 0.0, 0.1)
    assert mender.change(None, 2, h, h // 3, (np.zeros(0, int), np.zeros(0, int)))


def test_nothing_happens_above_the_floor_or_where_nothing_helps():
    work = work_of("sphere")
    before = used(work)
    assert raise_worst(work, angles(work).min() - 0.1, 0.0, 0.2, 0.1) == 0
    for old, new in zip(before, used(work)):
        np.testing.assert_array_equal(old, new)
    tetrahedron = WorkMesh(make_carrier(stretched()))
    assert raise_worst(tetrahedron, 50.0, 0.0, 0.9999, 0.1) > 0
    assert len(tetrahedron.to_mesh()[0].faces) == 4


def stretched():
    """A flat tetrahedron: every triangle disagrees with the normals at its corners."""
    points = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float) * [1, 1, 0.3]
    return TriMesh(points, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))
