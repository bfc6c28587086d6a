"""The same from every side: moved surfaces give moved results, and nothing given is lost."""

import numpy as np
import pytest

from meshes import Patch, TriMesh
from meshes.features import find_features
from remesh import RemeshSettings, TriangleSurface, remesh
from remesh.dense import refined
from remesh.frame import GRID, framed, own_frame
from tests.remesh.shapes import hemisphere, jittered, revolved, rotation
from tests.shapes import cube, icosphere, torus

SIZE = 2.0  # of the part, about


def part():
    """A closed surface without symmetries: a bent, swollen drum with creases and two flat ends."""
    drum = find_features(revolved([(0, 0), *((1, h) for h in np.linspace(0, 2, 8)), (0, 2)], 24))
    x, y, z = drum.points.T
    swollen = 1.0 + 0.3 * np.sin(1.3 * z + 0.4) * np.minimum(z, 2 - z)
    points = np.stack([swollen * x * (1 + 0.2 * y) + 0.15 * z, 0.8 * swollen * y, z], axis=1)
    return find_features(TriMesh(points, drum.faces))


def moved(mesh, scale, turn, shift):
    """The plain mesh scaled, turned and shifted, its features found anew."""
    return find_features(TriMesh(scale * (mesh.points @ turn.T) + shift, mesh.faces))


MOTIONS = {
    "turned": (1.0, rotation(1), np.zeros(3)),
    "a quarter": (1.0, np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), 0.0),
    "scaled": (0.7, np.eye(3), np.zeros(3)),
    "shifted": (1.0, np.eye(3), np.array([3.0, -5.0, 4.0])),
    "all": (130.0, rotation(2), np.array([300.0, 100.0, -200.0])),
}
ASKS = {
    "creases": {"vertices": 250, "sigma": 0.15},
    "lengths": {"edge_length": 0.4, "max_length": 0.5, "gradation": 1.3},
    "smoothed": {"vertices": 200, "smoothing": 4},
}


@pytest.fixture(scope="module")
def plain():
    """What every ask makes of the part as it lies."""
    source = part()
    return {name: remesh(source, settings=RemeshSettings(**ask)) for name, ask in ASKS.items()}


@pytest.mark.parametrize(
    ("motion", "ask"),
    [*((motion, "creases") for motion in MOTIONS), ("all", "lengths"), ("all", "smoothed")],
)
def test_a_moved_surface_gives_the_moved_result(plain, motion, ask):
    scale, turn, shift = MOTIONS[motion]
    lengths = {
        name: value * (scale if name in ("sigma", "edge_length", "max_length") else 1)
        for name, value in ASKS[ask].items()
    }
    source = moved(part(), scale, turn, shift)
    result = remesh(source, TriangleSurface(source), RemeshSettings(**lengths))
    first = plain[ask]
    np.testing.assert_array_equal(result.mesh.faces, first.mesh.faces)
    np.testing.assert_array_equal(result.mesh.feature_edges, first.mesh.feature_edges)
    expected = scale * (first.mesh.points @ turn.T) + shift
    np.testing.assert_allclose(result.mesh.points, expected, rtol=0, atol=1e-11 * SIZE * scale)
    assert result.statistics.sigma == lengths.get("sigma", 0.0)
    length = scale * first.statistics.edge_length
    assert result.statistics.edge_length == pytest.approx(length, rel=1e-9)
    assert result.statistics.volume_drift == pytest.approx(first.statistics.volume_drift, abs=1e-9)


def test_results_differ_where_the_shape_does(plain):
    """So that the test above compares more than nothing."""
    other = part()
    other = find_features(TriMesh(other.points * [1.0, 1.0, 1.001], other.faces))
    faces = remesh(other, settings=RemeshSettings(**ASKS["creases"])).mesh.faces
    assert not np.array_equal(faces, plain["creases"].mesh.faces)


