"""Limits of edge lengths, gradation, and shapes that the vertices' normals do not tell of."""

import numpy as np
import pytest

from meshes import InvalidCase
from meshes.edges import edge_table
from meshes.features import find_features
from meshes.quality import face_areas, signed_volume
from meshes.self_intersection import self_intersecting_faces
from meshes.topology import topology
from remesh import RemeshSettings, remesh
from remesh.carrier import make_carrier
from remesh.connectivity import HINT
from remesh.dense import refined, with_hidden_shapes
from remesh.guard import sized_length
from remesh.sizing import Sizing, graded, relative_sizes
from tests.remesh.shapes import bump, cylinder, hemisphere, jittered, revolved
from tests.remesh.test_bounded import Ear
from tests.shapes import TorusSurface, cube, icosphere, torus


def edge_lengths(mesh):
    ends = mesh.points[edge_table(mesh.faces).edges]
    return np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)


def triangle_sizes(mesh):
    """Edges of equilateral triangles with the triangles' areas."""
    return np.sqrt(4.0 / np.sqrt(3.0) * face_areas(mesh.points, mesh.faces))


def test_grading_agrees_with_all_pairs_of_distances():
    mesh = jittered(icosphere(2), 0.2, 0)
    table = edge_table(mesh.faces)
    steps = edge_lengths(mesh)
    sizes = np.random.default_rng(0).uniform(0.1, 2.0, len(mesh.points))
    distance = np.full((len(sizes), len(sizes)), np.inf)
    np.fill_diagonal(distance, 0.0)
    for (a, b), step in zip(table.edges, steps, strict=True):
        distance[a, b] = distance[b, a] = step
    for k in range(len(sizes)):
        distance = np.minimum(distance, distance[:, k, None] + distance[k])
    for growth in (0.1, 0.7):
        expected = (sizes + growth * distance).min(axis=1)
        found = graded(sizes, table.edges, steps, growth)
        np.testing.assert_allclose(found, expected, rtol=1e-12)
        slope = np.abs(found[table.edges[:, 0]] - found[table.edges[:, 1]]) / steps
        assert slope.max() == pytest.approx(growth) and (found <= sizes).all()


def test_sizes_of_a_torus_are_those_of_its_curvatures():
    """The metric's determinant is (1 + sigma^2 kappa_1^2) (1 + sigma^2 kappa_2^2)."""
    surface, sigma = TorusSurface(major=1.0, minor=0.3), 0.4
    mesh = torus(n_major=96, n_minor=48)
    normals = surface.gradient(mesh.points)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    ring = np.hypot(mesh.points[:, 0], mesh.points[:, 1])
    around = (ring - surface.major) / surface.minor / ring
    density = (1 + (sigma / surface.minor) ** 2) * (1 + (sigma * around) ** 2)
    found = relative_sizes(mesh, normals[mesh.faces], sigma)
    np.testing.assert_allclose(found, density**-0.25, rtol=0.01)


def slow_length(work, a, b, sigma, limits, threshold):
    """`guard.sized_length`, by cases."""
    step = work.rows[a, :6] - work.rows[b, :6]
    length3 = np.linalg.norm(step[:3])
    length = np.sqrt(length3**2 + sigma**2 * (step[3:] ** 2).sum())
    scales, shortest, longest = limits
    scale = 0.5 * (scales[work.links[a, HINT]] + scales[work.links[b, HINT]])
    length = max(length, threshold * length3 / longest) * scale
    if length3 < shortest:
        length = min(length, threshold * length3 / shortest)
    return max(length, threshold * length3 / longest)


def test_sized_lengths_agree_with_the_slow_twin():
    from remesh.halfedge import WorkMesh

    work = WorkMesh(make_carrier(jittered(icosphere(2), 0.3, 1)))
    rng = np.random.default_rng(1)
    scales = rng.uniform(1.0, 3.0, len(work.labels))
    first, last = work.edge_rows()
    threshold, cases = 0.4, set()
    for shortest, longest in ((0.0, np.inf), (0.32, np.inf), (0.0, 0.3), (0.28, 0.34), (0.4, 0.2)):
        for a, b in zip(first[:60], last[:60], strict=True):
            sizing = (scales, shortest**2, longest**2)
            found = sized_length(work.rows, work.links, a, b, 0.09, sizing, threshold**2)
            expected = slow_length(work, a, b, 0.3, (scales, shortest, longest), threshold)
            assert np.sqrt(found) == pytest.approx(expected, rel=1e-12)
            length3 = np.linalg.norm(work.rows[a, :3] - work.rows[b, :3])
            if length3 > longest:
                assert expected > threshold
            elif length3 < shortest:
                assert expected < threshold
            cases.add((length3 > longest, length3 < shortest))
    assert len(cases) == 4
    plain = sized_length(work.rows, work.links, 0, 1, 0.09, (scales[:0], 0.0, np.inf), 1.0)
    step = work.rows[0, :6] - work.rows[1, :6]
    assert plain == pytest.approx((step[:3] ** 2).sum() + 0.09 * (step[3:] ** 2).sum())


