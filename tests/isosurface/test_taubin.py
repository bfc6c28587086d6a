"""Taubin's filter: its transfer function, the drift that the thesis's factors cause, curves."""

import numpy as np
import pytest

from isosurface import SmoothingSettings, extract_surface, repair_slivers, smooth
from isosurface.structure import surface_structure
from isosurface.taubin import (
    THESIS_FACTORS,
    filter_until_smooth,
    follow_rims,
    pass_band_factors,
    taubin_filter,
)
from meshes import InvalidCase, TriMesh
from meshes.edges import edge_table
from meshes.quality import face_normals, signed_volume
from tests import shapes
from tests.isosurface import fields, reference


def mean_edge(surface):
    edges = edge_table(surface.faces).edges
    return np.linalg.norm(np.diff(surface.points[edges], axis=1), axis=2).mean()


@pytest.mark.parametrize("subdivisions", [3, 4])
def test_the_thesis_factors_inflate_a_sphere_as_predicted(subdivisions):
    sphere = shapes.icosphere(subdivisions, radius=2.0)
    swollen = sphere.with_points(taubin_filter(sphere, THESIS_FACTORS, 40))
    drift = signed_volume(swollen) / signed_volume(sphere) - 1.0
    assert drift == pytest.approx(6.0 * mean_edge(sphere) ** 2 / 4.0, rel=0.1)


def test_the_default_keeps_the_volume_and_shape_of_a_sphere():
    sphere = shapes.icosphere(3)
    smoothed, report = smooth(sphere)
    assert abs(signed_volume(smoothed) / signed_volume(sphere) - 1.0) < 0.002
    assert abs(report.drift) < 1e-10
    assert abs(report.drift_filtered) < 0.01
    assert np.abs(np.linalg.norm(smoothed.points, axis=1) - 1.0).max() < 0.01


def test_the_thesis_option_is_what_the_thesis_ran():
    settings = SmoothingSettings(taubin="thesis", restore_volume=False)
    assert (settings.factors, settings.pairs) == ((0.40, -0.50), 40)
    sphere = shapes.icosphere(2)
    smoothed, _ = smooth(sphere, settings)
    assert np.array_equal(smoothed.points, taubin_filter(sphere, (0.40, -0.50), 40))


def test_agrees_with_the_loop_over_vertices():
    torus = shapes.torus(n_major=12, n_minor=7)
    factors = pass_band_factors()
    expected = torus.points
    for factor in factors * 2:
        expected = reference.laplacian_step(expected, torus.faces.tolist(), factor)
    assert np.allclose(taubin_filter(torus, factors, 2), expected, atol=1e-14)


def flat_grid(n, height):
    """An open grid [0, n]^2 of triangles with heights at its vertices."""
    i, j = (a.ravel() for a in np.meshgrid(range(n + 1), range(n + 1), indexing="ij"))
    k = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (q.ravel() for q in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return TriMesh(np.stack([i, j, height(i, j)], axis=1), faces)


@pytest.mark.parametrize("wave", [0.3, 0.9, 2.0, np.pi])
def test_waves_are_multiplied_by_the_transfer_function(wave):
    pairs = 3
    shrink, grow = pass_band_factors(0.6, 0.1)
    grid = flat_grid(40, lambda i, j: np.cos(wave * (i - 20)) + 0.0 * j)
    k = 1.0 - (4.0 * np.cos(wave) + 2.0) / 6.0  # six neighbours, two of them across the wave
    height = taubin_filter(grid, (shrink, grow), pairs)[20 * 41 + 20, 2]
    assert height == pytest.approx(((1.0 - shrink * k) * (1.0 - grow * k)) ** pairs, abs=1e-13)


def test_the_pass_band_is_neither_damped_nor_raised():
    shrink, grow = pass_band_factors(0.63, 0.1)
    assert (1.0 - shrink * 0.1) * (1.0 - grow * 0.1) == pytest.approx(1.0, abs=1e-15)
    assert grow == pytest.approx(-1.0 / (1.0 / 0.63 - 0.1))


@pytest.mark.parametrize("shrink, band", [(0.0, 0.1), (1.0, 0.1), (0.5, 2.0), (0.5, -0.1)])
def test_factors_that_do_not_filter_are_refused(shrink, band):
    with pytest.raises(InvalidCase, match="0 < lambda < 1"):
        pass_band_factors(shrink, band)


def test_rims_are_filtered_along_their_curve_only():
    mesh = fields.box((16, 16, 4), upper=(1.0, 1.0, 0.3))
    surface, _ = repair_slivers(
        extract_surface(fields.rod_field(mesh, 2, (0.5, 0.5), 0.3, width=0.08), crossing="linear")
    )
    structure = surface_structure(surface)
    points = taubin_filter(surface, pass_band_factors(), 10)
    other = np.array(surface.points)
    free = ~structure.on_curve
    other[free] += np.random.default_rng(0).normal(size=(free.sum(), 3))
    again = taubin_filter(surface.with_points(other), pass_band_factors(), 10)
    assert np.array_equal(points[structure.on_curve], again[structure.on_curve])
    radius = np.linalg.norm(points[structure.on_curve, :2] - 0.5, axis=1)
    before = np.linalg.norm(surface.points[structure.on_curve, :2] - 0.5, axis=1)
    assert radius.std() < 0.7 * before.std()


def test_the_inside_of_a_cap_follows_its_rim():
    field = fields.rod_field(fields.box(8), 2, (0.5, 0.5), 0.35)
    surface = extract_surface(field, crossing="linear")  # the jags that a filter takes out
    structure = surface_structure(surface)
    shift = np.where(structure.on_curve[:, None], [0.1, 0.2, 0.0], 0.0)
    moved = follow_rims(structure, shift, sweeps=300)
    assert structure.within_plane.any()
    assert np.allclose(moved[structure.within_plane], [0.1, 0.2, 0.0], atol=1e-3)
    assert np.all(moved[structure.within_plane, 2] == 0.0)


def _normal_error(surface, points, major):
    """Mean angle [degrees] between the faces' normals and a torus's at their middle."""
    middle = points[surface.faces].mean(axis=1)
    _, exact = shapes.TorusSurface(major, 0.2).value_and_gradient(middle)
    cosine = np.einsum("ij,ij->i", face_normals(points, surface.faces), exact)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean()


def test_pairs_are_doubled_as_long_as_they_take_out_roughness():
    mesh = fields.box((20, 20, 8), (-0.8, -0.8, -0.32), (0.8, 0.8, 0.32))
    taken, error = {}, {}
    for width in (0.06, 0.35):  # below and well above the mesh's edges
        field = fields.torus_field(mesh, 0.5, 0.2, width)
        surface, _ = repair_slivers(extract_surface(field, crossing="linear"))
        structure = surface_structure(surface)
        points, pairs = filter_until_smooth(surface, pass_band_factors(), structure)
        taken[width] = pairs
        error[width] = [_normal_error(surface, p, 0.5) for p in (surface.points, points)]
        assert np.array_equal(points, taubin_filter(surface, pass_band_factors(), pairs))
    assert taken[0.35] <= 10 < taken[0.06]
    assert error[0.06][1] < 0.35 * error[0.06][0]
    assert error[0.35][1] < 0.9 * error[0.35][0]