def without_axes():
    """Surfaces whose principal moments are equal, or that are their own mirror images."""
    sphere = icosphere(2)
    return {
        "sphere": sphere,
        "cube": cube(),
        "torus": torus(n_major=12, n_minor=8),
        "ellipsoid": sphere.with_points(sphere.points * [1.0, 1.5, 2.2]),
    }


@pytest.mark.parametrize("name", list(without_axes()))
def test_surfaces_without_axes_of_their_own_go_by_the_order_of_their_faces(name):
    shape, turn = without_axes()[name], rotation(3)
    first = framed(shape)
    other = framed(shape.with_points(0.3 * (shape.points @ turn.T) + 1.0))
    np.testing.assert_allclose(first.frame.axes @ first.frame.axes.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(first.frame.axes) == pytest.approx(1.0)
    np.testing.assert_allclose(other.frame.axes @ turn, first.frame.axes, atol=1e-13)
    np.testing.assert_array_equal(first.mesh.points, other.mesh.points)


def test_axes_are_the_principal_ones():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(500, 3)) * [1.0, 1.1, 2.0] @ rotation(5)
    frame = own_frame(TriMesh(points, np.arange(498).reshape(-1, 3)))
    inside = frame.coordinates(points)
    assert np.abs(inside.mean(axis=0)).max() < 2e-15
    moments = inside.T @ inside / len(points)
    assert np.trace(moments) == pytest.approx(1.0, abs=1e-14)
    assert np.abs(moments - np.diag(np.diag(moments))).max() < 1e-14
    assert (np.diff(np.diag(moments)) > 0.0).all()
    assert ((inside[:, :2] ** 3).mean(axis=0) > 0.0).all()
    assert np.linalg.det(frame.axes) == pytest.approx(1.0)


def test_no_frame_without_extent():
    assert own_frame(TriMesh(np.ones((3, 3)), [[0, 1, 2]])) is None


def test_points_without_a_face_count_for_nothing():
    shape = part()
    more = np.concatenate([shape.points, [[np.nan, 0.0, 1e9]]])
    lost = TriMesh(more, shape.faces, shape.face_labels, shape.labels, shape.feature_edges)
    np.testing.assert_array_equal(framed(lost).mesh.points, framed(shape).mesh.points)


def test_planes_stay_planes(plain):
    """Across an axis to the last bit, others to the last digit."""
    flat = 0
    for scale, turn, shift in (MOTIONS["shifted"], MOTIONS["all"]):
        source = moved(part(), scale, turn, shift)
        result = remesh(source, settings=RemeshSettings(**ASKS["creases"])).mesh
        for label, patch in enumerate(result.labels):
            assert patch is source.labels[label]
            if patch.plane is not None:
                points = result.points[np.unique(result.faces[result.face_labels == label])]
                flat += 1
                assert np.abs(patch.plane.signed_distance(points)).max() < 1e-14 * scale * 500
    assert flat == 4


def test_cuts_across_an_axis_stay_exact():
    """A boundary in a plane that no label tells of."""
    shape = hemisphere(3)
    tilted = shape.points * [1.0, 1.2, 1.5] + [0.1, 0.0, 0.3]
    source = shape.with_points(tilted + np.outer(tilted[:, 2] - 0.3, [0.2, 0.1, 0.0]))
    low = np.isclose(source.points[:, 2], 0.3, atol=1e-12, rtol=0)
    points = source.points.copy()
    points[low, 2] = 0.3
    source = source.with_points(points)
    result = remesh(source, settings=RemeshSettings(vertices=150)).mesh
    rim = result.points[np.unique(result.feature_edges)]
    given = np.count_nonzero(low)
    assert 0.3 * given < np.count_nonzero(rim[:, 2] == 0.3)
    assert (np.abs(rim[:, 2] - 0.3) > 1e-6).sum() + (rim[:, 2] == 0.3).sum() == len(rim)


