"""Quadratic crossings, spread crossings, diffusion, and the level that meets a volume."""

import numpy as np
import pytest

from isosurface import (
    crossing,
    diffused,
    extract_surface,
    mirror,
    modelled_volume,
    surface_level,
)
from isosurface.crossing import profile_angle
from isosurface.local_quadratics import local_quadratics
from meshes import InvalidCase, PhaseField
from meshes.quality import triangle_angles
from meshes.self_intersection import self_intersecting_faces
from meshes.topology import require_valid
from tests.isosurface import fields

CENTRE = (0.5, 0.48, 0.53)


def ball(cells=12, width=0.35):
    return fields.sphere_field(fields.box(cells), CENTRE, 0.31, width)


def distances(surface):
    return np.abs(np.linalg.norm(surface.points - CENTRE, axis=1) - 0.31)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_local_quadratics_reproduce_quadratics(scale):
    rng = np.random.default_rng(0)
    points, at = scale * rng.random((300, 3)), scale * (0.3 + 0.4 * rng.random((7, 3)))
    half = rng.standard_normal((3, 3)) / scale**2
    slope = rng.standard_normal(3) / scale
    values = points @ slope + np.einsum("ni,ij,nj->n", points, half, points)
    found = local_quadratics(points, values, at, 40)
    assert (found.misfit < 0.02).all()
    exact = at @ slope + np.einsum("ni,ij,nj->n", at, half, at)
    np.testing.assert_allclose(found.values, exact, atol=0.01)
    np.testing.assert_allclose(
        found.hessians * scale**2, scale**2 * np.array([half + half.T] * 7), atol=0.2
    )
    expected = slope + at @ (half + half.T)
    np.testing.assert_allclose(found.gradients * scale, expected * scale, atol=0.03)


def test_quadratic_crossings_are_several_times_as_close():
    error = {
        name: np.sqrt(np.mean(distances(extract_surface(ball(), crossing=name)) ** 2))
        for name in ("linear", "sine", "quadratic")
    }
    assert error["quadratic"] < 0.25 * error["sine"] <= 0.25 * error["linear"]


def test_newton_puts_inner_vertices_on_the_level_and_no_others():
    field = ball()
    linear, quadratic, newton = (
        extract_surface(field, crossing=name) for name in ("linear", "quadratic", "newton")
    )
    assert len(newton.faces) == len(quadratic.faces)  # quads may have the other diagonal
    assert np.sqrt(np.mean(distances(newton) ** 2)) < 0.25 * np.sqrt(
        np.mean(distances(linear) ** 2)
    )
    edge = np.linalg.norm(newton.points - quadratic.points, axis=1)
    assert 0.0 < edge.max() < 0.02
    cut = fields.sphere_field(fields.box(12), (0.5, 0.5, 0.9), 0.31, 0.35)  # with a cap
    before, after = (extract_surface(cut, crossing=name) for name in ("quadratic", "newton"))
    caps = np.unique(after.faces[after.face_labels != 0])
    np.testing.assert_array_equal(after.points[caps], before.points[caps])
    assert (after.points != before.points).any()
    require_valid(after)
    with pytest.raises(InvalidCase, match="spread must be 0"):
        extract_surface(field, crossing="newton", spread=0.1)


def test_misfit_is_the_noise_of_the_values():
    rng = np.random.default_rng(0)
    points, at = rng.random((4000, 3)), 0.3 + 0.4 * rng.random((300, 3))
    noisy = points @ [1.0, 2.0, 3.0] + 0.2 * rng.standard_normal(4000)
    for neighbours in (16, 40):
        misfit = local_quadratics(points, noisy, at, neighbours).misfit
        assert np.sqrt(np.mean(misfit**2)) == pytest.approx(0.2, rel=0.2)
    assert np.isinf(local_quadratics(points, noisy, at, 10).misfit).all()


