"""Vertices put at far points and beside short edges that are held."""

import numpy as np
import pytest

from meshes.closest_point import ClosestPoint
from remesh import RemeshSettings, recipe, remesh
from remesh.carrier import make_carrier
from remesh.collapse import collapse_short_edges
from remesh.connectivity import BASE, CORNER, KIND
from remesh.embedding import smallest_angles
from remesh.halfedge import WorkMesh
from remesh.insert import insert_at_far_points, insert_beside_short_edges
from tests.remesh.reference import broken_links
from tests.remesh.shapes import cylinder, hemisphere
from tests.shapes import icosphere


def missed(work):
    """Distance of every point of the carrier from the work mesh."""
    mesh, _ = work.to_mesh()
    return ClosestPoint(mesh.points, mesh.faces).query(work.carrier.mesh.points)[2]


def test_points_that_are_far_become_vertices():
    sphere = icosphere(3)
    points = sphere.points.copy()
    points[100] *= 1.15
    work = WorkMesh(make_carrier(sphere.with_points(points)))
    collapse_short_edges(work, 0.3, 0.9, 0.0, (0.0, 0.0, 0.3))
    work.compact()
    before, count = missed(work), work.vertices
    farthest = 0.5 * before.max()
    rows = insert_at_far_points(work, farthest, at_most=5)
    assert 0 < len(rows) <= 5 and work.vertices == count + len(rows)
    assert missed(work).max() < before.max()
    worst = work.carrier.mesh.points[before.argmax()]
    assert np.linalg.norm(work.rows[rows, :3] - worst, axis=1).min() < 1e-12
    assert not broken_links(work)
    assert len(insert_at_far_points(work, 10.0, at_most=5)) == 0


def test_thin_triangles_at_held_edges_are_split_beside_them():
    plain = hemisphere(2)
    points = plain.points.copy()
    top = points[plain.faces].mean(axis=1)[:, 2].argmax()
    edge = plain.faces[top, :2]  # far from the boundary
    middle = points[edge].mean(axis=0)
    points[edge] = middle + 0.1 * (points[edge] - middle)
    work = WorkMesh(make_carrier(plain.with_points(points)))
    inside = len(insert_beside_short_edges(work, 12.0, at_most=9))
    corners, _ = work.corner_rows()
    thin = smallest_angles(work.rows[corners, :3]) < 12.0
    assert inside == 0 and thin.any()
    distance = np.linalg.norm(work.rows[:, :3] - middle, axis=1)
    ends = np.argsort(np.where(work.links[:, BASE] >= 0, distance, np.inf))[:2]
    work.links[ends, KIND] = CORNER
    count = work.vertices
    rows = insert_beside_short_edges(work, 12.0, at_most=9)
    assert 0 < len(rows) <= 9 and work.vertices == count + len(rows)
    short = np.linalg.norm(work.rows[ends[0], :3] - work.rows[ends[1], :3])
    nearest = np.linalg.norm(work.rows[rows, None, :3] - work.rows[None, ends, :3], axis=2)
    assert (nearest.min(axis=1) < 5.0 * short).all()
    assert not broken_links(work)


def test_surfaces_with_creases_in_6d_get_no_vertices_so(monkeypatch):
    """On optimised parts, whose sections end in planes, they folded the surface there."""

    def refuse(*arguments):
        raise AssertionError("vertices were put in")

    monkeypatch.setattr(recipe, "insert_at_far_points", refuse)
    monkeypatch.setattr(recipe, "insert_beside_short_edges", refuse)
    part = cylinder()
    result = remesh(part, None, RemeshSettings(vertices=300, sigma=0.1 * part.diagonal))
    assert result.statistics.self_intersecting_faces == 0
    monkeypatch.undo()
    monkeypatch.setattr(recipe, "insert_at_far_points", refuse)
    with pytest.raises(AssertionError, match="put in"):
        remesh(icosphere(3), None, RemeshSettings(vertices=300, sigma=0.1))
