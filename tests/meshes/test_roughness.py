"""Roughness against closed forms: corrugations, facets of a sphere, thin walls."""

import numpy as np
import pytest

from meshes import Patch, Plane, TriMesh
from meshes.roughness import roughness
from tests.shapes import icosphere


def sheet(height, cells=60):
    """A sheet over the unit square whose height is a function of x [cells] at the grid's nodes."""
    i, j = np.meshgrid(np.arange(cells + 1), np.arange(cells + 1), indexing="ij")
    points = np.stack([i / cells, j / cells, height(i) + 0.0 * j], axis=-1).reshape(-1, 3)
    a = (i * (cells + 1) + j)[:-1, :-1].ravel()
    b, c, d = a + cells + 1, a + cells + 2, a + 1
    return TriMesh(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


@pytest.mark.parametrize("slope", [0.05, 0.3])
def test_corrugations_count_by_their_slope(slope):
    rough = sheet(lambda i: slope / 60 * (i % 2))
    # normals (-+ sin a, 0, cos a): only the first component varies, and has mean 0
    assert roughness(rough, 0.1) == pytest.approx(np.sin(np.arctan(slope)), rel=0.02)


def test_an_even_slope_and_curvature_do_not_count():
    assert roughness(sheet(lambda i: 0.5 * i / 60), 0.1) < 1e-8
    fine = roughness(sheet(lambda i: 0.2 * (i / 240) ** 2, cells=240), 0.1)
    coarse = roughness(sheet(lambda i: 0.2 * (i / 30) ** 2, cells=30), 0.1)
    assert fine < 0.3 * coarse  # what counts are the facets, of 1/240 and 1/30


def test_facets_count_by_their_size_whatever_the_scale():
    found = [roughness(icosphere(level), 0.3) for level in (3, 4, 5)]
    ratios = np.divide(found[:-1], found[1:])
    np.testing.assert_allclose(ratios, 2.0, rtol=0.15)
    sphere = icosphere(3)
    scaled = sphere.with_points(sphere.points * 2.0**-20)
    assert roughness(scaled, 0.3 * 2.0**-20) == pytest.approx(found[0], rel=1e-9)


def test_the_other_side_of_a_thin_wall_is_not_roughness():
    top = sheet(lambda i: 0.01 + 0.0 * i)
    under = sheet(lambda i: 0.0 * i)
    faces = np.concatenate([top.faces, under.faces[:, ::-1] + len(top.points)])
    assert roughness(TriMesh(np.concatenate([top.points, under.points]), faces), 0.1) < 1e-8


def test_planar_patches_are_left_out():
    rough = sheet(lambda i: 0.3 / 60 * (i % 2))
    under = sheet(lambda i: -1.0 + 0.0 * i)
    faces = np.concatenate([rough.faces, under.faces + len(rough.points)])
    labels = np.repeat([0, 1], [len(rough.faces), len(under.faces)])
    patches = (Patch("rough"), Patch("floor", Plane((0.0, 0.0, 1.0), -1.0)))
    both = TriMesh(np.concatenate([rough.points, under.points]), faces, labels, patches)
    assert roughness(both, 0.1) == pytest.approx(np.sin(np.arctan(0.3)), rel=0.02)
    assert np.isnan(roughness(TriMesh(both.points, under.faces, labels[labels == 1], patches), 0.1))
