"""How half-edges and corners hang together, and sums over triangulations, against numpy."""

import numpy as np
import pytest

from meshes import InvalidMesh, TriMesh
from meshes.quality import corner_normals, face_areas, signed_volume
from meshes.topology import boundary_loops, corner_groups, edge_table, feature_mask
from remesh.carrier import make_carrier
from remesh.halfedge import WorkMesh
from remesh.layout import averaged, make_layout, row_normals
from remesh.prepare import taubin
from remesh.recipe import extent
from remesh.shape_kernels import enclosed_volume
from remesh.sweeps import length_for_count
from tests.remesh.shapes import cut_sphere, cylinder, hemisphere, jittered
from tests.shapes import cube, icosphere

SHAPES = {"cylinder": cylinder, "cut sphere": cut_sphere, "open": hemisphere, "cube": cube}


@pytest.fixture(params=SHAPES)
def layout(request):
    mesh = SHAPES[request.param]()
    return make_layout(jittered(mesh, 0.05, seed=1))


def test_half_edges_are_paired_as_in_the_edge_table(layout):
    faces = layout.mesh.faces
    table = edge_table(faces)
    edge = table.face_edges.ravel()
    single = table.count[edge] == 1
    np.testing.assert_array_equal(layout.twins < 0, single)
    inner = np.flatnonzero(~single)
    np.testing.assert_array_equal(edge[layout.twins[inner]], edge[inner])
    assert (layout.twins[inner] != inner).all()
    np.testing.assert_array_equal(layout.crease, feature_mask(layout.mesh, table)[edge])
    assert len(layout.edge_lengths()) == len(table.edges)


def test_sectors_are_the_corners_that_smooth_edges_join(layout):
    mesh = layout.mesh
    table = edge_table(mesh.faces)
    group, count = corner_groups(mesh.faces, ~feature_mask(mesh, table), table)
    assert len(layout.rows_of) == count
    pairs = np.unique(np.stack([group.ravel(), layout.group.ravel()]), axis=1)
    assert pairs.shape[1] == count  # one to one
    np.testing.assert_array_equal(layout.rows_of[layout.group], mesh.faces)
    n = len(mesh.points)
    np.testing.assert_array_equal(layout.rows_of[:n], np.arange(n))


def test_the_order_is_a_permutation_that_keeps_the_faces():
    mesh = cut_sphere()
    layout = make_layout(mesh)
    before = mesh.points[mesh.faces][layout.order]
    np.testing.assert_array_equal(before, layout.mesh.points[layout.mesh.faces])
    np.testing.assert_array_equal(mesh.face_labels[layout.order], layout.mesh.face_labels)
    edges = layout.mesh.points[layout.mesh.feature_edges]
    assert len(edges) == sum(
        len(loop) for loop in boundary_loops(mesh.faces[mesh.face_labels == 1])
    )


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_normals_areas_and_volumes_are_those_of_the_formulas(layout, scale):
    mesh = layout.mesh.with_points(layout.mesh.points * scale)
    scaled = make_layout(mesh)
    np.testing.assert_allclose(
        row_normals(scaled)[scaled.group], corner_normals(scaled.mesh), atol=1e-12
    )
    areas = face_areas(mesh.points, mesh.faces)
    centres = mesh.points[mesh.faces].mean(axis=1)
    middle = areas @ centres / areas.sum()
    spread = np.sqrt(areas @ ((centres - middle) ** 2).sum(axis=1) / areas.sum())
    assert extent(mesh) == pytest.approx(2.0 * spread, rel=1e-12)
    volume = enclosed_volume(mesh.points, mesh.faces)
    if scaled.closed:
        assert volume == pytest.approx(signed_volume(mesh), rel=1e-12)
    length = length_for_count(WorkMesh(make_carrier(mesh)), 0.0, 100)
    assert length == pytest.approx(np.sqrt(2.0 * areas.sum() / (np.sqrt(3.0) * 100)), rel=1e-12)


def test_averaged_normals_count_every_triangle_around(layout):
    before = row_normals(layout)
    total = np.zeros_like(before)
    for corners in layout.group:
        for row in corners:
            total[row] += before[corners].sum(axis=0) + before[row]
    total /= np.linalg.norm(total, axis=1)[:, None]
    np.testing.assert_allclose(averaged(layout.group, before, 1), total, atol=1e-14)


def test_taubin_steps_move_towards_the_mean_of_the_neighbours():
    mesh = make_layout(jittered(hemisphere(2), 0.1, seed=3)).mesh
    twins = make_layout(mesh).twins
    points = mesh.points.copy()
    edges = edge_table(mesh.faces).edges
    kinds = np.arange(len(points)) % 2  # every second one is held
    for factor in (0.4, -0.42):
        mean = np.array([
            points[np.setdiff1d(edges[(edges == v).any(axis=1)], [v])].mean(axis=0)
            for v in range(len(points))
        ])  # fmt: skip
        points += np.where(kinds[:, None] == 0, factor * (mean - points), 0.0)
    layout = make_layout(mesh)
    np.testing.assert_array_equal(layout.mesh.faces, mesh.faces)  # already in that order
    np.testing.assert_allclose(taubin(mesh, twins, 1, kinds), points, atol=1e-14)


def test_what_is_no_oriented_manifold_is_refused_with_counts():
    sphere = icosphere(1)
    faces = sphere.faces
    wing = np.vstack([faces, [faces[0, 0], faces[0, 1], 3]])
    turned = np.vstack([faces[:-1], faces[-1:, ::-1]])
    apart = np.vstack([faces, faces + len(sphere.points)])
    pinch = np.where(apart == len(sphere.points), 0, apart)
    points = np.vstack([sphere.points, sphere.points + 3.0])
    for bad, words in ((wing, "edges with more"), (turned, "differently"), (pinch, "1 pinched")):
        with pytest.raises(InvalidMesh, match=words):
            make_layout(TriMesh(points, bad))
    with pytest.raises(InvalidMesh, match="twice"):
        make_layout(TriMesh(points, np.vstack([faces, [0, 0, 5]])))
    assert make_layout(TriMesh(points, apart)).closed
