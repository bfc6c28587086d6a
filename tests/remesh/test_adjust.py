"""The least-squares fit of triangles to a surface, and the volume."""

import numpy as np
import pytest

from meshes.quality import signed_volume
from remesh.adjust import (
    DAMPING,
    barycentric_samples,
    fit_vertices,
    free_rows,
    hold_forms,
    match_volume,
    root_areas,
    solve_fit,
)
from remesh.carrier import make_carrier
from remesh.connectivity import OFFSET
from remesh.fidelity import ImplicitFidelity, TriangleFidelity
from remesh.halfedge import WorkMesh
from tests.remesh import reference
from tests.remesh.shapes import cylinder
from tests.shapes import SphereSurface, icosphere

NO_LIMITS = (0.0, 0.0, 0.0)


def test_samples_are_the_centroids_of_equal_parts():
    for order in (1, 2, 3):
        samples = barycentric_samples(order)
        assert len(samples) == order**2
        np.testing.assert_allclose(samples.sum(axis=1), 1.0)
        np.testing.assert_allclose(samples.mean(axis=0), 1.0 / 3.0)
        assert samples.min() == pytest.approx(1.0 / (3 * order))


@pytest.mark.parametrize("sideways", [True, False])
def test_conjugate_gradients_solve_the_least_squares_problem(sideways):
    work = WorkMesh(make_carrier(icosphere(1)))
    rows = work.rows[: work.counts[0]]
    rng = np.random.default_rng(0)
    rows[:, OFFSET] = rng.normal(size=len(rows))
    corners, _ = work.corner_rows()
    samples = barycentric_samples(2)
    weights = rng.uniform(0.5, 1.0, len(corners))
    normals = rng.normal(size=(len(corners) * 4, 3))
    gaps = rng.normal(size=len(normals))
    free = rng.random(len(rows)) < 0.8
    step = np.zeros((len(rows), 3))
    if sideways:
        solve_fit(rows, corners, samples, weights, normals, gaps, free, 0.05, 0.1, 1.0, 2000, step)
        expected = reference.fit_steps(
            rows, corners, samples, weights, normals, gaps, free, DAMPING, 0.05, 0.1
        )
        assert np.abs(step - expected).max() < 0.02 * np.abs(expected).max()
    else:
        solve_fit(rows, corners, samples, weights, normals, gaps, free, 0.05, 0.1, 0.0, 2000, step)
        along = np.einsum("ij,ij->i", step, rows[:, 3:6])
        np.testing.assert_allclose(step, along[:, None] * rows[:, 3:6], atol=1e-12)
        assert np.abs(along[free]).max() > 0.0
    assert not step[~free].any()


def test_fit_balances_the_gaps_to_a_sphere():
    work = WorkMesh(make_carrier(icosphere(2)))
    gaps = ImplicitFidelity([SphereSurface()])
    corners, _ = work.corner_rows()
    samples = barycentric_samples(3)
    _, before = gaps(work, corners, samples, False)
    for _ in range(2):
        fit_vertices(work, gaps, 0.0, NO_LIMITS, order=3)
    _, after = gaps(work, work.corner_rows()[0], samples, False)
    assert before.min() > 0.0
    assert abs(after.mean()) < 0.02 * before.mean()
    assert np.sqrt((after**2).mean()) < 0.5 * np.sqrt((before**2).mean())


def test_gaps_to_triangles_are_the_distances_to_them():
    surface = make_carrier(icosphere(2))
    work = WorkMesh(make_carrier(icosphere(1)))
    faces = len(work.carrier.mesh.faces)
    gaps = TriangleFidelity(surface, np.zeros(faces, int))
    corners, _ = work.corner_rows()
    corners = corners[:3]
    samples = barycentric_samples(2)
    normals, gap = gaps(work, corners, samples, False)
    points = np.einsum("sk,mkd->msd", samples, work.rows[corners, :3]).reshape(-1, 3)
    for point, normal, distance in zip(points, normals, gap):
        expected = reference.closest_distance(point, surface.mesh)
        assert abs(distance) == pytest.approx(expected, rel=0.05)
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        assert normal @ point > 0.0
        assert distance > 0.0


def test_volume_is_matched_and_planes_stay():
    work = WorkMesh(make_carrier(cylinder()))
    mesh, _ = work.to_mesh()
    wanted = 1.01 * signed_volume(mesh)
    match_volume(work, wanted)
    result, _ = work.to_mesh()
    assert signed_volume(result) == pytest.approx(wanted, rel=1e-5)
    np.testing.assert_array_equal(np.unique(result.points[:, 2])[[0, -1]], [0.0, 2.0])
    free = free_rows(work)
    held = ~free
    np.testing.assert_array_equal(work.rows[: len(free)][held, OFFSET], 0.0)


def test_hold_forms_give_the_growth_of_the_squared_gaps():
    """At a minimum over one vertex, moving it by d adds d . A d to the sum of squared gaps."""
    rng = np.random.default_rng(5)
    corners = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]])
    samples = barycentric_samples(2)
    weights = rng.uniform(0.5, 1.0, 3)
    normals = rng.normal(size=(12, 3))
    lines = np.concatenate([w * samples[:, :1] for w in weights]) * normals
    gap = np.repeat(rng.normal(size=3), 4)
    right = np.repeat(weights, 4) * gap
    step, hold = np.zeros((4, 3)), np.zeros((4, 9))
    step[0] = np.linalg.lstsq(lines, right, rcond=None)[0]
    energy = hold_forms(corners, samples, weights, normals, gap, step, hold)
    assert energy == pytest.approx(np.sum((lines @ step[0] - right) ** 2))
    d = rng.normal(size=3)
    xx, yy, zz, xy, yz, zx = hold[0, 3:]
    form = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    grown = np.sum((lines @ (step[0] + d) - right) ** 2)
    assert grown - energy == pytest.approx(d @ form @ d)


def test_weights_are_the_roots_of_twice_the_areas():
    rows, corners = np.random.default_rng(4).normal(size=(9, 8)), np.arange(9).reshape(3, 3)
    weights = np.empty(3)
    root_areas(rows, corners, weights)
    a, b, c = (rows[corners[:, k], :3] for k in range(3))
    expected = np.sqrt(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    assert weights == pytest.approx(expected, rel=1e-12)