WAYS = {
    "vertices": {"vertices": 700},
    "edge length": {"edge_length": 0.16},
    "error": {"max_error": 0.01},
}


@pytest.mark.parametrize("way", list(WAYS))
@pytest.mark.parametrize("name", ["torus", "cylinder", "cube"])
def test_no_edge_is_longer_than_asked(name, way):
    mesh = {"torus": torus(), "cylinder": cylinder(), "cube": cube()}
    mesh = find_features(mesh[name])
    limit = 0.13
    settings = RemeshSettings(**WAYS[way], sigma=0.2 * (way != "error"), max_length=limit)
    result = remesh(mesh, settings=settings)
    found = topology(result.mesh.faces, len(result.mesh.points))
    assert found.watertight and found.oriented
    assert edge_lengths(result.mesh).max() <= limit * (1 + 1e-12)
    assert not self_intersecting_faces(result.mesh.points, result.mesh.faces).any()
    assert result.statistics.inverted_faces == 0
    assert signed_volume(result.mesh) == pytest.approx(signed_volume(mesh), rel=0.01)
    if way == "error":
        assert result.statistics.proved_distance <= 0.01


@pytest.mark.parametrize("gradation", [None, 1.3])
def test_edges_are_not_shorter_than_asked_but_where_they_must_be(gradation):
    """On a torus with a large sigma the edges around the tube get short; none has to."""
    mesh, limit = torus(n_major=64, n_minor=32), 0.09
    short = []
    for least in (0.0, limit):
        settings = RemeshSettings(vertices=700, sigma=0.6, min_length=least, gradation=gradation)
        result = remesh(mesh, settings=settings)
        short.append(np.mean(edge_lengths(result.mesh) < 0.999 * limit))
        assert abs(len(result.mesh.points) - 700) <= 0.05 * 700
        assert topology(result.mesh.faces, len(result.mesh.points)).genus == 1
    assert short[0] > 0.02 and short[1] < 0.25 * short[0]


def test_the_count_is_met_within_limits_that_leave_room():
    mesh = icosphere(4)
    mean = np.sqrt(8.0 * np.pi / (np.sqrt(3.0) * 600))
    settings = RemeshSettings(
        vertices=600, min_length=0.5 * mean, max_length=2.0 * mean, gradation=1.5
    )
    found = remesh(mesh, settings=settings)
    assert found.statistics.vertices == pytest.approx(600, rel=0.02)
    tight = remesh(mesh, settings=RemeshSettings(vertices=600, max_length=0.8 * mean))
    assert tight.statistics.vertices > 900


def radial_sizes(mesh):
    """Medians of the triangles' sizes in rings around the z axis."""
    middle = mesh.points[mesh.faces].mean(axis=1)
    radius = np.hypot(middle[:, 0], middle[:, 1])
    sizes = triangle_sizes(mesh)
    rings = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
    number = np.digitize(radius, rings)
    return 0.5 * (rings[:-1] + rings[1:]), np.array(
        [np.median(sizes[number == k]) for k in range(1, len(rings))]
    )


@pytest.mark.parametrize("way", ["vertices", "edge length"])
def test_gradation_lets_triangles_grow_slowly_away_from_a_bump(way):
    """From the bump's foot on by no more than gradation - 1 times the way, and they do grow."""
    mesh = bump()
    ask = {"vertices": {"vertices": 1500}, "edge length": {"edge_length": 0.15}}[way]
    for gradation in (None, 1.3, 1.15):
        result = remesh(mesh, settings=RemeshSettings(**ask, sigma=1.0, gradation=gradation)).mesh
        radius, sizes = radial_sizes(result)
        allowed = sizes[1] + ((gradation or 1.3) - 1.0) * (radius - radius[1])
        if gradation is None:
            assert sizes[2] > 1.3 * allowed[2]
        else:
            assert (sizes[1:] < 1.25 * allowed[1:]).all()
        assert sizes[-1] > 2.5 * sizes[1]


