"""What is wrong at the end is undone around it, and nothing else is touched."""

import numpy as np
import pytest

from meshes.topology import topology
from remesh.carrier import make_carrier
from remesh.connectivity import OFFSET
from remesh.fidelity import TriangleFidelity
from remesh.finish import repair, wrong_faces
from remesh.halfedge import WorkMesh
from tests.remesh.reference import broken_links
from tests.shapes import icosphere


def work_of(mesh):
    work = WorkMesh(make_carrier(mesh))
    return work, TriangleFidelity(work.carrier, np.arange(len(mesh.faces)))


def push(work, row, by):
    """Offset a vertex along its normal."""
    work.rows[row, :3] += by * work.rows[row, 3:6]
    work.rows[row, OFFSET] += by


def slide(work, row, other):
    """A vertex beyond another one, without an offset: nothing to move back."""
    work.rows[row, :3] = 2.2 * work.rows[other, :3] - 1.2 * work.rows[row, :3]


def test_a_valid_mesh_is_left_alone():
    work, gaps = work_of(icosphere(2))
    before = work.saved()
    assert repair(work, gaps) == (0, 0, 0)
    for old, new in zip(before, work.saved()):
        np.testing.assert_array_equal(old, new)


def test_vertices_pushed_through_the_other_side_come_back():
    mesh = icosphere(2)
    work, gaps = work_of(mesh)
    push(work, 5, -2.5)
    crossing, inverted = wrong_faces(work, gaps)
    assert crossing.any() and inverted.any()
    left = repair(work, gaps)
    assert left[:2] == (0, 0) and left[2] > 0
    again, _ = work.to_mesh()
    assert len(again.points) >= len(mesh.points) - 15
    away = np.abs(mesh.points @ mesh.points[5]) < 0.3  # neither where it was, nor where it came out
    there = {tuple(point) for point in again.points}
    assert {tuple(point) for point in mesh.points[away]} <= there


@pytest.mark.parametrize("row", [3, 40, 100])
def test_a_vertex_slid_over_its_neighbour_is_undone(row):
    work, gaps = work_of(icosphere(2))
    mesh, _ = work.to_mesh()
    other = next(int(v) for face in mesh.faces if row in face for v in face if v != row)
    slide(work, row, other)
    assert any(found.any() for found in wrong_faces(work, gaps))
    left = repair(work, gaps)
    assert left[:2] == (0, 0) and left[2] > 0
    assert not any(found.any() for found in wrong_faces(work, gaps))
    again, _ = work.to_mesh()
    assert topology(again.faces, len(again.points)).genus == 0
    assert not broken_links(work)


def test_attempts_that_do_not_help_are_taken_back(monkeypatch):
    """With all attempts making things worse the mesh is what it was."""
    work, gaps = work_of(icosphere(2))
    push(work, 5, -2.5)
    before = work.saved()
    bad = [found.sum() for found in wrong_faces(work, gaps)]

    def worse(work, faces, rings):
        push(work, 60 + rings, -2.5)

    monkeypatch.setattr("remesh.finish._moved_back", worse)
    monkeypatch.setattr("remesh.finish._collapsed", worse)
    assert repair(work, gaps) == (*bad, 0)
    for old, new in zip(before, work.saved()):
        np.testing.assert_array_equal(old, new)


def test_short_edges_are_collapsed_where_moving_does_not_help(monkeypatch):
    monkeypatch.setattr("remesh.finish._moved_back", lambda work, faces, rings: None)
    work, gaps = work_of(icosphere(2))
    mesh, _ = work.to_mesh()
    other = next(int(v) for face in mesh.faces if 40 in face for v in face if v != 40)
    slide(work, 40, other)
    left = repair(work, gaps)
    assert left[:2] == (0, 0)
    again, _ = work.to_mesh()
    assert len(mesh.points) - 15 <= len(again.points) < len(mesh.points)
    assert topology(again.faces, len(again.points)).genus == 0 and not broken_links(work)


def test_triangles_that_only_look_the_wrong_way_count_too():
    """A point with the normal the other way round: it has to move or go."""
    work, gaps = work_of(icosphere(2))
    point = work.rows[40, :3].copy()

    class OneTurned:
        def exact_normals(self, mesh, work):
            normals = gaps.exact_normals(mesh, work)
            normals[(mesh.points[mesh.faces] == point).all(axis=2)] *= -1
            return normals

    crossing, inverted = wrong_faces(work, OneTurned())
    assert not crossing.any() and inverted.any()
    left = repair(work, OneTurned())
    assert left[:2] == (0, 0) and left[2] > 0
