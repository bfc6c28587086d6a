"""Surfaces of whole meshes and of their labels; long edges split."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from meshes import ImplicitSurface, InvalidCase, InvalidMesh, Patch, Plane, PlaneSurface, TriMesh
from rbf import fit_surface, fit_surfaces
from rbf.subdivide import edge_lengths, split_length, split_long_edges
from tests.shapes import cube, icosphere, torus

DATA = Path(__file__).parents[3] / "shared" / "data"


def labelled_cube(longest=0.3):
    """A cube whose six sides are smooth labels of their own; the sides' outward normals."""
    coarse = cube()
    points, faces, parent = split_long_edges(coarse.points, coarse.faces, longest)
    labels = tuple(Patch(f"side {k}") for k in range(6))
    a, b, c = np.moveaxis(coarse.points[coarse.faces[::2]], 1, 0)
    return TriMesh(points, faces, parent // 2, labels), np.cross(b - a, c - a)


def _boundary_edges(faces):
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    key = np.sort(edges, axis=1)
    _, index, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    return edges[count[index.ravel()] == 1]


def test_creases_between_labels_are_not_rounded():
    mesh, outward = labelled_cube()
    surfaces = fit_surfaces(mesh)
    rim = mesh.points[((mesh.points == 0.0) | (mesh.points == 1.0)).sum(axis=1) == 2]
    whole = fit_surface(mesh).gradient(rim)
    for surface, normal in zip(surfaces, outward):
        assert isinstance(surface, ImplicitSurface)
        own = rim[np.abs((rim - 0.5) @ normal - 0.5) < 1e-12]
        points, normals = surface.project(own)
        np.testing.assert_allclose(points, own, atol=1e-6)
        np.testing.assert_allclose(normals, np.tile(normal, (len(own), 1)), atol=1e-6)
        rounded = whole[np.abs((rim - 0.5) @ normal - 0.5) < 1e-12] @ normal
        assert rounded.max() < 0.9


def test_planar_labels_need_no_fit_and_empty_ones_get_nothing():
    mesh = icosphere(2)
    plane = Plane((0.0, 0.0, -1.0), 1.0)
    labels = (Patch("ball"), Patch("cap", plane), Patch("empty"))
    ball, cap, empty = fit_surfaces(TriMesh(mesh.points, mesh.faces, None, labels))
    assert isinstance(cap, PlaneSurface)
    assert cap.plane is plane
    assert empty is None
    np.testing.assert_array_equal(ball.value(mesh.points), fit_surface(mesh).value(mesh.points))


def test_surface_of_a_mesh_goes_through_its_vertices():
    mesh = torus(n_major=36, n_minor=14)
    for form in ("hermite", "offsets"):
        surface = fit_surface(mesh, form=form)
        assert surface.report.added == 0
        assert np.abs(surface.value(mesh.points)).max() < 1e-6
    with pytest.raises(InvalidCase, match="form must be one of"):
        fit_surface(mesh, form="thesis")


def test_a_spike_edge_does_not_widen_the_support():
    mesh = icosphere(3)
    points = mesh.points.copy()
    points[100] *= 1.0 + 100 * np.median(edge_lengths(points, mesh.faces))
    surface = fit_surface(mesh.with_points(points))
    normal = fit_surface(mesh)
    assert surface.support_radius == pytest.approx(normal.support_radius, rel=0.05)
    assert 100 < surface.report.added < 20_000
    along_the_spike = points[100] * np.linspace(0.2, 0.9, 30)[:, None]
    assert surface.is_supported(along_the_spike).all()
    away = mesh.points[mesh.points @ mesh.points[100] < 0.3]
    projected, _ = surface.project(away * 1.01)
    np.testing.assert_allclose(np.linalg.norm(projected, axis=1), 1.0, atol=2e-3)


def test_a_coarse_surface_leaves_no_holes_in_the_support():
    mesh = cube(10.0)
    fine = icosphere(3, 0.5, (20.0, 5.0, 5.0))
    faces = np.vstack([mesh.faces, fine.faces + len(mesh.points)])
    both = TriMesh(np.vstack([mesh.points, fine.points]), faces)
    surface = fit_surface(both)
    assert surface.report.added > 1000
    middles = mesh.points[mesh.faces].mean(axis=1)
    value, gradient = surface.value_and_gradient(middles)
    assert np.abs(value).max() < 0.05
    outward = middles - 5.0
    assert (np.einsum("ij,ij->i", gradient, outward) > 0.5 * 5).all()


def test_split_edges_are_short_closed_and_flat():
    mesh = cube()
    points, faces, parent = split_long_edges(mesh.points, mesh.faces, 0.3)
    assert edge_lengths(points, faces).max() <= 0.3
    np.testing.assert_array_equal(points[: len(mesh.points)], mesh.points)
    assert not len(_boundary_edges(faces))
    corners = points[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    old = mesh.points[mesh.faces]
    old_area = np.cross(old[:, 1] - old[:, 0], old[:, 2] - old[:, 0]) / 2
    for axis in range(3):
        part = np.bincount(parent, area[:, axis], len(mesh.faces))
        np.testing.assert_allclose(part, old_area[:, axis], atol=1e-14)
    assert (np.einsum("ij,ij->i", area, old_area[parent]) > 0).all()


def test_the_number_of_added_points_is_bounded():
    big = icosphere(1, 1e6)
    small = icosphere(3, 1.0)
    points = np.vstack([big.points, small.points])
    faces = np.vstack([big.faces, small.faces + len(big.points)])
    spacing = np.median(edge_lengths(small.points, small.faces))
    longest, larger = split_length(points, faces, spacing)
    assert larger > spacing
    assert len(split_long_edges(points, faces, longest)[0]) < 60_000


def test_a_mesh_without_surface_is_refused():
    with pytest.raises(InvalidMesh, match="must have faces"):
        fit_surface(TriMesh(np.zeros((3, 3)), np.zeros((0, 3), int)))
    with pytest.raises(InvalidMesh, match="degenerate"):
        fit_surface(TriMesh(np.arange(9.0).reshape(3, 3), [[0, 1, 2]]))
    mesh = icosphere(1)
    broken = mesh.points.copy()
    broken[5] = np.nan
    with pytest.raises(InvalidMesh, match="not finite"):
        fit_surface(mesh.with_points(broken))


@pytest.mark.skipif(not DATA.exists(), reason="no measured surfaces beside the checkout")
@pytest.mark.parametrize("form", ["hermite", "offsets"])
def test_spot(form):
    data = meshio.read(DATA / "spot.ply")
    mesh = TriMesh(data.points, data.cells_dict["triangle"])
    surface = fit_surface(mesh, form=form)
    assert surface.report.bad_pivots == 0
    middles = mesh.points[mesh.faces].mean(axis=1)
    points, _ = surface.project(middles)
    spacing = surface.spacing
    moved = np.linalg.norm(points - middles, axis=1)
    assert np.isfinite(points).all()
    assert np.sqrt(np.mean(moved**2)) < 0.06 * spacing
