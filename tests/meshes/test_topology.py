"""Counts of edges, loops, handles and faults on surfaces whose answers are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshes import InvalidMesh, TriMesh
from meshes.topology import (
    boundary_loops,
    components,
    corner_groups,
    edge_table,
    feature_corners,
    label_boundaries,
    outward,
    require_valid,
    topology,
)
from tests import shapes
from tests.meshes import reference
from tests.meshes.reference import edge_faces


def joined(*meshes):
    """Several surfaces as one mesh."""
    start = np.cumsum([0] + [len(m.points) for m in meshes])
    return TriMesh(
        np.concatenate([m.points for m in meshes]),
        np.concatenate([m.faces + s for m, s in zip(meshes, start)]),
    )


def moved(mesh, shift, scale=1.0):
    return mesh.with_points(scale * mesh.points + np.asarray(shift))


def inside_out(mesh):
    return TriMesh(mesh.points, mesh.faces[:, ::-1])


@pytest.mark.parametrize(
    "mesh, genus, euler, components",
    [
        (shapes.cube(), 0, 2, 1),
        (shapes.icosphere(2), 0, 2, 1),
        (shapes.torus(n_major=7, n_minor=5), 1, 0, 1),
        (joined(shapes.torus(), shapes.icosphere(1), shapes.torus()), 2, 2, 3),
    ],
)
def test_closed_surfaces(mesh, genus, euler, components):
    found = topology(mesh.faces, len(mesh.points))
    assert found.watertight and found.oriented and found.manifold
    assert (found.genus, found.euler, found.components) == (genus, euler, components)
    assert found.boundary_loops == found.boundary_edges == found.duplicate_faces == 0
    assert found.edges == 3 * found.faces // 2


def test_points_of_no_face_do_not_count():
    mesh = shapes.cube()
    found = topology(mesh.faces, 20)
    assert (found.vertices, found.euler, found.genus) == (8, 2, 0)


def test_open_torus_has_loops_and_keeps_its_genus():
    mesh = shapes.torus(n_major=12, n_minor=8)
    faces = np.delete(mesh.faces, [0, 50], axis=0)
    found = topology(faces, len(mesh.points))
    assert not found.watertight and found.oriented and found.manifold
    assert (found.genus, found.boundary_loops, found.boundary_edges) == (1, 2, 6)
    loops = boundary_loops(faces)
    assert sorted(len(loop) for loop in loops) == [3, 3]
    # The boundary runs with the faces, so against the triangle that was there.
    gone = mesh.faces[0]
    loop = next(loop for loop in loops if set(loop) == set(gone))
    place = list(loop).index(gone[0])
    assert tuple(np.roll(loop, -place)) == (gone[0], gone[2], gone[1])


def test_loops_are_cut_where_they_touch():
    # A 4 x 4 grid without two squares that touch at one vertex.
    index = np.arange(25).reshape(5, 5)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    quads = np.stack([a, b, c, d], axis=-1)
    keep = np.ones((4, 4), bool)
    keep[1, 1] = keep[2, 2] = False
    quads = quads[keep]
    faces = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    assert topology(faces, 25).nonmanifold_vertices == 1
    assert sorted(len(loop) for loop in boundary_loops(faces)) == [4, 4, 16]


def test_pinched_vertices_and_crowded_edges():
    mesh = shapes.cube()
    twin = moved(mesh, (1, 1, 1))
    both = joined(mesh, twin)
    faces = both.faces.copy()
    faces[faces == 8] = 7  # corner (1, 1, 1) of both
    found = topology(faces, 16)
    assert (found.nonmanifold_vertices, found.nonmanifold_edges) == (1, 0)
    assert found.watertight and found.genus is None
    faces = joined(mesh, moved(mesh, (1, 1, 0))).faces.copy()
    faces[faces == 8] = 6
    faces[faces == 9] = 7
    found = topology(faces, 16)
    assert found.nonmanifold_edges == 1 and not found.watertight and found.genus is None


def test_repeated_collapsed_and_turned_faces():
    mesh = shapes.cube()
    turned = mesh.faces.copy()
    turned[3] = turned[3, ::-1]
    found = topology(turned, 8)
    assert found.watertight and not found.oriented and found.genus == 0
    repeated = np.concatenate([mesh.faces, mesh.faces[:1, [1, 0, 2]]])
    assert topology(repeated, 8).duplicate_faces == 1
    collapsed = np.concatenate([mesh.faces, [[0, 0, 1]]])
    found = topology(collapsed, 8)
    assert found.collapsed_faces == 1 and found.genus is None and not found.manifold


def test_faces_must_refer_to_points():
    with pytest.raises(InvalidMesh, match="2 face corners refer to points that do not exist"):
        topology(np.array([[0, 1, 5], [0, -1, 2]]), 5)


def test_no_faces():
    found = topology(np.zeros((0, 3), int), 4)
    assert (found.vertices, found.edges, found.components) == (0, 0, 0)
    assert not found.watertight


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.tuples(*[st.integers(0, 7)] * 3), min_size=1, max_size=14))
def test_edge_table_against_dictionary(faces):
    faces = np.array(faces)
    table = edge_table(faces)
    expected = edge_faces(faces)
    assert [tuple(e) for e in table.edges.tolist()] == sorted(expected)
    for k, edge in enumerate(table.edges.tolist()):
        members = table.half_edges[table.start[k] : table.start[k + 1]] // 3
        assert sorted(members.tolist()) == sorted(expected[tuple(edge)])
    for face, edges in zip(faces, table.face_edges):
        for k in range(3):
            assert sorted(table.edges[edges[k]]) == sorted((face[k], face[(k + 1) % 3]))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.sets(st.tuples(*[st.integers(0, 6)] * 3).filter(lambda f: len(set(f)) == 3), min_size=1))
def test_fans_against_walking(faces):
    """Fans by flood fill over corners, face by face."""
    faces = np.array(sorted(faces))
    _, count = corner_groups(faces)
    around = edge_faces(faces)
    seen, fans = set(), 0
    for face, vertex in [(f, v) for f in range(len(faces)) for v in faces[f]]:
        if (face, vertex) in seen:
            continue
        fans += 1
        front = [face]
        while front:
            here = front.pop()
            if (here, vertex) in seen:
                continue
            seen.add((here, vertex))
            for other in faces[here]:
                if other != vertex:
                    front.extend(around[tuple(sorted((int(vertex), int(other))))])
    assert count == fans


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.tuples(st.integers(0, 14), st.integers(0, 14)), max_size=14))
def test_components_against_spreading(pairs):
    rows, columns = np.array(pairs, int).reshape(-1, 2).T
    count, label = components(rows, columns, 15)
    assert label.tolist() == reference.components(pairs, 15)
    assert count == label.max() + 1


def test_outward_knows_cavities():
    shell = shapes.icosphere(2)
    cavity = inside_out(moved(shell, (0.1, 0, 0), 0.4))
    grain = moved(shell, (0.1, 0, 0), 0.2)
    assert outward(shell) and not outward(inside_out(shell))
    assert outward(joined(shell, cavity, grain))
    assert not outward(joined(shell, inside_out(cavity)))
    assert not outward(joined(shell, cavity, inside_out(grain)))
    assert outward(joined(shell, moved(shell, (3, 0, 0))))


def test_a_valid_surface_passes_and_faults_are_counted():
    mesh = shapes.cube()
    assert require_valid(mesh).genus == 0
    opened = TriMesh(mesh.points, mesh.faces[:-2])
    with pytest.raises(InvalidMesh, match="4 open edges"):
        require_valid(opened)
    assert require_valid(opened, closed=False).boundary_loops == 1
    with pytest.raises(InvalidMesh, match="inward"):
        require_valid(inside_out(mesh))
    with pytest.raises(InvalidMesh, match="the lid has no faces"):
        require_valid(TriMesh(mesh.points, np.zeros((0, 3), int)), name="the lid")
    bad = mesh.points.copy()
    bad[3, 1] = np.nan
    with pytest.raises(InvalidMesh, match="1 points with NaN"):
        require_valid(mesh.with_points(bad))
    turned = mesh.faces.copy()
    turned[3] = turned[3, ::-1]
    with pytest.raises(InvalidMesh, match="different orientation"):
        require_valid(TriMesh(mesh.points, turned))
    with pytest.raises(InvalidMesh, match=r"1 repeated faces, 3 edges with more than two faces"):
        require_valid(TriMesh(mesh.points, np.concatenate([mesh.faces, mesh.faces[:1]])))


def test_label_boundaries_are_the_cube_edges():
    mesh = shapes.cube()
    mesh = TriMesh(mesh.points, mesh.faces, np.repeat(np.arange(6), 2), labels=tuple("abcdef"))
    edges = label_boundaries(mesh)
    assert len(edges) == 12
    lengths = np.linalg.norm(mesh.points[edges[:, 0]] - mesh.points[edges[:, 1]], axis=1)
    np.testing.assert_array_equal(lengths, 1.0)
    # An open boundary counts, also within one label.
    opened = TriMesh(mesh.points, mesh.faces[:-2])
    assert len(label_boundaries(opened)) == 4


def test_feature_corners_of_a_polyline():
    # A square with a midpoint on one side, a spur, and a closed hexagon without corners.
    angle = np.radians(60 * np.arange(6))
    hexagon = 3 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) + 10
    points = np.concatenate(
        [[(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (1, -1, 0), (9, 9, 9)], hexagon]
    )
    square = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 0)]
    ring = [(7 + k, 7 + (k + 1) % 6) for k in range(6)]
    mesh = TriMesh(points, [[0, 1, 2]], feature_edges=square + ring)
    assert feature_corners(mesh, 61.0).tolist() == [0, 2, 3, 4]
    assert feature_corners(mesh, 59.0).tolist() == [0, 2, 3, 4, *range(7, 13)]
    mesh = TriMesh(points, [[0, 1, 2]], feature_edges=[*square, (1, 5)])
    assert feature_corners(mesh).tolist() == [0, 1, 2, 3, 4, 5]
    assert len(feature_corners(TriMesh(points, [[0, 1, 2]]))) == 0
