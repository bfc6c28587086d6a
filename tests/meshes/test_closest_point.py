"""Closest points against brute force and closed forms, on good and on awkward triangles."""

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshes import InvalidMesh, TriMesh
from meshes.box_tree import build_tree
from meshes.box_tree_kernels import select
from meshes.closest_point import ClosestPoint, sample_surface, two_sided_distance
from meshes.closest_point_kernels import FAR, closest_on_triangle
from tests import shapes
from tests.meshes import reference
from tests.meshes.reference import closest_distance, distance_to_segment


def check_against_pairs(points, faces, queries, tolerance=1e-12, hints=None):
    """Distances agree with brute force, and the points reported have that distance."""
    points = np.asarray(points, float)
    found, weights, distance = ClosestPoint(points, faces).query(queries, hints)
    expected = closest_distance(queries, points[faces])
    size = np.abs(points).max() + np.abs(queries).max()
    np.testing.assert_allclose(distance, expected, rtol=0, atol=tolerance * size)
    assert weights.min() >= -1e-12
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    reached = np.einsum("ij,ijk->ik", weights, points[np.asarray(faces)[found]])
    np.testing.assert_allclose(
        np.linalg.norm(reached - queries, axis=1), distance, rtol=0, atol=tolerance * size
    )


def test_every_region_of_a_triangle():
    points = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0.0]])
    queries = {
        (1, 1, 2): ((1, 1, 0), 2.0), (-1, -1, 0): ((0, 0, 0), 2**0.5), (2, -3, 0): ((2, 0, 0), 3),
        (5, 0, 0): ((4, 0, 0), 1), (-2, 1, 0): ((0, 1, 0), 2), (0, 6, 1): ((0, 4, 0), 5**0.5),
        (3, 3, 0): ((2, 2, 0), 2**0.5), (1, 2, 0): ((1, 2, 0), 0),
    }  # fmt: skip
    _, weights, distance = ClosestPoint(points, [[0, 1, 2]]).query(np.array(list(queries), float))
    np.testing.assert_allclose(weights @ points, [foot for foot, _ in queries.values()], atol=1e-15)
    np.testing.assert_allclose(distance, [d for _, d in queries.values()], atol=1e-15)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_random_triangles_near_and_far(scale):
    rng = np.random.default_rng(1)
    points = rng.normal(size=(60, 3)) * scale
    faces = rng.permuted(np.tile(np.arange(60), (40, 1)), axis=1)[:, :3]
    queries = np.concatenate([rng.normal(size=(300, 3)), 1e3 * rng.normal(size=(50, 3))]) * scale
    check_against_pairs(points, faces, queries)
    check_against_pairs(points, faces, queries, hints=rng.integers(-1, 40, 350))


def test_surface_with_hints_of_any_quality():
    mesh = shapes.torus(n_major=30, n_minor=12)
    rng = np.random.default_rng(2)
    queries = mesh.points + 0.05 * rng.normal(size=mesh.points.shape)
    search = ClosestPoint(mesh.points, mesh.faces)
    plain = search.query(queries)
    check_against_pairs(mesh.points, mesh.faces, queries)
    for hints in (plain[0], rng.integers(0, len(mesh.faces), len(queries))):
        np.testing.assert_allclose(search.query(queries, hints)[2], plain[2], atol=1e-15)


def test_thin_mesh_in_a_huge_box():
    """A needle-like strip far from a lone triangle: nothing depends on an even size."""
    x = np.linspace(0, 1, 40)
    strip = np.concatenate([np.stack([x, 0 * x, 0 * x], 1), np.stack([x, 0 * x + 1e-7, 0 * x], 1)])
    k = np.arange(39)
    faces = np.concatenate([np.stack([k, k + 1, k + 41], 1), np.stack([k, k + 41, k + 40], 1)])
    points = np.concatenate([strip, [[1e6, 0, 0], [1e6, 1e6, 0], [1e6, 0, 1e6]]])
    faces = np.concatenate([faces, [[80, 81, 82]]])
    queries = np.array([[0.5, 0.3, 0.1], [0.25, 5e-8, 1e-9], [7e5, 1e5, 1e5], [-3, 2, 1e6]])
    check_against_pairs(points, faces, queries, tolerance=1e-14)


corner = st.tuples(*[st.integers(-2, 2).map(float)] * 3)


@settings(max_examples=80, deadline=None, derandomize=True)
@given(st.lists(corner, min_size=3, max_size=9), st.data())
def test_any_triangles_flat_ones_too(points, data):
    index = st.integers(0, len(points) - 1)
    faces = data.draw(st.lists(st.tuples(index, index, index), min_size=1, max_size=9))
    queries = data.draw(st.lists(corner, min_size=1, max_size=4))
    check_against_pairs(np.array(points), np.array(faces), 0.75 * np.array(queries))


