"""Features of shapes whose creases are known; scans and jagged surfaces have none."""

from pathlib import Path

import numpy as np
import pytest

from meshes import TriMesh
from meshes.features import find_features
from meshes.io import read_surface
from meshes.quality import vertex_normals
from meshes.topology import feature_corners, label_boundaries, require_valid
from tests import shapes

DATA = Path(__file__).parents[3] / "shared" / "data"


def refined(mesh, times=1):
    """Every triangle cut into four, in its plane."""
    points, faces = mesh.points, mesh.faces
    for _ in range(times):
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middle = len(points) + index.reshape(-1, 3)
        points = np.concatenate([points, points[unique].mean(axis=1)])
        (a, b, c), (ab, bc, ca) = faces.T, middle.T
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        faces = np.concatenate([np.stack(part, axis=1) for part in parts])
    return TriMesh(points, faces)


def cylinder(around=32, along=9, radius=1.0, height=2.0):
    """A closed cylinder about z with flat caps."""
    angle = 2 * np.pi * np.arange(around) / around
    ring = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = [ring + [0, 0, z] for z in np.linspace(0, height, along)]
    points = np.concatenate([*points, [[0, 0, 0], [0, 0, height]]])
    k = np.arange(around)
    nxt = (k + 1) % around
    faces = []
    for i in range(along - 1):
        low, high = i * around, (i + 1) * around
        faces += [np.stack([low + k, low + nxt, high + nxt], 1)]
        faces += [np.stack([low + k, high + nxt, high + k], 1)]
    top = (along - 1) * around
    faces += [np.stack([nxt, k, 0 * k + len(points) - 2], 1)]
    faces += [np.stack([top + k, top + nxt, 0 * k + len(points) - 1], 1)]
    return TriMesh(points, np.concatenate(faces))


