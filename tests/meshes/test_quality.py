"""Angles, areas, normals and volumes against closed forms, and against the shared measure."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from meshes import Patch, Plane, TriMesh
from meshes.io import read_surface
from meshes.quality import (
    corner_angles,
    corner_normals,
    degenerate_faces,
    dihedral_angles,
    face_areas,
    face_normals,
    min_angles_6d,
    signed_volume,
    surface_quality,
    triangle_angles,
    vertex_normals,
)
from meshes.structured import bcc_box
from tests import shapes

SHARED = Path(__file__).parents[3] / "shared"


def labelled_cube(side=1.0):
    mesh = shapes.cube(side)
    normals = face_normals(mesh.points, mesh.faces)[::2]
    patches = tuple(
        Patch(f"side {k}", Plane(tuple(n), float(max(n @ p for p in mesh.points))))
        for k, n in enumerate(normals)
    )
    return TriMesh(mesh.points, mesh.faces, np.repeat(np.arange(6), 2), patches)


def test_angles_of_known_triangles():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 3**0.5, 0], [0.5, 3**0.5 / 2, 0]])
    faces = np.array([[0, 1, 2], [0, 1, 3]])
    np.testing.assert_allclose(
        np.degrees(triangle_angles(points, faces)), [[90, 60, 30], [60, 60, 60]], atol=1e-12
    )
    np.testing.assert_allclose(face_areas(points, faces), [3**0.5 / 2, 3**0.5 / 4])


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_angles_of_a_needle_are_accurate(scale):
    height = 1e-9
    points = scale * np.array([[0, 0, 0], [1, 0, 0], [0.3, height, 0]])
    angles = triangle_angles(points, np.array([[0, 1, 2]]))[0]
    np.testing.assert_allclose(angles[:2], [height / 0.3, height / 0.7], rtol=1e-6)
    assert angles[2] == pytest.approx(np.pi)


def test_angles_of_triangles_without_area():
    line = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]])
    angles = corner_angles(np.stack([line, line[[0, 0, 1]], line[[0, 0, 0]]]))
    np.testing.assert_allclose(angles[0], [0, np.pi, 0], atol=1e-15)
    np.testing.assert_allclose(angles[1], [np.pi / 2, np.pi / 2, 0], atol=1e-15)
    assert np.isfinite(angles[2]).all()


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_volume_and_normals_of_a_sphere(scale):
    mesh = shapes.icosphere(4, radius=scale, centre=(5 * scale, 0, 0))
    assert signed_volume(mesh) == pytest.approx(4 / 3 * np.pi * scale**3, rel=5e-3)
    radial = (mesh.points - [5 * scale, 0, 0]) / scale
    np.testing.assert_allclose(vertex_normals(mesh.points, mesh.faces), radial, atol=2e-3)
    np.testing.assert_allclose(
        corner_normals(mesh), vertex_normals(mesh.points, mesh.faces)[mesh.faces], atol=1e-14
    )


def test_volume_is_exact_and_signed():
    mesh = shapes.cube(2.0)
    assert signed_volume(mesh) == pytest.approx(8.0, rel=1e-14)
    assert signed_volume(TriMesh(mesh.points, mesh.faces[:, ::-1])) == pytest.approx(-8.0)
    far = mesh.with_points(mesh.points + 1e6)
    assert signed_volume(far) == pytest.approx(8.0, rel=1e-9)


def test_corner_normals_of_a_cube_are_those_of_its_sides():
    flat = face_normals(*(getattr(shapes.cube(), n) for n in ("points", "faces")))
    mesh = labelled_cube()
    bare = TriMesh(mesh.points, mesh.faces, mesh.face_labels, tuple(Patch(n) for n in "abcdef"))
    for surface in (mesh, bare):
        np.testing.assert_allclose(
            corner_normals(surface), np.repeat(flat[:, None], 3, axis=1), atol=1e-15
        )
    # Without labels the corners are rounded.
    rounded = corner_normals(shapes.cube())
    np.testing.assert_allclose(np.abs(rounded), 3**-0.5, atol=1e-12)


def test_a_crease_inside_a_patch_has_two_normals_except_at_its_end():
    # A fan of four squares around (0, 0), folded along the edge from it to (1, 0).
    points = np.array([[0, 0, 0.5], [1, 0, 1.0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [0, 5, 1]])
    mesh = TriMesh(points, faces, feature_edges=[(0, 1)])
    normals = corner_normals(mesh)
    assert np.linalg.norm(normals[0, 1] - normals[4, 2]) > 0.5  # at vertex 1
    for face in range(1, 5):  # at vertex 0: one fan
        np.testing.assert_array_equal(normals[face, 0], normals[0, 0])


def test_six_dimensional_angles_of_a_sphere_are_its_own():
    """On a sphere (x, sigma n) is a similarity, so the angles do not change."""
    mesh = shapes.icosphere(4, radius=2.0)
    normals = mesh.points / 2.0
    plain = triangle_angles(mesh.points, mesh.faces).min(axis=1)
    for given in (normals, normals[mesh.faces]):
        np.testing.assert_allclose(min_angles_6d(mesh, 1.5, given), plain, atol=1e-12)
    quality = surface_quality(mesh, sigma=1.5)
    assert quality.min_angle_6d_mean == pytest.approx(quality.min_angle_mean, abs=0.1)
    assert surface_quality(mesh).min_angle_6d_mean is None


def test_six_dimensional_angles_of_a_cylinder():
    """A quad of width a around a cylinder and height b has the 6D sides a sqrt(1+s^2/R^2), b."""
    angle, height, sigma = np.radians(0.5), 0.02, 3.0
    ring = np.array([[1, 0, 0], [np.cos(angle), np.sin(angle), 0]])
    points = np.concatenate([ring, ring + [0, 0, height]])
    mesh = TriMesh(points, [[0, 1, 2]])
    measured = min_angles_6d(mesh, sigma, points * [1, 1, 0])[0]
    wide = 2 * np.sin(angle / 2) * np.sqrt(1 + sigma**2)
    assert measured == pytest.approx(np.arctan(height / wide), rel=1e-9)


def test_planar_labels_have_sigma_zero():
    mesh = labelled_cube()
    nonsense = np.random.default_rng(0).normal(size=(12, 3, 3))
    np.testing.assert_allclose(np.degrees(min_angles_6d(mesh, 10.0, nonsense)), 45.0)


def test_quality_of_a_cube():
    found = surface_quality(labelled_cube(3.0), sigma=0.1).as_dict()
    assert found.pop("min_angle_worst") == pytest.approx(45)
    assert found.pop("min_angle_mean") == pytest.approx(45)
    assert found.pop("min_angle_6d_mean") == pytest.approx(45)
    assert found.pop("edge_ratio") == pytest.approx(2**0.5)
    assert found.pop("volume") == pytest.approx(27)
    assert found == {
        "vertices": 8, "faces": 12, "watertight": True, "nonmanifold_edges": 0,
        "nonmanifold_vertices": 0, "self_intersecting_faces": 0, "degenerate_faces": 0,
        "euler": 2, "components": 1, "genus": 0, "pct_below_20": 0.0, "pct_below_30": 0.0,
    }  # fmt: skip


def test_quality_counts_what_is_wrong():
    mesh = shapes.icosphere(2)
    points = np.concatenate([mesh.points, 1.0001 * mesh.points[mesh.faces[0]].mean(0)[None]])
    faces = np.concatenate([mesh.faces, [[0, 0, 1], [2, 2, 3]]])
    found = surface_quality(TriMesh(points, faces))
    assert found.degenerate_faces == 2 and found.genus is None
    assert found.min_angle_worst == 0.0 and found.pct_below_20 == pytest.approx(100 * 2 / 322)
    assert surface_quality(mesh, intersections=False).self_intersecting_faces is None
    empty = surface_quality(TriMesh(mesh.points, np.zeros((0, 3), int)))
    assert empty.faces == 0 and not empty.watertight


def test_degenerate_faces_do_not_depend_on_the_unit():
    for scale in (1e-9, 1.0, 1e9):
        points = scale * np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-15, 0], [0.5, 1e-12, 0]])
        mesh = TriMesh(points, [[0, 1, 2], [0, 1, 3]])
        assert degenerate_faces(mesh).tolist() == [True, False]


def test_dihedral_angles():
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    angles = np.degrees(dihedral_angles(corner, np.array([[0, 1, 2, 3]])))[0]
    slanted = np.degrees(np.arccos(3**-0.5))
    np.testing.assert_allclose(angles, [90, 90, 90, slanted, slanted, slanted])
    regular = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])
    np.testing.assert_allclose(dihedral_angles(regular, np.array([[0, 1, 2, 3]])), np.arccos(1 / 3))
    box = bcc_box((0, 0, 0), (1, 1, 1), (3, 3, 3))
    angles = np.degrees(dihedral_angles(box.points, box.tets))
    assert angles.min() == pytest.approx(45) and angles.max() <= 90 + 1e-9


@pytest.mark.parametrize("name", ["spot.ply", "fandisk.ply"])
def test_agrees_with_the_shared_measure(name):
    script = SHARED / "measure" / "surface_metrics.py"
    path = SHARED / "data" / name
    if not (script.exists() and path.exists()):
        pytest.skip("the shared measure is not here")
    for module in ("igl", "trimesh"):
        pytest.importorskip(module)
    spec = importlib.util.spec_from_file_location("surface_metrics", script)
    measure = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(measure)
    mesh = read_surface(path)
    theirs = measure.evaluate(
        mesh.points, mesh.faces, mesh.points, mesh.faces, samples=1000, sigma=0.05,
        do_selfint=False,
    )  # fmt: skip
    ours = surface_quality(
        mesh, 0.05 * mesh.diagonal, vertex_normals(mesh.points, mesh.faces), intersections=False
    )
    for mine, other in {
        "vertices": "nV", "faces": "nF", "watertight": "watertight", "euler": "euler",
        "nonmanifold_edges": "nm_edges", "nonmanifold_vertices": "nm_verts", "genus": "genus",
        "components": "comps", "degenerate_faces": "degen_faces",
        "min_angle_worst": "minang_worst", "min_angle_mean": "minang_mean",
        "pct_below_20": "pct_lt20", "pct_below_30": "pct_lt30", "edge_ratio": "edge_ratio",
        "min_angle_6d_mean": "minang6_mean",
    }.items():  # fmt: skip
        assert getattr(ours, mine) == pytest.approx(theirs[other], rel=2e-5), mine