def test_gradation_holds_within_faces_larger_than_the_field_needs():
    """A cube of 12 triangles: its field is made on finer ones, as on a fine cube."""
    sizes = []
    for mesh in (cube(), refined(cube(), 0.1)):
        settings = RemeshSettings(vertices=400, gradation=1.2, max_length=0.3)
        result = remesh(find_features(mesh), settings=settings).mesh
        sizes.append(np.sort(triangle_sizes(result))[[10, len(result.faces) // 2, -10]])
    np.testing.assert_allclose(sizes[0], sizes[1], rtol=0.15)


def test_fields_are_made_anew_only_for_another_length():
    sizing = Sizing(make_carrier(bump()), 0.4, 1.2, 0.01, 0.2)
    sizing.aim(0.1)
    before = sizing.scales
    sizing.aim(0.101)
    assert sizing.scales is before and before.min() == pytest.approx(1.0) and before.max() > 1.5
    sizing.aim(0.15)
    assert sizing.scales is not before


@pytest.mark.parametrize("fix_boundary", [False, True])
def test_refined_meshes_are_the_same_surface(fix_boundary):
    for mesh in (find_features(cube()), cylinder(), hemisphere(1)):
        fine = refined(mesh, 0.21, fix_boundary)
        table = edge_table(fine.faces)
        inner = table.count == 2
        held = fix_boundary and not inner.all()
        assert np.quantile(edge_lengths(fine), 0.8 if held else 1.0) <= 0.21
        assert face_areas(fine.points, fine.faces).sum() == pytest.approx(
            face_areas(mesh.points, mesh.faces).sum(), rel=1e-12
        )
        for label in range(len(mesh.labels)):
            areas = [face_areas(m.points, m.faces)[m.face_labels == label] for m in (mesh, fine)]
            assert areas[0].sum() == pytest.approx(areas[1].sum(), rel=1e-12)
        assert topology(fine.faces, len(fine.points)).euler == (
            topology(mesh.faces, len(mesh.points)).euler
        )
        length = [
            np.linalg.norm(np.diff(m.points[m.feature_edges], axis=1)[:, 0], axis=1).sum()
            for m in (mesh, fine)
        ]
        assert length[0] == pytest.approx(length[1], rel=1e-12)
        if fix_boundary and not inner.all():
            assert (~inner).sum() == (edge_table(mesh.faces).count == 1).sum()
        assert refined(fine, 10.0) is fine


@pytest.mark.parametrize("ask", [{"vertices": 500}, {"edge_length": 0.2}], ids=str)
@pytest.mark.parametrize("sigma", [0.0, 0.2])
def test_an_ear_between_vertices_is_seen_whatever_is_asked_for(ask, sigma):
    """The thesis's 4.2.1: the normals, and S, at all vertices are those of a plain sphere."""
    sphere = icosphere(1)
    middle = sphere.points[sphere.faces[7, :2]].sum(axis=0)
    ear = Ear(middle / np.linalg.norm(middle))
    assert np.abs(ear.value(sphere.points)).max() < 2e-3
    result = remesh(sphere, ear, RemeshSettings(**ask, sigma=sigma))
    mesh = result.mesh
    assert np.linalg.norm(mesh.points, axis=1).max() > 1.14
    assert np.abs(ear.value(mesh.points[mesh.faces].mean(axis=1))).max() < 0.04
    assert result.statistics.inverted_faces == result.statistics.self_intersecting_faces == 0


def test_nothing_is_hidden_in_a_sphere():
    sphere = icosphere(1)
    plain = Ear(np.array([0.0, 0.0, 1.0]), height=0.0)
    normals = sphere.points[sphere.faces]
    assert with_hidden_shapes(sphere, normals, [plain], 0.2) is sphere


def test_an_edge_length_far_above_the_inputs_is_met():
    """A slab with thin triangles at its poles, that a target led by the mean edge ran away from."""
    radius = [*np.linspace(0.0, 0.95, 30), *(0.95 + 0.05 * np.sin(np.linspace(0.2, 1.57, 8)))]
    height = [*np.zeros(30), *(0.05 - 0.05 * np.cos(np.linspace(0.2, 1.57, 8)))]
    profile = list(zip(radius, height, strict=True))
    profile += [(r, 1.0 - z) for r, z in profile[::-1]]
    mesh = revolved(profile, 96)
    result = remesh(mesh, settings=RemeshSettings(edge_length=0.3, sigma=0.3))
    assert 0.2 < result.statistics.edge_length < 0.45
    assert 0.15 < np.median(triangle_sizes(result.mesh)) < 0.4


@pytest.mark.parametrize(
    "options",
    [
        {"gradation": 1.0},
        {"gradation": float("nan")},
        {"min_length": -1.0},
        {"min_length": 2.0, "max_length": 1.0},
        {"max_length": 0.0},
        {"max_length": 1.0, "algorithm": "thesis"},
        {"gradation": 1.3, "algorithm": "thesis"},
    ],
    ids=str,
)
def test_bad_sizing_is_refused(options):
    with pytest.raises(InvalidCase):
        RemeshSettings(**options)
