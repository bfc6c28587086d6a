"""Self-intersections: known cases, and random ones against fractions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshes import InvalidMesh
from meshes.predicates import exact_line_side, exact_plane_side, line_side, plane_side
from meshes.self_intersection import normalised_coordinates, self_intersecting_faces
from meshes.self_intersection_kernels import faces_meet, find_axes
from tests import shapes
from tests.meshes import reference

FLOOR = [(0, 0, 0), (4, 0, 0), (0, 4, 0)]
APART = {
    "crossing": ([(1, 1, -1), (1, 1, 1), (2, 1, 1)], True),
    "crossing, edge through the inside": ([(1, 1, -1), (1, 1, 1), (9, 9, 1)], True),
    "above": ([(1, 1, 1), (2, 1, 1), (1, 2, 2)], False),
    "above by one rounding": ([(1, 1, 2.0**-52), (2, 1, 1), (1, 2, 2)], False),
    "corner on the inside": ([(1, 1, 0), (2, 1, 1), (1, 2, 2)], True),
    "corner on an edge": ([(2, 2, 0), (3, 3, 1), (3, 3, -1)], True),
    "corner on a corner": ([(4, 0, 0), (5, 0, 1), (5, 1, 0)], True),
    "corner beside the edge": ([(2, 2.0000000001, 0), (3, 3, 1), (3, 3, -1)], False),
    "edge on the inside": ([(1, 1, 0), (2, 1, 0), (1, 1, 5)], True),
    "edges crossing at a point": ([(2, 3, 1), (2, 1, -1), (9, 9, 0)], True),
    "passing by": ([(3, 3, -1), (3, 3, 1), (9, 9, 0)], False),
    "coplanar, overlapping": ([(1, 1, 0), (5, 1, 0), (1, 5, 0)], True),
    "coplanar, inside": ([(1, 1, 0), (1.5, 1, 0), (1, 1.5, 0)], True),
    "coplanar, around": ([(-9, -9, 0), (30, -9, 0), (-9, 30, 0)], True),
    "coplanar, star": ([(-1, 1, 0), (5, 1.5, 0), (-1, 2, 0)], True),
    "coplanar, along an edge": ([(1, 0, 0), (2, 0, 0), (1, -2, 0)], True),
    "coplanar, apart": ([(3, 3, 0), (5, 3, 0), (3, 5, 0)], False),
    "coplanar, apart on the line of an edge": ([(5, 0, 0), (7, 0, 0), (-1, -3, 0)], False),
    "equal but not the same vertices": (FLOOR, True),
}
SHARED = {
    "one vertex, apart": ([(0, 0, 0), (-4, 0, 1), (0, -4, 1)], 1, False),
    "one vertex, standing on the edge": ([(0, 0, 0), (2, 0, 2), (4, 0, 3)], 1, False),
    "one vertex, overlapping the edge": ([(0, 0, 0), (2, 0, 0), (4, 0, 3)], 1, True),
    "one vertex, through": ([(0, 0, 0), (1, 1, 1), (1, 1, -1)], 1, True),
    "one vertex, edge inside": ([(0, 0, 0), (1, 1, 0), (1, 1, 3)], 1, True),
    "one vertex, coplanar overlap": ([(0, 0, 0), (3, 1, 0), (1, 3, 0)], 1, True),
    "one vertex, coplanar apart": ([(0, 0, 0), (-3, 1, 0), (1, -3, 0)], 1, False),
    "one vertex, coplanar, touching edge": ([(0, 0, 0), (1, 0, 0), (1, -3, 0)], 1, True),
    "one edge, a roof": ([(0, 0, 0), (4, 0, 0), (1, 1, 1)], 2, False),
    "one edge, flat": ([(0, 0, 0), (4, 0, 0), (1, -1, 0)], 2, False),
    "one edge, folded over": ([(0, 0, 0), (4, 0, 0), (3, 3, 0)], 2, True),
    "one edge, nearly folded over": ([(0, 0, 0), (4, 0, 0), (3, 3, 2.0**-60)], 2, False),
    "the same face": (FLOOR, 3, True),
}


def marked(points, faces):
    """What the kernels say, checked against the twin."""
    points, faces = np.array(points, float), np.array(faces)
    found = self_intersecting_faces(points, faces)
    np.testing.assert_array_equal(found, reference.self_intersecting_faces(points, faces))
    return found


def turned(corners, seed):
    """Corners turned by an exact cyclic permutation of axes and shifted by small integers."""
    rng = np.random.default_rng(seed)
    return np.roll(np.array(corners, float), seed % 3, axis=1) * rng.choice([-1, 1], 3)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", APART)
def test_two_separate_triangles(case, seed):
    corners, meet = APART[case]
    points = turned(FLOOR + corners, seed)
    for faces in ([[0, 1, 2], [3, 4, 5]], [[5, 3, 4], [2, 1, 0]]):
        assert marked(points, faces).tolist() == [meet] * 2


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", SHARED)
def test_two_triangles_with_common_vertices(case, seed):
    corners, shared, meet = SHARED[case]
    points = turned(FLOOR + corners, seed)
    other = [k if k < shared else 3 + k for k in range(3)]
    for roll in range(3):
        faces = [np.roll([0, 1, 2], roll), np.roll(other[::-1], seed)]
        assert marked(points, faces).tolist() == [meet] * 2


def test_faces_without_area_are_left_out():
    points = [*FLOOR, (1, 1, -1), (1, 1, 1), (1, 1, 3)]
    assert not marked(points, [[0, 1, 2], [3, 4, 5], [0, 0, 1]]).any()


def test_closed_surfaces():
    sphere = shapes.icosphere(3)
    assert not self_intersecting_faces(sphere.points, sphere.faces).any()
    assert not self_intersecting_faces(
        *(getattr(shapes.cube(), n) for n in ("points", "faces"))
    ).any()
    inner = 0.9 * sphere.points
    nested = np.concatenate([sphere.points, inner])
    faces = np.concatenate([sphere.faces, sphere.faces[:, ::-1] + len(inner)])
    assert not self_intersecting_faces(nested, faces).any()
    nested[: len(inner)] += [0.2, 0, 0]
    found = self_intersecting_faces(nested, faces)
    # Only near the circle where the spheres meet: |x - (0.2, 0, 0)| = 1 and |x| = 0.9.
    middles = nested[faces].mean(axis=1)
    assert 0 < found.sum() < 200
    assert np.abs(middles[found][:, 0] - (0.9**2 + 0.2**2 - 1) / 0.4).max() < 0.2


def test_two_cubes_that_touch():
    cube = shapes.cube()
    faces = np.concatenate([cube.faces, cube.faces + 8])
    for shift, touching in (((1, 0, 0), 4 + 16), ((1 + 1e-15, 0, 0), 0), ((0.5, 0.25, 0), None)):
        points = np.concatenate([cube.points, cube.points + shift])
        found = marked(points, faces)
        if touching == 0:
            assert not found.any()
        elif touching is None:
            assert found.sum() > 12
        else:  # the two sides, and whatever else touches their edges
            assert found.sum() == touching


def test_a_spike_through_the_far_side():
    sphere = shapes.icosphere(3)
    points = sphere.points.copy()
    points[0] *= -1.5
    found = self_intersecting_faces(points, sphere.faces)
    spike = (sphere.faces == 0).any(axis=1)
    assert found[spike].all() and 0 < found[~spike].sum() < 30


def test_refuses_nan_and_missing_points():
    points = np.array(FLOOR, float)
    points[1, 1] = np.nan
    with pytest.raises(InvalidMesh, match="NaN"):
        self_intersecting_faces(points, [[0, 1, 2]])
    with pytest.raises(InvalidMesh, match="do not exist"):
        self_intersecting_faces(points, [[0, 1, 3]])
    # A point of no face may be anything.
    points = np.concatenate([points, FLOOR])
    assert not self_intersecting_faces(points, [[3, 4, 5]]).any()
    assert len(self_intersecting_faces(points, np.zeros((0, 3), int))) == 0


@pytest.mark.parametrize("power", [-900, -30, 30, 900])
def test_powers_of_two_change_nothing(power):
    rng = np.random.default_rng(3)
    points, faces = rng.normal(size=(40, 3)), rng.permuted(np.tile(np.arange(40), (60, 1)), axis=1)
    faces = faces[:, :3]
    plain = self_intersecting_faces(points, faces)
    assert 0 < plain.sum() < 60
    np.testing.assert_array_equal(self_intersecting_faces(np.ldexp(points, power), faces), plain)


def test_normalised_coordinates_keep_all_but_the_tiniest():
    points = np.array([[3.0, -1e-50, 2.0**-60], [0.0, 1e-200, 1e-73]])
    scaled = 4.0 * normalised_coordinates(points)
    np.testing.assert_array_equal(scaled, [[3.0, -1e-50, 2.0**-60], [0.0, 0.0, 1e-73]])


# Whole numbers make touching and coplanar pairs the rule; nearly whole ones defeat the filter.
whole = st.integers(-2, 2).map(float)
nearly = st.builds(lambda k, n: k + n * 2.0**-50, st.integers(-2, 2), st.integers(-2, 2))
wild = st.floats(-1e3, 1e3, allow_subnormal=False).map(lambda x: x if abs(x) > 1e-60 else 0.0)


def points_of(numbers, count):
    return st.lists(st.tuples(numbers, numbers, numbers), min_size=count, max_size=count)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(points_of(whole, 6) | points_of(nearly, 6) | points_of(wild, 6), st.integers(0, 3))
def test_random_pairs_against_fractions(points, shared):
    points = np.array(points)
    faces = np.array([[0, 1, 2], [k if k < shared else 3 + k for k in (2, 0, 1)]])
    marked(points, faces)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    points_of(whole, 9) | points_of(nearly, 9),
    st.lists(st.permutations(range(9)), min_size=3, max_size=12),
)
def test_random_soups_against_fractions(points, order):
    marked(points, [p[:3] for p in order])


@settings(max_examples=300, deadline=None, derandomize=True)
@given(points_of(whole, 4) | points_of(nearly, 4) | points_of(wild, 4))
def test_predicates_against_fractions(points):
    points = np.array(points)
    side = reference.plane_side(*points)
    assert plane_side(points, 0, 1, 2, 3) == exact_plane_side(points, 0, 1, 2, 3) == side
    assert plane_side(points, 1, 0, 2, 3) == -side
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        side = reference.line_side(*points[:3, [i, j]])
        assert line_side(points, 0, 1, 2, axis) == exact_line_side(points, 0, 1, 2, i, j) == side


def test_the_filter_is_needed():
    """Four points on a line, rounded: plain arithmetic errs, the predicate does not."""
    rng = np.random.default_rng(0)
    wrong = np.zeros(2, dtype=int)
    for _ in range(200):
        x = rng.random(4)
        points = np.stack([x, x / 3.0, x / 7.0], axis=1) + 0.1
        a, b, c, d = points
        exact = reference.plane_side(a, b, c, d)
        assert plane_side(points, 0, 1, 2, 3) == exact
        wrong[0] += np.sign((a - d) @ np.cross(b - d, c - d)) != exact
        exact = reference.line_side(a[:2], b[:2], c[:2])
        assert line_side(points, 0, 1, 2, 2) == exact
        wrong[1] += np.sign(np.linalg.det([a[:2] - c[:2], b[:2] - c[:2]])) != exact
    assert wrong.min() > 20


def test_kernel_of_one_pair():
    points = np.array(FLOOR + APART["crossing"][0], float)
    faces = np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int64)
    axes = np.empty(2, dtype=np.int64)
    find_axes(points, faces, axes)
    assert axes.tolist() == [2, 1]
    assert faces_meet(points, faces, axes, 0, 1, np.empty((2, 3), dtype=np.int64))