def turned(mesh, seed=0):
    """The mesh rotated."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return mesh.with_points(mesh.points @ (q * np.linalg.det(q)).T)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("times, edges", [(0, 12), (1, 24), (4, 192)])
def test_cube(times, edges, scale):
    mesh = refined(shapes.cube(), times)
    mesh = turned(mesh.with_points(scale * mesh.points), times)
    found = find_features(mesh)
    assert len(found.feature_edges) == edges
    assert len(found.labels) == 6 and len(feature_corners(found)) == 8
    for number, patch in enumerate(found.labels):
        here = mesh.points[mesh.faces[found.face_labels == number]].reshape(-1, 3)
        assert np.abs(patch.plane.signed_distance(here)).max() < 1e-14 * scale
        # The plane's normal is outward.
        assert patch.plane.signed_distance(mesh.points.mean(axis=0)[None])[0] < -0.4 * scale
    np.testing.assert_array_equal(found.feature_edges, label_boundaries(found))


def test_axis_parallel_planes_are_exact():
    mesh = refined(shapes.cube(0.1), 2)
    planes = {patch.plane.normal: patch.plane.offset for patch in find_features(mesh).labels}
    assert planes[(1.0, 0.0, 0.0)] == planes[(0.0, 0.0, 1.0)] == 0.1
    assert planes[(0.0, -1.0, 0.0)] == 0.0


def test_cylinder_has_two_rims():
    mesh = turned(cylinder())
    found = find_features(mesh)
    assert len(found.feature_edges) == 64 and len(feature_corners(found)) == 0
    planar = [patch.plane is not None for patch in found.labels]
    assert planar == [False, True, True]
    assert np.bincount(found.face_labels).tolist() == [512, 32, 32]


@pytest.mark.parametrize("mesh", [shapes.torus(), shapes.icosphere(2), shapes.icosphere(3)])
def test_smooth_surfaces_have_none(mesh):
    found = find_features(mesh)
    assert len(found.feature_edges) == 0
    assert len(found.labels) == 1 and found.labels[0].plane is None


@pytest.mark.parametrize("faces", [4, 8])
def test_coarse_solids_are_all_creases(faces):
    if faces == 4:
        points = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])
        mesh = TriMesh(points, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    else:
        points = np.concatenate([np.eye(3), -np.eye(3)])
        mesh = TriMesh(points, [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2],
                                [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])  # fmt: skip
    require_valid(mesh)
    found = find_features(mesh)
    assert len(found.labels) == faces
    assert len(found.feature_edges) == 3 * faces // 2


def test_open_boundaries_are_features():
    mesh = shapes.icosphere(3)
    cut = TriMesh(mesh.points, mesh.faces[mesh.points[mesh.faces].mean(axis=1)[:, 2] < 0.5])
    found = find_features(cut)
    assert len(found.labels) == 1
    assert len(found.feature_edges) == require_valid(cut, closed=False).boundary_edges > 20


def test_a_crease_that_fades_out_separates_nothing():
    n = 49
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij")
    z = 1.2 * np.maximum(0.3 - x, 0) * -np.abs(y)  # a roof for x < 0.3
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = (index[i : n - 1 + i, j : n - 1 + j].ravel() for i, j in
                  ((0, 0), (1, 0), (1, 1), (0, 1)))  # fmt: skip
    mesh = TriMesh(
        np.stack([x, y, z], axis=-1).reshape(-1, 3),
        np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]),
    )
    found = find_features(mesh)
    inner = found.feature_edges[(np.abs(mesh.points[found.feature_edges]) < 0.99).all(axis=(1, 2))]
    assert len(found.labels) == 1
    ridge = mesh.points[inner]
    np.testing.assert_array_equal(ridge[..., 1], 0.0)
    # It is a crease as long as it turns by more than 40 degrees: 2 atan(1.2 (0.3 - x)) > 40.
    end = 0.3 - np.tan(np.radians(20)) / 1.2
    assert ridge[..., 0].max() == pytest.approx(end, abs=2 * 2 / (n - 1))


def test_a_small_box_on_a_smooth_surface_is_kept_and_a_dent_of_noise_is_not():
    sphere = shapes.icosphere(4)
    dented = sphere.points.copy()
    dented[20] *= 0.93
    assert len(find_features(sphere.with_points(dented)).feature_edges) == 0
    cube = shapes.cube(0.1)
    both = TriMesh(
        np.concatenate([sphere.points, cube.points + 3]),
        np.concatenate([sphere.faces, cube.faces + len(sphere.points)]),
    )
    assert len(find_features(both).feature_edges) == 12


@pytest.mark.parametrize("seed", range(3))
def test_noise_does_not_shatter_a_sphere(seed):
    mesh = shapes.icosphere(4)
    edge = 0.075
    rng = np.random.default_rng(seed)
    normals = vertex_normals(mesh.points, mesh.faces)
    rough = mesh.with_points(
        mesh.points + 0.3 * edge * rng.normal(size=(len(normals), 1)) * normals
    )
    found = find_features(rough)
    assert len(found.labels) == 1 and len(found.feature_edges) < 20


@pytest.mark.parametrize("noise", [0.05, 0.1])
def test_noise_does_not_hide_the_edges_of_a_cube(noise):
    """At a tenth of an edge there are spurs too, which have to go."""
    mesh = refined(shapes.cube(), 4)
    rng = np.random.default_rng(0)
    rough = mesh.with_points(mesh.points + noise / 16 * rng.normal(size=mesh.points.shape))
    found = find_features(rough)
    assert len(found.labels) == 6 and len(found.feature_edges) == 192


def test_labels_and_edges_that_are_there_are_kept():
    mesh = shapes.icosphere(2)
    labels = (mesh.points[mesh.faces].mean(axis=1)[:, 0] > 0).astype(int)
    edge = np.sort(mesh.faces[0, :2])
    given = TriMesh(mesh.points, mesh.faces, labels, ("a", "b"), [edge])
    found = find_features(given)
    expected = np.unique(np.concatenate([label_boundaries(given), [edge]]), axis=0)
    np.testing.assert_array_equal(found.feature_edges, expected)
    assert len(found.labels) == 2


@pytest.mark.parametrize("name", ["beams_mt.ply", "spot.ply"])
def test_jagged_and_scanned_surfaces_stay_whole(name):
    if not (DATA / name).exists():
        pytest.skip("the shared surfaces are not here")
    found = find_features(read_surface(DATA / name))
    assert len(found.labels) == 1 and len(found.feature_edges) == 0


def test_fandisk_has_its_creases():
    if not (DATA / "fandisk.ply").exists():
        pytest.skip("the shared surfaces are not here")
    mesh = read_surface(DATA / "fandisk.ply")
    found = find_features(mesh)
    # Its creases are sharp: any angle between gives the same curves but for the faded end.
    for angle in (30.0, 50.0):
        other = find_features(mesh, angle)
        assert abs(len(other.feature_edges) - len(found.feature_edges)) <= 12
    assert len(found.labels) == 12
    assert sum(patch.plane is not None for patch in found.labels) == 6
    assert len(feature_corners(found)) < 30
