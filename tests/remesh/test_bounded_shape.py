"""Better angles and graded sizes within an error bound, which stays proved."""

import numpy as np
import pytest

from meshes.closest_point import ClosestPoint
from meshes.closest_point_kernels import STACK
from meshes.distance_bound import face_bounds
from meshes.distance_bound_kernels import MOST_WAITING
from meshes.edges import edge_table
from meshes.features import find_features
from meshes.quality import face_areas, signed_volume
from remesh import RemeshSettings, remesh
from remesh.bounded import BoundLimits, coarsen, flatten, make_sure
from remesh.bounded_mesh import BoundedMesh
from remesh.bounded_original import strays
from remesh.bounded_shape import ShapeAims, grade, proved, vertex_sizes
from remesh.bounded_shape_kernels import OPEN, measure_shapes
from remesh.embedding import smallest_angles
from tests.remesh.reference_bounded import slow_shape
from tests.remesh.shapes import cylinder, jittered
from tests.remesh.test_bounded import check
from tests.shapes import icosphere, torus

ERROR = 0.03


@pytest.fixture(scope="module")
def source():
    return find_features(jittered(torus(n_major=32, n_minor=16), 0.05, 1))


@pytest.fixture
def coarse(source):
    """A surface that was proved to be within the bound, and its proof."""
    limits = BoundLimits(ERROR)
    work = BoundedMesh(source, ERROR)
    coarsen(work, limits, lambda share: None)
    return work, make_sure(work, limits)[2], limits


@pytest.mark.parametrize("options", [{"quality": "3d"}, {"quality": "6d", "sigma": 0.3}], ids=str)
def test_worst_angles_rise_and_the_bound_stays_proved(source, options):
    plain = remesh(source, settings=RemeshSettings(max_error=ERROR))
    found = remesh(source, settings=RemeshSettings(max_error=ERROR, **options))
    check(found.mesh, source, ERROR, found.statistics.proved_distance)
    assert found.statistics.inverted_faces == 0
    angles = [smallest_angles(r.mesh.points[r.mesh.faces]) for r in (plain, found)]
    if options["quality"] == "3d":
        assert angles[0].min() < 20.0 and angles[1].min() > 22.0
    assert angles[1].mean() > angles[0].mean() + 5.0
    assert found.statistics.vertices < 2.0 * plain.statistics.vertices


def test_curves_and_planes_stay_and_their_angles_rise():
    tube = cylinder()
    settings = RemeshSettings(max_error=0.02, quality="3d", gradation=1.5)
    result = remesh(tube, settings=settings)
    check(result.mesh, tube, 0.02, result.statistics.proved_distance)
    assert smallest_angles(result.mesh.points[result.mesh.faces]).min() > 20.0
    for label, patch in enumerate(result.mesh.labels):
        vertices = np.unique(result.mesh.faces[result.mesh.face_labels == label])
        if patch.plane is not None:
            assert np.abs(patch.plane.signed_distance(result.mesh.points[vertices])).max() == 0.0


def test_normals_and_lengths_are_held_too(source):
    settings = RemeshSettings(max_error=ERROR, quality="3d", max_normal_angle=30.0, max_length=0.3)
    found = remesh(source, settings=settings)
    assert found.statistics.proved_normal_angle <= 30.0 + 1e-6
    assert found.statistics.proved_distance <= ERROR
    ends = found.mesh.points[edge_table(found.mesh.faces).edges]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max() <= 0.3


def sizes_of(mesh):
    return np.sqrt(4.0 / np.sqrt(3.0) * face_areas(mesh.points, mesh.faces))


