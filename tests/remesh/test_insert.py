"""Vertices put beside short edges that are held."""

import numpy as np

from remesh.carrier import make_carrier
from remesh.connectivity import BASE, CORNER, KIND
from remesh.embedding import smallest_angles
from remesh.halfedge import WorkMesh
from remesh.insert import insert_beside_short_edges
from tests.remesh.reference import broken_links
from tests.remesh.shapes import hemisphere


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
