"""Damage done on purpose is counted and mended; what cannot be mended is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshes import InvalidMesh, Patch, Plane, TriMesh
from meshes.quality import signed_volume
from meshes.repair import repair
from meshes.self_intersection import self_intersecting_faces
from meshes.topology import edge_table, outward, require_valid, topology
from tests.shapes import cube, figure_eight, icosphere, torus


def counts(report):
    return {name: value for name, value in report.as_dict().items() if value}


def joined(*meshes):
    """Several meshes in one, their vertices apart."""
    start = np.cumsum([0] + [len(mesh.points) for mesh in meshes])
    points = np.concatenate([mesh.points for mesh in meshes])
    return TriMesh(points, np.concatenate([m.faces + s for m, s in zip(meshes, start)]))


def moved(mesh, *by):
    return mesh.with_points(mesh.points + np.array(by, float))


def welded(mesh):
    """All equal points made one, wherever they are."""
    points, index = np.unique(mesh.points, axis=0, return_inverse=True)
    return TriMesh(points, index.ravel()[mesh.faces])


def turned(mesh, chosen=slice(None)):
    faces = mesh.faces.copy()
    faces[chosen] = faces[chosen][:, ::-1]
    return TriMesh(mesh.points, faces)


def apart_in_threes(mesh):
    points = mesh.points[mesh.faces].reshape(-1, 3)
    return TriMesh(points, np.arange(len(points)).reshape(-1, 3))


@pytest.mark.parametrize("mesh", [torus(), cube(), icosphere(2), joined(cube(), moved(cube(), 3))])
def test_a_proper_surface_is_left_alone(mesh):
    again, report = repair(mesh)
    assert again is mesh
    assert counts(report) == {} and report.lines() == []


def test_an_open_surface_keeps_its_holes():
    mesh = TriMesh(torus().points, torus().faces[1:])
    again, report = repair(mesh)
    assert again is mesh and counts(report) == {"holes": 1}


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("noise", [0.0, 1e-8])
def test_loose_triangles_are_welded(scale, noise):
    whole = torus()
    loose = apart_in_threes(whole)
    jitter = noise * np.random.default_rng(0).standard_normal(loose.points.shape)
    mesh, report = repair(loose.with_points(scale * (loose.points + jitter)))
    found = require_valid(mesh)
    assert (found.vertices, found.faces, found.genus) == (960, 1920, 1)
    assert counts(report) == {"welded_near" if noise else "welded_vertices": 5760 - 960}


def test_sheets_that_touch_stay_apart():
    """Equal points are no reason to weld where nothing is open."""
    below, above = cube(), moved(cube(), 0, 0, 1)
    mesh, report = repair(joined(below, above), crossings=False)
    assert topology(mesh.faces, len(mesh.points)).components == 2 and counts(report) == {}


def test_faces_are_turned_to_agree_and_outward():
    rng = np.random.default_rng(1)
    chosen = rng.random(1920) < 0.3
    mesh, report = repair(turned(torus(), chosen))
    np.testing.assert_array_equal(np.sort(mesh.faces), np.sort(torus().faces))
    assert require_valid(mesh).oriented and signed_volume(mesh) > 0
    assert report.turned_faces == chosen.sum() and report.turned_pieces == 0
    mesh, report = repair(turned(torus()))
    assert signed_volume(mesh) > 0 and counts(report) == {"turned_pieces": 1}


def test_cavities_look_inward_and_turn_with_what_is_around_them():
    hollow = joined(icosphere(2), turned(icosphere(1, 0.5)))
    assert repair(hollow)[0] is hollow
    mesh, report = repair(turned(hollow))
    assert outward(mesh) and report.turned_pieces == 2
    one = np.flatnonzero(np.arange(len(hollow.faces)) == 330)  # a face of the cavity alone
    mesh, report = repair(turned(hollow, one))
    assert outward(mesh) and report.turned_faces == 1


def test_repeated_and_collapsed_faces_are_dropped():
    whole = torus()
    extra = [whole.faces[:10], np.roll(whole.faces[20:25], 1, axis=1), whole.faces[30:33, ::-1]]
    collapsed = [[5, 5, 6], [7, 8, 7]]
    mesh, report = repair(TriMesh(whole.points, np.concatenate([whole.faces, *extra, collapsed])))
    np.testing.assert_array_equal(mesh.faces, whole.faces)
    assert counts(report) == {"repeated_faces": 18, "collapsed_faces": 2}


def test_a_wall_between_two_bodies_goes():
    mesh, report = repair(welded(joined(cube(), moved(cube(), 1, 0, 0))))
    require_valid(mesh)
    assert signed_volume(mesh) == pytest.approx(2.0) and counts(report) == {"repeated_faces": 4}


@pytest.mark.parametrize("shift, edges, vertices", [((1, 1, 0), 1, 0), ((1, 1, 1), 0, 1)])
def test_bodies_that_share_an_edge_or_a_vertex_become_two(shift, edges, vertices):
    mesh, report = repair(welded(joined(cube(), moved(cube(), *shift))), crossings=False)
    found = require_valid(mesh)
    assert found.components == 2 and found.genus == 0
    assert signed_volume(mesh) == pytest.approx(2.0)
    assert (report.cut_edges, report.cut_vertices) == (edges, vertices)


def test_the_material_side_is_joined_in_a_notched_bar():
    """Two notches that meet in one edge: cutting leaves two bodies, not one that is inside out."""
    bodies = [moved(cube(), *by) for by in ((0, 0, 0), (1, 0, 0), (0, 0, 1), (1, 1, 1), (0, 1, 1))]
    whole, _ = repair(welded(joined(*bodies)), crossings=False)
    found = require_valid(whole)
    assert signed_volume(whole) == pytest.approx(5.0)
    assert found.nonmanifold_edges == 0


def test_an_edge_whose_ends_are_connected_elsewhere_too():
    """A ring of cubes that closes along an edge: its ends are one fan each, so it is divided."""
    places = [(0, 0, 0), (0, 1, 0), (1, 2, 0), (2, 1, 0), (2, 0, 0), (1, -1, 0)]
    ring = [moved(cube(), *by) for by in places]
    tower = [moved(cube(), x, y, z) for x, y, z in ((0, 1, 1), (1, 1, 1), (1, 2, 1))]
    tower += [moved(cube(), x, y, z) for x, y, z in ((0, 1, -1), (1, 1, -1), (1, 2, -1))]
    mesh, report = repair(welded(joined(*ring, *tower)), crossings=False)
    found = require_valid(mesh)
    assert report.cut_edges >= 1 and found.nonmanifold_edges == 0
    assert signed_volume(mesh) == pytest.approx(12.0)


def test_what_hangs_on_an_edge_is_dropped():
    sphere = icosphere(3)
    a, b = sphere.faces[0, :2]
    points = np.concatenate([sphere.points, [1.1 * sphere.points[a]]])
    fin = TriMesh(points, np.concatenate([sphere.faces, [[a, b, len(points) - 1]]]))
    mesh, report = repair(fin)
    np.testing.assert_array_equal(mesh.faces, sphere.faces)
    assert counts(report) == {"cut_edges": 1, "dangling_faces": 1}


def test_unequally_divided_edges_leave_no_crack():
    a, b = 0, 4
    faces = cube().faces.tolist()
    face = next(f for f in faces if {a, b} <= set(f))
    k = next(k for k in range(3) if {face[k], face[(k + 1) % 3]} == {a, b})
    p, q, r = (face[(k + i) % 3] for i in range(3))
    faces.remove(face)
    points = np.concatenate([cube().points, [0.3 * cube().points[b]]])
    mesh, report = repair(TriMesh(points, np.array([*faces, [p, 8, r], [8, q, r]])))
    found = require_valid(mesh)
    assert found.vertices == 9 and signed_volume(mesh) == pytest.approx(1.0)
    assert counts(report) == {"closed_cracks": 1, "flat_faces": 1}


@pytest.mark.parametrize("scale", [1e-90, 1.0, 1e90])
def test_needles_and_caps_are_taken_out(scale):
    whole = torus()
    points = whole.points.copy()
    points[1] = points[0]  # a needle on either side
    points[500] = 0.5 * (points[499] + points[501])
    cap = next(f for f in whole.faces.tolist() if {480, 481} <= set(f))
    k = next(k for k in range(3) if {cap[k], cap[(k + 1) % 3]} == {480, 481})
    p, q, r = (cap[(k + i) % 3] for i in range(3))
    points = np.concatenate([points, [0.4 * points[480] + 0.6 * points[481]]])
    faces = [f for f in whole.faces.tolist() if f != cap]
    faces += [[p, 960, r], [960, q, r], [p, q, 960]]
    mesh, report = repair(TriMesh(scale * points, faces))
    found = require_valid(mesh)
    assert found.genus == 1 and report.flat_faces == 3
    assert signed_volume(mesh) / scale**3 == pytest.approx(signed_volume(whole), rel=1e-3)


@pytest.mark.parametrize("faces, crossing", [(1, 0), (6, 0), (40, 0)])
def test_holes_are_filled_on_request(faces, crossing):
    whole = icosphere(3)
    near = np.argsort(whole.points[whole.faces].mean(axis=1)[:, 2])[::-1][:faces]
    rest = TriMesh(whole.points, np.delete(whole.faces, near, axis=0))
    mesh, report = repair(rest, fill=0.5)
    require_valid(mesh)
    assert report.filled_holes >= 1 and report.holes == 0
    assert signed_volume(mesh) == pytest.approx(signed_volume(whole), rel=5e-3)
    assert self_intersecting_faces(mesh.points, mesh.faces).sum() == crossing
    same, report = repair(rest, fill=1e-3)
    assert same is rest and report.holes >= 1


def test_a_long_hole_is_filled():
    whole = icosphere(5)
    above = whole.points[whole.faces].mean(axis=1)[:, 2] > 0.0
    mesh, report = repair(TriMesh(whole.points, whole.faces[~above]), fill=1.0, crossings=False)
    require_valid(mesh)
    assert report.filled_holes == 1
    assert signed_volume(mesh) == pytest.approx(2 / 3 * np.pi, rel=0.02)


def test_small_folds_are_drawn_apart():
    rough = torus()
    rng = np.random.default_rng(0)
    rough = rough.with_points(rough.points + 0.03 * rng.standard_normal(rough.points.shape))
    crossing = int(self_intersecting_faces(rough.points, rough.faces).sum())
    mesh, report = repair(rough)
    assert crossing > 0
    assert counts(report) == {"crossed_faces": crossing, "separated_faces": crossing}
    assert self_intersecting_faces(mesh.points, mesh.faces).sum() == 0
    assert (mesh.points == rough.points).all(axis=1).mean() > 0.7


def test_folds_at_an_open_boundary_are_drawn_apart_unless_it_is_held():
    rough = torus()
    rough = TriMesh(rough.points, rough.faces[np.abs(rough.points[rough.faces[:, 0], 0]) > 0.3])
    rng = np.random.default_rng(0)
    rough, _ = repair(rough)
    rough = rough.with_points(rough.points + 0.04 * rng.standard_normal(rough.points.shape))
    table = edge_table(rough.faces)
    border = np.unique(table.edges[table.count == 1])
    assert self_intersecting_faces(rough.points, rough.faces)[
        np.isin(rough.faces, border).any(axis=1)
    ].any()
    mesh, report = repair(rough)
    assert report.crossing_faces == 0 < report.crossed_faces
    assert not self_intersecting_faces(mesh.points, mesh.faces).any()
    again, report = repair(rough, hold_boundary=True)
    np.testing.assert_array_equal(again.points[border], rough.points[border])
    assert report.crossing_faces < report.crossed_faces


def test_overlapping_pieces_are_united():
    apart = moved(icosphere(1), 9)
    pieces = joined(cube(), moved(cube(), 0.5, 0.25, 0.25), apart)
    mesh, report = repair(pieces)
    assert report.united_pieces == 2 and report.crossing_faces == 0 < report.crossed_faces
    require_valid(mesh)
    assert not self_intersecting_faces(mesh.points, mesh.faces).any()
    overlap = 0.5 * 0.75 * 0.75
    assert signed_volume(mesh) == pytest.approx(2 - overlap + signed_volume(apart), rel=1e-12)
    assert {tuple(p) for p in apart.points} <= {tuple(p) for p in mesh.points}


def test_labels_and_feature_edges_of_united_pieces_are_kept():
    first, second = cube(), moved(cube(), 0.5, 0.25, 0.25)
    both = joined(first, second)
    edges = np.array([(0, 1), (8, 9)])
    labels = np.repeat([0, 1], len(first.faces))
    both = TriMesh(both.points, both.faces, labels, (Patch("a"), Patch("b")), edges)
    mesh, _ = repair(both)
    centres = mesh.points[mesh.faces].mean(axis=1)
    inside_first = (np.abs(centres - first.points.mean(axis=0)) <= 0.5 + 1e-9).all(axis=1)
    np.testing.assert_array_equal(mesh.face_labels, np.where(inside_first, 0, 1))
    kept = {frozenset(map(tuple, mesh.points[pair])) for pair in mesh.feature_edges}
    whole = [frozenset(map(tuple, both.points[pair])) for pair in edges]
    there = {frozenset(map(tuple, mesh.points[pair])) for pair in edge_table(mesh.faces).edges}
    assert kept == {edge for edge in whole if edge in there} != set()


def test_what_cannot_be_united_stays_and_is_counted():
    inside_out = turned(moved(cube(), 0.5, 0.25, 0.25))
    open_box = TriMesh(inside_out.points, inside_out.faces[:-1, ::-1])
    tube = figure_eight()
    crossing = int(self_intersecting_faces(tube.points, tube.faces).sum())
    for mesh in (joined(cube(), open_box), tube):
        again, report = repair(mesh)
        assert again is mesh and report.united_pieces == 0
        assert report.crossing_faces == report.crossed_faces > 0
    assert report.crossing_faces == crossing


def test_labels_and_feature_edges_are_kept():
    sides = tuple(Patch(str(k)) for k in range(5)) + (Patch("top", Plane((0, 0, 1), 1.0)),)
    box = cube()
    edges = [(0, 1), (2, 3), (6, 7)]
    mesh = TriMesh(box.points, box.faces, np.repeat(np.arange(6), 2), sides, edges)
    loose = apart_in_threes(mesh)
    index = {tuple(p): i for i, p in enumerate(loose.points.tolist())}
    pairs = [[index[tuple(box.points[v].tolist())] for v in pair] for pair in edges]
    loose = TriMesh(loose.points, loose.faces, mesh.face_labels, sides, pairs)
    again, _ = repair(loose)
    np.testing.assert_array_equal(again.face_labels, mesh.face_labels)
    assert again.labels == sides
    ends = {frozenset(map(tuple, again.points[pair].tolist())) for pair in again.feature_edges}
    assert ends == {frozenset(map(tuple, box.points[list(pair)].tolist())) for pair in edges}


def test_what_cannot_be_repaired_is_refused_with_counts():
    points = torus().points.copy()
    points[7, 1] = np.nan
    with pytest.raises(InvalidMesh, match="6 of 1920 faces have points with NaN"):
        repair(torus().with_points(points))
    with pytest.raises(InvalidMesh, match="no faces"):
        repair(TriMesh(np.eye(3), np.zeros((0, 3))))
    with pytest.raises(InvalidMesh, match="no face with an area"):
        repair(TriMesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]))
    with pytest.raises(InvalidMesh, match="1 face corners refer to points that do not exist"):
        repair(TriMesh(np.eye(3), [[0, 1, 3]]))
    n = 20
    a = np.arange(n) * 2 * np.pi / n
    ring = [1 + s * 0.3 * np.cos(a / 2) for s in (-1, 1)]
    strip = np.concatenate([np.stack([r * np.cos(a), r * np.sin(a), s * 0.3 * np.sin(a / 2)], 1)
                            for r, s in zip(ring, (-1, 1))])  # fmt: skip
    after = [(i + 1, n + i + 1) if i < n - 1 else (n, 0) for i in range(n)]
    faces = [f for i, (r, s) in enumerate(after) for f in ((i, r, n + i), (n + i, r, s))]
    with pytest.raises(InvalidMesh, match="40 faces belong to a surface with only one side"):
        repair(TriMesh(strip, faces))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.integers(-9, 9), st.sampled_from([0.0, 0.5, 2.0]))
def test_any_triangles_become_an_oriented_manifold_or_are_refused(seed, power, fill):
    rng = np.random.default_rng(seed)
    size = int(rng.integers(3, 12))
    points = rng.integers(0, 4, (size, 3)) if seed % 2 else rng.standard_normal((size, 3))
    faces = rng.integers(0, size, (int(rng.integers(1, 30)), 3))
    try:
        mesh, _ = repair(TriMesh(points * 10.0**power, faces), fill)
    except InvalidMesh as error:
        assert "no face with an area" in str(error) or "only one side" in str(error)
        return
    found = require_valid(mesh, closed=False)
    assert edge_table(mesh.faces).count.max() <= 2 and found.manifold
    assert np.isin(mesh.faces, np.arange(len(mesh.points))).all()


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_random_damage_of_a_torus_is_undone(seed):
    """Torn, turned and repeated faces: the torus comes back."""
    rng = np.random.default_rng(seed)
    whole = torus(n_major=16, n_minor=8)
    loose = apart_in_threes(whole)
    index = loose.faces.ravel().copy()
    together = rng.random(len(whole.points)) < 0.5  # the others are torn
    flat = whole.faces.ravel()
    index[together[flat]] = len(loose.points) + flat[together[flat]]
    faces = index.reshape(-1, 3)
    faces = np.concatenate([faces, faces[rng.random(len(faces)) < 0.1]])
    chosen = rng.random(len(faces)) < 0.2
    faces[chosen] = faces[chosen][:, ::-1]
    mesh, _ = repair(TriMesh(np.concatenate([loose.points, whole.points]), rng.permutation(faces)))
    found = require_valid(mesh)
    assert (found.vertices, found.faces, found.genus) == (128, 256, 1)
    assert signed_volume(mesh) == pytest.approx(signed_volume(whole))
