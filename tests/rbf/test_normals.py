"""Vertex normals and normals of point clouds."""

import numpy as np
import pytest

from meshes import InvalidMesh, TriMesh
from rbf import pca_normals, vertex_normals
from tests.rbf import reference
from tests.shapes import TorusSurface, cube, icosphere, torus


def test_weights_are_inverse_centroid_distances():
    mesh = torus(n_major=13, n_minor=7)
    expected = reference.vertex_normals(mesh.points, mesh.faces)
    np.testing.assert_allclose(vertex_normals(mesh), expected, atol=1e-14)


def test_normals_of_a_torus_converge_with_order_two():
    errors = []
    for n in (24, 48):
        mesh = torus(n_major=2 * n, n_minor=n)
        exact = TorusSurface().gradient(mesh.points)
        errors.append(np.abs(vertex_normals(mesh) - exact).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)


def test_degenerate_faces_do_not_count():
    mesh = icosphere(1)
    a, b, _ = mesh.faces[0]
    spoiled = TriMesh(mesh.points, np.vstack([mesh.faces, [[a, a, b], [a, b, b]]]))
    np.testing.assert_allclose(vertex_normals(spoiled), vertex_normals(mesh), atol=1e-12)


def test_unused_vertices_have_no_normal():
    mesh = cube()
    lonely = TriMesh(np.vstack([mesh.points, [[5.0, 5.0, 5.0]]]), mesh.faces)
    normals = vertex_normals(lonely)
    assert np.isnan(normals[-1]).all()
    assert np.isfinite(normals[:-1]).all()


@pytest.mark.parametrize("mesh", [icosphere(3), torus(n_major=60, n_minor=24)], ids=["s", "t"])
def test_pca_normals_point_outward(mesh):
    order = np.random.default_rng(0).permutation(len(mesh.points))
    normals = pca_normals(mesh.points[order])
    exact = vertex_normals(mesh)[order]
    assert np.einsum("ij,ij->i", normals, exact).min() > 0.97


def test_pca_normals_of_two_pieces_both_point_outward():
    first, second = icosphere(2), icosphere(2, 0.5, (4.0, 0.0, 0.3))
    normals = pca_normals(np.vstack([first.points, second.points]))
    exact = np.vstack([vertex_normals(first), vertex_normals(second)])
    assert np.einsum("ij,ij->i", normals, exact).min() > 0.9


def test_points_on_a_line_have_no_normals():
    line = np.linspace(0, 1, 30)[:, None] * [1.0, 2.0, 3.0]
    with pytest.raises(InvalidMesh, match="on a line"):
        pca_normals(line)
    with pytest.raises(InvalidMesh, match="at least 3 points"):
        pca_normals(line[:2])