def test_a_fixed_boundary_is_the_same_bit_by_bit():
    shape = jittered(hemisphere(3), 0.1, 2)
    source = shape.with_points(shape.points * [1.0, 1.2, 1.5] @ rotation(4).T + 0.1)
    for vertices in (120, 500):
        settings = RemeshSettings(vertices=vertices, fix_boundary=True)
        result = remesh(source, settings=settings).mesh
        before = TriangleSurface(source).carrier.mesh
        rim = before.points[np.unique(before.feature_edges)]
        after = result.points[np.unique(result.feature_edges)]
        assert {p.tobytes() for p in rim} == {p.tobytes() for p in after}


def test_a_fixed_boundary_comes_before_the_plane_it_nearly_lies_in():
    s = np.linspace(0.0, 1.0, 9)
    x, y = (grid.ravel() for grid in np.meshgrid(s, s**1.1))
    rng = np.random.default_rng(1)
    points = np.stack([x, 0.7 * y, rng.uniform(-1e-6, 1e-6, len(x))], axis=1) @ rotation(6).T
    low = (np.arange(8)[:, None] + 9 * np.arange(8)).ravel()
    faces = np.stack([low, low + 1, low + 10, low, low + 10, low + 9], axis=1).reshape(-1, 3)
    sheet = find_features(TriMesh(points, faces))
    assert sheet.labels[0].plane is not None
    for hold in (True, False):
        settings = RemeshSettings(vertices=100, fix_boundary=hold)
        result = remesh(sheet, settings=settings).mesh
        rim = {p.tobytes() for p in points[np.unique(sheet.feature_edges)]}
        kept = rim & {p.tobytes() for p in result.points[np.unique(result.feature_edges)]}
        assert len(kept) == (len(rim) if hold else 0)
        off = np.abs(sheet.labels[0].plane.signed_distance(result.points))
        assert off.max() < (2e-6 if hold else 1e-15)


def test_what_rounding_took_is_given_back():
    """Points made on the copy's faces are on the given ones."""
    shape = part()
    inside = framed(shape)
    assert np.abs(inside.rest).max() <= 0.5 * GRID
    assert np.abs(inside.rest).max() > 0.4 * GRID
    rng = np.random.default_rng(0)
    weights = rng.dirichlet([1.0, 1.0, 1.0], size=len(shape.faces))
    faces = np.arange(len(shape.faces))
    made = np.einsum("fk,fki->fi", weights, inside.mesh.points[inside.mesh.faces])
    apart = TriMesh(made, np.arange(len(made) // 3 * 3).reshape(-1, 3))
    smooth = TriMesh(shape.points, shape.faces, labels=(Patch("whole"),))
    back = framed(smooth).restored(apart, (faces, weights), False)
    expected = np.einsum("fk,fki->fi", weights, shape.points[shape.faces])
    np.testing.assert_allclose(back.points, expected, rtol=0, atol=1e-14)


def test_faces_are_cut_alike_in_the_frame_and_where_they_are():
    shape = part()
    inside = framed(shape)
    cut = inside.refined(0.2, False)
    assert (
        np.linalg.norm(np.diff(cut.mesh.points[cut.mesh.faces[:, :2]], axis=1), axis=2).max() < 0.2
    )
    again = refined(shape, 0.2 * inside.frame.size)
    np.testing.assert_array_equal(cut.given.faces, again.faces)
    np.testing.assert_array_equal(cut.given.feature_edges, again.feature_edges)
    np.testing.assert_allclose(cut.given.points, again.points, rtol=0, atol=1e-14)
    assert cut.given.labels == shape.labels


def test_lengths_are_measured_by_the_frame():
    frame = own_frame(icosphere(2, radius=3.0))
    settings = frame.settings(RemeshSettings(vertices=100, sigma=0.6, max_length=1.5))
    assert frame.size == pytest.approx(3.0)
    assert (settings.sigma, settings.max_length) == pytest.approx((0.2, 0.5))
    assert (settings.min_length, settings.edge_length, settings.vertices) == (0.0, None, 100)
    assert frame.settings(RemeshSettings(sigma=0.6)).max_length == np.inf
    nearly = frame.settings(RemeshSettings(vertices=100, sigma=0.6 * (1 + 1e-15)))
    assert nearly.sigma == settings.sigma
