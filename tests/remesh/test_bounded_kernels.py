"""The kernels of the error bound, each beside its slow twin."""

import numpy as np
import pytest

from meshes.closest_point_kernels import FAR, STACK
from meshes.quality import corner_normals, face_normals
from meshes.topology import topology
from remesh.bounded import BoundLimits
from remesh.bounded_collapse import (
    collapse_within,
    has_three,
    link_allows,
    lowest_point,
    quadric_at,
)
from remesh.bounded_insert import closest_corner_weights, insert_points
from remesh.bounded_kernels import (
    MOST_STAR,
    STAR_WIDTH,
    agreement_with,
    closest_in_star,
    fill_fan,
    fill_star,
    gather,
    least_sine,
    measure,
    nearest_curve,
    ring_of,
    segment_square,
    turn_between,
)
from remesh.bounded_mend import untangle
from remesh.bounded_mesh import BoundedMesh
from remesh.bounded_original import (
    LEAST_COSINE,
    inverted_count,
    leaves_original,
    place_near,
    turned_against,
    wrong_count,
)
from remesh.bounded_proof import BoundProof
from remesh.bounded_relax import best_move, fill_flipped, flip, joined, relax_within, solve_three
from remesh.layout import make_layout
from tests.remesh import reference_bounded as reference
from tests.remesh.shapes import cylinder, hemisphere, jittered
from tests.shapes import icosphere, torus


def triangle_row(corners):
    """A star of one triangle (3, 3)."""
    star, fan = np.zeros((1, STAR_WIDTH)), np.array([[0, 0, 1, 0, 0, 0]])
    fill_star(np.ascontiguousarray(corners[1:]), fan, 1, np.ascontiguousarray(corners[0]), star)
    return star


@pytest.mark.parametrize("flatness", [1.0, 1e-3, 1e-7, 0.0])
def test_distances_from_triangles_of_a_star(flatness):
    rng = np.random.default_rng(1)
    for _ in range(60):
        corners = rng.normal(size=(3, 3))
        corners[2] = corners[0] + 0.4 * (corners[1] - corners[0]) + flatness * corners[2]
        point = rng.normal(size=3)
        nearest = reference.closest_on_thin_triangle(point, corners)
        expected = np.sum((point - nearest) ** 2)
        star = triangle_row(corners)
        assert closest_in_star(*point, star, 0, FAR) == pytest.approx(expected, rel=1e-6)
        assert closest_in_star(*point, star, 0, 1.01 * expected) == pytest.approx(
            expected, rel=1e-6
        )
        limited = closest_in_star(*point, star, 0, 0.5 * expected)
        assert limited == FAR or limited == pytest.approx(expected, rel=1e-6)


def test_shapes_agreement_and_turns():
    rng = np.random.default_rng(2)
    for _ in range(20):
        corners, normals = rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
        star = triangle_row(corners)
        sine, longest = least_sine(star, 0)
        expected = reference.height_over_edge(corners)
        assert (sine, longest) == pytest.approx(expected)
        own = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        cosine = own @ normals[0] / np.linalg.norm(own) / np.linalg.norm(normals[0])
        assert agreement_with(normals, 0, star, 0) == pytest.approx(cosine)
        one, two = (n / np.linalg.norm(n) for n in normals)
        assert turn_between(normals, 0, normals, 1) == pytest.approx(np.sum((one - two) ** 2))


def test_distance_from_a_segment():
    rng = np.random.default_rng(3)
    for _ in range(40):
        point, a, b = rng.normal(size=(3, 3))
        nearest = reference.closest_on_thin_triangle(point, np.array([a, b, b]))
        expected = np.sum((point - nearest) ** 2)
        assert segment_square(*point, a, b) == pytest.approx(expected)