def test_quadratics_that_the_nodes_do_not_lie_on_are_trusted_less(monkeypatch):
    """Nodes of a ball's profile that lie off it by 0.2 radians, as those of coarse designs do."""
    rng = np.random.default_rng(0)
    exact = ball()
    inner = (exact.values > 0.0) & (exact.values < 1.0)
    angle = profile_angle(exact.values) + 0.2 * inner * rng.standard_normal(len(inner))
    noisy = PhaseField(exact.mesh, 0.5 * (1.0 + np.sin(np.clip(angle, -np.pi / 2, np.pi / 2))))
    error = {}
    for name, field in (("exact", exact), ("noisy", noisy)):
        for misfit in (crossing.MISFIT, 1e9):
            monkeypatch.setattr(crossing, "MISFIT", misfit)
            error[name, misfit] = np.sqrt(np.mean(distances(extract_surface(field)) ** 2))
            monkeypatch.undo()
    assert error["noisy", crossing.MISFIT] < 0.98 * error["noisy", 1e9]
    assert error["exact", crossing.MISFIT] == pytest.approx(error["exact", 1e9], rel=0.02)


def test_a_node_at_the_level_and_a_sharp_interface_give_proper_surfaces():
    mesh = fields.box(6)
    for values in (
        np.where(mesh.points[:, 0] <= 0.5, 0.5, 0.2),
        (np.linalg.norm(mesh.points - CENTRE, axis=1) < 0.3).astype(float),
    ):
        surface = extract_surface(PhaseField(mesh, values), crossing="quadratic")
        require_valid(surface)
        assert not self_intersecting_faces(surface.points, surface.faces).any()


@pytest.mark.parametrize("seed", range(6))
def test_spread_keeps_topology_and_faces_apart(seed):
    field = fields.random_field(np.random.default_rng(seed), 2, "xy")
    plain, spread = extract_surface(field), extract_surface(field, spread=0.3)
    assert len(plain.points) == len(spread.points)
    whole = mirror(spread, field.mesh.symmetry)
    require_valid(whole)
    assert not self_intersecting_faces(whole.points, whole.faces).any()


def test_spread_takes_slivers_out_and_stays_on_the_surface():
    plain, spread = extract_surface(ball()), extract_surface(ball(), spread=0.3)

    def slivers(mesh):
        return np.mean(np.degrees(triangle_angles(mesh.points, mesh.faces)).min(axis=1) < 20.0)

    assert slivers(spread) < 0.4 * slivers(plain)
    rms = [np.sqrt(np.mean(distances(mesh) ** 2)) for mesh in (plain, spread)]
    assert rms[1] < 1.5 * rms[0]
    with pytest.raises(InvalidCase, match="spread must lie in"):
        extract_surface(ball(4), spread=0.5)


def test_surface_level_meets_the_volume():
    field, volume = ball(), 0.13
    symmetry = field.mesh.symmetry
    level = surface_level(
        field, volume, lambda at: modelled_volume(extract_surface(field, at), symmetry)
    )
    assert modelled_volume(extract_surface(field, level)) == pytest.approx(volume, rel=2e-6)


def test_diffusion_damps_a_wave_by_its_factor_and_keeps_the_mean():
    mesh, length = fields.box((40, 2, 2)), 0.05
    wave = np.cos(2.0 * np.pi * mesh.points[:, 0])
    after = diffused(PhaseField(mesh, 0.5 + 0.4 * wave), length)
    factor = 1.0 / (1.0 + (2.0 * np.pi * length) ** 2)
    np.testing.assert_allclose(after.values, 0.5 + 0.4 * factor * wave, atol=1e-3)
    flat = diffused(PhaseField(mesh, np.full(len(wave), 0.3)), length)
    np.testing.assert_allclose(flat.values, 0.3, atol=1e-9)
    with pytest.raises(InvalidCase, match="diffusion length"):
        diffused(flat, -1.0)


def test_profile_angle_is_the_argument_of_the_sine():
    angle = np.linspace(-1.5, 1.5, 7)
    np.testing.assert_allclose(profile_angle(0.5 * (1 + np.sin(angle))), angle, atol=1e-12)
    np.testing.assert_allclose(profile_angle([-0.1, 1.1]), [-np.pi / 2, np.pi / 2])