def test_grading_cuts_what_is_larger_than_the_field(coarse):
    """The field by all pairs of distances along edges; the surface does not change."""
    work, proof, limits = coarse
    before, growth = proof.mesh, 0.1
    sizes = vertex_sizes(work)
    given = len(work.kept())
    open_to = np.full(len(work.state[4]), OPEN, np.int8)
    grade(work, limits, ShapeAims(False, growth=growth), sizes, open_to)
    mesh, _ = work.to_mesh()
    assert len(mesh.points) > 1.1 * given
    table = edge_table(mesh.faces)
    away = np.full((len(mesh.points), len(mesh.points)), np.inf)
    np.fill_diagonal(away, 0.0)
    steps = np.linalg.norm(np.diff(mesh.points[table.edges], axis=1)[:, 0], axis=1)
    for (a, b), step in zip(table.edges, steps, strict=True):
        away[a, b] = away[b, a] = step
    for k in range(len(away)):
        away = np.minimum(away, away[:, k, None] + away[k])
    known = np.isfinite(sizes[work.kept()[:given]])
    assert known.all()
    field = (sizes[work.kept()][:given, None] + growth * away[:given]).min(axis=0)
    assert (sizes_of(mesh) <= 1.06 * field[mesh.faces].mean(axis=1)).all()
    assert signed_volume(mesh) == pytest.approx(signed_volume(before), rel=1e-12)


def test_a_change_that_leaves_the_bound_is_undone(coarse):
    work, proof, limits = coarse
    before, tried = proof.mesh.points.copy(), []

    def change(open_to):
        tried.append(int((open_to == OPEN).sum()))
        work.state[6][work.kept()[5]] += 3.0 * ERROR

    proved(work, proof, limits, change)
    assert len(tried) > 1 and tried[-1] < tried[0]
    np.testing.assert_array_equal(proof.mesh.points, before)
    assert proof.proved <= ERROR


def test_costs_of_triangles_agree_with_the_slow_twin(coarse):
    work, _, _ = coarse
    flatten(work)
    mesh, alive = work.to_mesh()
    rng = np.random.default_rng(0)
    embedded = rng.normal(size=(len(work.state[4]), 3))
    embedded /= np.linalg.norm(embedded, axis=1)[:, None]
    for sigma2, floor, floor3 in ((0.0, 25.0, 25.0), (0.04, 40.0, 30.0)):
        costs, slacks = np.empty(len(alive)), np.empty(len(alive))
        measure_shapes(work.state, alive, (sigma2, floor, floor3, 1.0), embedded, costs, slacks)
        own = embedded[work.kept()]
        for face, cost, slack in zip(mesh.faces, costs, slacks, strict=True):
            expected = slow_shape(mesh.points[face], own[face], sigma2, floor, floor3)
            assert (cost, slack) == pytest.approx(expected, rel=1e-4)


def test_triangles_stray_where_their_bound_says_so():
    """Against the bounds of `meshes.distance_bound`; triangles near a sphere, some too far."""
    sphere = icosphere(3)
    work = BoundedMesh(sphere, 0.1)
    rng = np.random.default_rng(3)
    pieces, nodes, squares = np.empty((MOST_WAITING + 4, 10)), np.empty(STACK, np.int32), None
    squares = np.empty(STACK + 6)
    middle = rng.normal(size=(60, 1, 3))
    corners = middle / np.linalg.norm(middle, axis=2)[:, :, None]
    corners = corners + 0.25 * rng.normal(size=(60, 3, 3))
    faces = np.arange(180).reshape(60, 3)
    mesh = type(sphere)(corners.reshape(-1, 3), faces)
    bounds = face_bounds(mesh, ClosestPoint(sphere.points, sphere.faces))
    found = []
    for triangle, upper, lower in zip(corners, bounds.upper, bounds.lower, strict=True):
        star = np.zeros((1, 22))
        star[0, :3] = triangle[0]
        star[0, 3:9] = (triangle[1:] - triangle[0]).ravel()
        for limit, expected in ((1.02 * upper, False), (0.98 * lower, True)):
            found.append(
                strays(star, 0, limit**2, 0, work.reference, nodes, squares, pieces) == expected
            )
    assert all(found)