def test_quadrics_and_small_systems():
    rng = np.random.default_rng(4)
    normals, offsets = rng.normal(size=(5, 3)), rng.normal(size=5)
    rows = np.concatenate([normals, offsets[:, None]], axis=1)
    matrix = rows.T @ rows
    q = np.zeros(11)
    q[:6] = matrix[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    q[6:9], q[9] = matrix[:3, 3], matrix[3, 3]
    x = rng.normal(size=3)
    assert quadric_at(q, *x) == pytest.approx(np.sum((normals @ x + offsets) ** 2))
    lowest = np.zeros(3)
    lowest_point(q, lowest.copy(), lowest)
    expected = np.linalg.lstsq(normals, -offsets, rcond=None)[0]
    np.testing.assert_allclose(lowest, expected, rtol=2e-2, atol=2e-3)  # but for the pull
    solution = np.zeros(3)
    solve_three(q[:6], x, solution)
    np.testing.assert_allclose(solution, np.linalg.solve(matrix[:3, :3], x), rtol=1e-9)


@pytest.fixture(params=["torus", "cylinder", "hemisphere"])
def work(request):
    """A surface somewhat coarser than its original: closed, with creases, open."""
    source = {
        "torus": jittered(torus(n_major=24, n_minor=12), 0.05, 1),
        "cylinder": cylinder(around=16, rings=8),
        "hemisphere": hemisphere(2),
    }[request.param]
    result = BoundedMesh(make_layout(source).mesh, 0.02)
    collapse_within(result, BoundLimits(0.02))
    return result


def alive_vertices(work):
    return np.flatnonzero(work.state[4][: work.counts[0]] >= 0)


def star_of(work, v):
    """(ring, fan, star) of a vertex where it is, cut to their lengths."""
    _, twin, _, _, first, _, points, _, _ = work.state
    ring, fan = np.empty(MOST_STAR, np.int64), np.zeros((MOST_STAR, 6), np.int64)
    star = np.empty((MOST_STAR, STAR_WIDTH))
    around = ring_of(twin, first, v, ring)
    count = fill_fan(work.state, v, ring, around, -1, fan, 0)
    fill_star(points, fan, count, points[v], star)
    return ring[:around], fan[:count], star[:count]


def test_rings_and_fans(work):
    corners = work.state[0][: 3 * work.counts[1]].reshape(-1, 3)
    for v in alive_vertices(work):
        ring, fan, star = star_of(work, v)
        expected = np.flatnonzero((corners == v).any(axis=1))
        assert sorted(ring // 3) == sorted(fan[:, 0]) == list(expected)
        for row, triangle in zip(fan, star, strict=True):
            k = list(corners[row[0]]).index(v)
            np.testing.assert_array_equal(row[1:3], np.roll(corners[row[0]], -k)[1:])
            a, b, c = work.state[6][[v, row[1], row[2]]]
            np.testing.assert_allclose(triangle[9:12], np.cross(b - a, c - a), atol=1e-14)
        assert has_three(work.state[1], work.state[4], v) == reference.is_lean(corners, v)


def test_links_and_neighbours(work):
    corners = work.state[0][: 3 * work.counts[1]].reshape(-1, 3)
    alive = corners[corners[:, 0] >= 0]
    corner, twin, _, _, first, _, _, _, _ = work.state
    refused = 0
    for h in np.flatnonzero(corner[: 3 * work.counts[1]] >= 0)[::31]:
        u, v = corner[h], corner[h - 2 if h % 3 == 2 else h + 1]
        rings = [star_of(work, w)[0] for w in (u, v)]
        found = link_allows(work.state, h, rings[0], len(rings[0]), rings[1], len(rings[1]))
        assert found == reference.link_allows(alive, u, v)
        refused += not found
        for w in alive_vertices(work)[::7]:
            if w != u:
                assert joined(twin, corner, first, u, w) == reference.joined(alive, u, w)


def test_samples_are_measured_to_the_nearest_triangle(work):
    head, after, place, _, _, _, _ = work.samples
    room = len(place)
    pool, found = np.empty(room, np.int64), np.empty(room, np.int64)
    for v in alive_vertices(work)[::3]:
        _, fan, star = star_of(work, v)
        filled = 0
        for face in fan[:, 0]:
            filled = gather(head, after, face, pool, filled)
        listed = [s for face in fan[:, 0] for s in reference.listed(head, after, face)]
        assert list(pool[:filled]) == listed
        hub = work.state[6][v].copy()
        total = measure(
            work.state, work.samples, fan, star, len(fan), hub, pool, filled, 1e-4, -1.0, found
        )
        expected, nearest = reference.measure(work, v, fan, listed, 1e-4)
        if expected is None:
            assert total == -1.0
            continue
        assert total == pytest.approx(expected, rel=1e-9, abs=1e-12)
        for s in listed:  # of equally near triangles any
            assert nearest[s][found[s]] <= min(nearest[s].values()) + 1e-12


def test_nearest_curves(work):
    rng, seen = np.random.default_rng(5), 0
    for v in alive_vertices(work)[::2]:
        _, fan, star = star_of(work, v)
        hub = work.state[6][v].copy()
        point = hub + 0.1 * rng.normal(size=3)
        best, square = nearest_curve(work.state[6], fan, star, len(fan), *point, hub)
        expected = reference.nearest_curve(work, v, fan, point)
        seen += best >= 0
        assert square == pytest.approx(expected) if best >= 0 else expected is None
    assert seen > 0 or len(work.source.feature_edges) == 0


def test_the_original_is_near_and_looks_the_same_way(work):
    """Of stars as they are, and pushed around: far, inverted, or neither."""
    source, rng, limit = work.source, np.random.default_rng(6), 0.05
    normals = corner_normals(source)
    nodes, squares = np.empty(STACK, np.int32), np.empty(STACK)
    seen = np.zeros(3, int)
    for v in alive_vertices(work)[::50]:
        for size in (0.0, 0.1, 0.3):
            _, fan, star = star_of(work, v)
            x = work.state[6][v] + size * rng.normal(size=3)
            fill_star(work.state[6], fan, len(fan), x, star)
            corners = reference.star_corners(work, x, fan)
            answers = [reference.inverted(source, normals, c) for c in corners]
            t = place_near(*x, -1.0, 0, work.reference, nodes, squares)[0]
            room = (t, work.reference, nodes, squares)
            inverted = inverted_count(star, len(fan), *room)
            assert inverted <= sum(True in a for a in answers)
            if size < 0.2:  # else the way may end at a nearby normal that agrees
                assert inverted >= sum(False not in a for a in answers)
            far = [reference.farthest(source, c) > limit for c in corners]
            wrong = wrong_count(star, len(fan), limit**2, *room)
            assert sum(far) <= wrong
            assert wrong <= sum(f or True in a for f, a in zip(far, answers, strict=True))
            inside = max(reference.farthest_inside(source, c) for c in corners) > limit
            leaves = leaves_original(star, len(fan), x, limit**2, *room)
            assert leaves or not (inside or inverted)
            assert not leaves or inside or any(True in a for a in answers)
            seen += [inverted > 0, sum(far) > 0, wrong == 0]
    assert (seen > 0).all()


def test_turned_against_the_interpolated_normal_or_the_triangles_own():
    rng, seen = np.random.default_rng(11), np.zeros((2, 2), int)
    for _ in range(200):
        own, corners = rng.normal(size=3), rng.normal(size=(3, 3))
        flat = np.zeros((1, 12))
        flat[0, 9:] = own
        v, w = rng.dirichlet(np.ones(3))[:2]
        star = triangle_row(rng.normal(size=(3, 3)))
        normal, smooth = star[0, 9:12], np.array([1.0 - v - w, v, w]) @ corners
        least = LEAST_COSINE * np.linalg.norm(smooth) * np.linalg.norm(normal)
        against = normal @ own < 0.0, normal @ smooth < least
        reference_ = ((flat, flat, flat, flat), flat, corners.reshape(1, 9))
        assert turned_against(star, 0, 0, v, w, reference_) == any(against)
        seen[against[0] * 1, against[1] * 1] += 1
    assert (seen > 10).all()


def test_a_move_fits_the_samples_best(work):
    head, after, place, _, _, _, _ = work.samples
    room = len(place)
    pool, found, step = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(3)
    moved = 0
    for v in alive_vertices(work)[::12]:
        _, fan, star = star_of(work, v)
        filled = 0
        for face in fan[:, 0]:
            filled = gather(head, after, face, pool, filled)
        hub = work.state[6][v].copy()
        measure(work.state, work.samples, fan, star, len(fan), hub, pool, filled, FAR, -1.0, found)
        if best_move(work.samples, star, pool, filled, found, 1e-3, step, np.empty(9)):
            corners = reference.star_corners(work, hub, fan)
            expected = reference.best_move(work, corners, pool[:filled], found, 1e-3)
            np.testing.assert_allclose(step, expected, rtol=1e-7, atol=1e-10)
            moved += 1
    assert moved > 0


def test_flips_keep_the_bookkeeping(work):
    corner, twin, crease, _, first, _, _, _, _ = work.state
    fan, flipped = np.zeros((2, 6), np.int64), 0
    for h in range(0, 3 * work.counts[1], 5):
        if corner[h] < 0 or twin[h] < 0 or crease[h] == 1:
            continue
        g = twin[h]
        a, b, c, d = (corner[k] for k in (h, g, h + 2 - 3 * (h % 3 > 0), g + 2 - 3 * (g % 3 > 0)))
        if c == d or joined(twin, corner, first, c, d):
            continue
        fill_flipped(work.state, h, fan)
        faces = flip(work.state, h)
        for face, expected, row in zip(faces, ({c, d, b}, {d, c, a}), fan, strict=True):
            assert set(corner[3 * face : 3 * face + 3]) == expected
            assert row[0] == face and set(row[1:3]) < expected
        flipped += 1
    assert flipped > 5
    assert reference.broken_bounded(work) == []


def test_every_operation_keeps_the_bookkeeping(work):
    limits, rng = BoundLimits(0.02), np.random.default_rng(7)
    assert reference.broken_bounded(work) == []
    before = topology(*faces_of(work.source))
    alive = np.flatnonzero(work.state[0][: 3 * work.counts[1] : 3] >= 0)
    chosen = rng.choice(alive, len(alive) // 3, replace=False)
    corners = work.state[6][work.state[0].reshape(-1, 3)[chosen]]
    weights = rng.dirichlet(np.ones(3), len(chosen))
    places = np.einsum("nk,nkd->nd", weights, corners)
    assert insert_points(work, chosen, places, places, places, limits) > 0
    for change in (
        lambda: relax_within(work, limits),
        lambda: collapse_within(work, limits),
        lambda: untangle(work, chosen[work.state[0][3 * chosen] >= 0], limits),
    ):
        assert reference.broken_bounded(work) == []
        change()
    assert reference.broken_bounded(work) == []
    after = topology(*faces_of(work.to_mesh()[0]))
    assert (after.genus, after.boundary_loops) == (before.genus, before.boundary_loops)


def faces_of(mesh):
    return mesh.faces, len(mesh.points)


def test_weights_of_the_closest_point():
    rng = np.random.default_rng(8)
    for _ in range(30):
        points, place = rng.normal(size=(3, 3)), rng.normal(size=3)
        weights = closest_corner_weights(points, 0, 1, 2, place, np.empty(12))
        np.testing.assert_allclose(
            np.array(weights) @ points, reference.closest_on_thin_triangle(place, points), atol=1e-9
        )


def test_inverted_triangles_are_mended():
    """One vertex of a coarse sphere is pulled over its neighbours; nothing else is wrong."""
    work, limits = BoundedMesh(icosphere(4), 0.2), BoundLimits(0.2)
    collapse_within(work, BoundLimits(0.01))
    _, fan, _ = star_of(work, alive_vertices(work)[20])
    v, points = alive_vertices(work)[20], work.state[6]
    away = points[fan[0, 1]] - points[v]
    points[v] += 1.5 * away
    points[v] /= np.linalg.norm(points[v])
    proof = BoundProof(work, limits)
    proof.renew()
    wrong = proof.alive[proof.against()]
    mesh = proof.mesh
    outward = np.einsum("nd,nd->n", face_normals(*(mesh.points, mesh.faces)),
                        mesh.points[mesh.faces].mean(axis=1)) > 0.0  # fmt: skip
    np.testing.assert_array_equal(proof.against(), ~outward)
    assert len(wrong) > 0
    for turn in range(3):
        untangle(work, proof.alive[proof.against()], limits, turn % 2 == 1)
        proof.renew()
    assert not proof.against().any() and not proof.inverted().any()