@pytest.mark.parametrize("height", [1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 1e-17])
def test_needles_in_any_direction(height):
    """The foot must be the closest point even where the triangle's normal is mere rounding."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        apex = rng.uniform(-0.3, 1.3)
        points = np.array([[0, 0, 0], [1, 0, 0], [apex, height, 0]]) @ turn
        queries = rng.uniform([-0.5, -0.5, -0.5], [1.5, 0.5, 0.5], size=(4, 3))
        queries[2:, 1:] *= height
        queries = queries @ turn
        _, weights, distance = ClosestPoint(points, [[0, 1, 2]]).query(queries)
        # A needle is within its height of its longest edge.
        ends = points[[0, 1]] if 0 <= apex <= 1 else points[[0, 2]] if apex > 1 else points[[1, 2]]
        expected = [distance_to_segment(q, *ends) for q in queries]
        np.testing.assert_allclose(distance, expected, rtol=0, atol=1.1 * height + 1e-15)
        reached = weights @ points
        np.testing.assert_allclose(np.linalg.norm(reached - queries, axis=1), distance, atol=1e-15)


@pytest.mark.parametrize("most", [1, 3, 1000])
def test_select_halves_any_keys(most):
    rng = np.random.default_rng(most)
    for size in (1, 2, 3, 10, 101):
        keys = rng.integers(0, most, size + 4).astype(float)
        for middle in range(2, size + 2):
            order = rng.permutation(size + 4)
            before = order.copy()
            select(order, keys, 2, size + 2, middle)
            assert sorted(order[2 : size + 2]) == sorted(before[2 : size + 2])
            np.testing.assert_array_equal(order[[0, 1, -2, -1]], before[[0, 1, -2, -1]])
            left, right = keys[order[2:middle]], keys[order[middle : size + 2]]
            assert len(left) == 0 or left.max() <= right.min()


def test_the_limit_spares_only_what_lies_beyond_it():
    rng = np.random.default_rng(0)
    spared = 0
    for corners, point in zip(rng.normal(size=(2000, 3, 3)), rng.normal(size=(2000, 3))):
        u, v = corners[1:] - corners[0]
        triangle = np.concatenate([corners[0], u, v, np.cross(u, v)])
        square = reference.distance_to_triangles(point, corners[None])[0] ** 2
        assert closest_on_triangle(*point, triangle, FAR)[2] == pytest.approx(square, rel=1e-9)
        near = closest_on_triangle(*point, triangle, 1.001 * square)
        assert near[2] == pytest.approx(square, rel=1e-9)
        spared += closest_on_triangle(*point, triangle, 0.5 * square)[2] == FAR
    assert spared > 300


def test_nan_finds_nothing_and_bad_surfaces_are_refused():
    mesh = shapes.cube()
    search = ClosestPoint(mesh.points, mesh.faces)
    found, weights, distance = search.query([[np.nan, 0, 0], [0.5, 0.5, 2.0]])
    assert found[0] == -1 and np.isnan(weights[0]).all() and np.isnan(distance[0])
    assert distance[1] == 1.0
    assert [len(part) for part in search.query(np.zeros((0, 3)))] == [0, 0, 0]
    with pytest.raises(InvalidMesh, match="without faces"):
        ClosestPoint(mesh.points, np.zeros((0, 3), int))
    with pytest.raises(InvalidMesh, match="NaN"):
        ClosestPoint(np.full((3, 3), np.nan), [[0, 1, 2]])
    with pytest.raises(InvalidMesh, match="do not exist"):
        ClosestPoint(mesh.points, [[0, 1, 8]])


def test_same_result_with_one_thread_and_two():
    mesh = shapes.icosphere(3)
    queries = np.random.default_rng(0).normal(size=(20_000, 3))
    search = ClosestPoint(mesh.points, mesh.faces)
    before, results = numba.get_num_threads(), []
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            results.append(search.query(queries))
    finally:
        numba.set_num_threads(before)
    for one, two in zip(*results):
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("count", [1, 3, 4, 5, 64, 1001])
def test_tree_holds_every_face_once_within_its_boxes(count):
    rng = np.random.default_rng(count)
    points = rng.integers(0, 4, size=(3 * count, 3)).astype(float)  # many equal keys
    faces = np.arange(3 * count).reshape(-1, 3)
    tree = build_tree(points, faces)
    assert sorted(tree.order) == list(range(count))
    for node in range(len(tree.boxes)):
        members = tree.order[tree.begin[node] : tree.end[node]]
        corners = points[faces[members]].reshape(-1, 3)
        if len(members):
            np.testing.assert_array_equal(tree.boxes[node, :3], corners.min(axis=0))
            np.testing.assert_array_equal(tree.boxes[node, 3:], corners.max(axis=0))
        if node < tree.leaves - 1:
            left, right = 2 * node + 1, 2 * node + 2
            assert tree.begin[node] == tree.begin[left] and tree.end[node] == tree.end[right]
            assert tree.end[left] == tree.begin[right]
        else:
            assert len(members) <= 4


def test_samples_are_even_by_area():
    mesh = shapes.icosphere(2)
    stretched = mesh.with_points(mesh.points * [4, 1, 1])
    points, faces = sample_surface(
        stretched.points, stretched.faces, 20_000, np.random.default_rng(0)
    )
    distance = ClosestPoint(stretched.points, stretched.faces).query(points)[2]
    assert distance.max() < 1e-14
    a, b, c = (stretched.points[stretched.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    count = np.bincount(faces, minlength=len(area))
    np.testing.assert_allclose(count, 20_000 * area / area.sum(), atol=2.0)
    # Within a triangle: the samples' mean is the centroid of the surface.
    middle = (((a + b + c) / 3) * area[:, None]).sum(axis=0) / area.sum()
    np.testing.assert_allclose(points.mean(axis=0), middle, atol=5e-3)


def test_two_sided_distance_of_spheres():
    a = shapes.icosphere(4)
    rms, largest = two_sided_distance(a, a.with_points(1.25 * a.points), samples=5000)
    assert rms == pytest.approx(0.25, rel=5e-3)
    assert largest == pytest.approx(0.25, rel=5e-3)
    assert two_sided_distance(a, a, samples=1000)[1] < 1e-15
    assert two_sided_distance(a, a, 1000, seed=1) == two_sided_distance(a, a, 1000, seed=1)


def test_two_sided_distance_sees_what_one_surface_lacks():
    a = shapes.cube()
    spike = TriMesh(np.concatenate([a.points, [[5, 5, 5]]]), np.concatenate([a.faces, [[6, 7, 8]]]))
    for pair in ((a, spike), (spike, a)):
        assert two_sided_distance(*pair, samples=100)[1] == pytest.approx(48**0.5)
