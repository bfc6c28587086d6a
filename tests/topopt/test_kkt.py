"""Optimality measures: zero at solutions, a part for each broken condition, no mesh in them."""

import numpy as np
import pytest

from meshes.structured import bcc_box
from topopt.ginzburg_landau import GinzburgLandau
from topopt.kkt import kkt_conditions
from topopt.projection import project_in_metric

PRESSURE = 2.0


def box(cells=(4, 4, 2)):
    """Nodes (n, 3), lumped mass and bounds of the unit box."""
    mesh = bcc_box((0, 0, 0), (1, 1, 1), cells)
    mass = GinzburgLandau(mesh, 1.0).mass
    return mesh.points, mass, np.zeros(len(mass)), np.ones(len(mass))


def measure(phi, density, mass, volume_fraction=None):
    """KKT of a field with the given pointwise gradient [Pa]."""
    volume = mass @ phi if volume_fraction is None else volume_fraction * mass.sum()
    bounds = np.zeros(len(phi)), np.ones(len(phi))
    return kkt_conditions(phi, mass * density, mass, volume, PRESSURE, *bounds)


def profile(points):
    """A field with nodes at both bounds and between, and its sets."""
    phi = np.clip(3.0 * points[:, 0] - 1.0, 0.0, 1.0)
    return phi, phi == 0, phi == 1, (phi > 0) & (phi < 1)


def stationary_density(points, kappa=-5.0):
    """-kappa between the bounds, multipliers of the right sign on them."""
    phi, lower, upper, _ = profile(points)
    return phi, -kappa + np.where(lower, 3.0, 0.0) - np.where(upper, 4.0, 0.0)


def test_all_parts_vanish_at_a_stationary_point():
    points, mass, *_ = box()
    kkt = measure(*stationary_density(points), mass)
    assert kkt.kappa == pytest.approx(-5.0, rel=1e-14)
    assert kkt.scale == pytest.approx(5.0)
    for part in (kkt.residual, kkt.stationarity, kkt.complementarity, kkt.sign, kkt.volume_error):
        assert part == pytest.approx(0.0, abs=1e-14)


def test_each_broken_condition_shows_in_its_part():
    points, mass, *_ = box()
    phi, density = stationary_density(points)
    _, lower, upper, inactive = profile(points)
    total = mass.sum()

    wave = np.where(inactive, np.sin(9 * points[:, 1]), 0.0)
    wave[inactive] -= mass[inactive] @ wave[inactive] / mass[inactive].sum()
    kkt = measure(phi, density + wave, mass)
    assert kkt.stationarity == pytest.approx(np.sqrt(mass @ wave**2 / total) / 5, rel=1e-12)
    assert kkt.sign == 0.0 and kkt.residual > 0 and kkt.complementarity > 0

    corner = lower & (points[:, 1] > 0.8)
    kkt = measure(phi, density - 4.0 * corner, mass)
    assert kkt.sign == pytest.approx(np.sqrt(mass[corner].sum() / total) / 5, rel=1e-12)
    assert kkt.stationarity == pytest.approx(0.0, abs=1e-14) and kkt.residual > 0

    corner = upper & (points[:, 1] > 0.8)
    kkt = measure(phi, density + 6.0 * corner, mass)
    assert kkt.sign == pytest.approx(2 * np.sqrt(mass[corner].sum() / total) / 5, rel=1e-12)

    kkt = measure(phi, density, mass, volume_fraction=0.6)
    assert kkt.volume_error == pytest.approx(1 - mass @ phi / (0.6 * total), rel=1e-9)


def test_residual_vanishes_exactly_at_minimisers():
    """min 1/2 |x - t|^2 over box and volume: its solution has residual 0, others do not."""
    points, mass, lower, upper = box()
    target = 1.5 * np.sin(7 * points @ [1.0, 0.6, 0.3])
    volume = 0.4 * mass.sum()
    phi, kappa = project_in_metric(mass * target, mass, mass, volume, lower, upper)
    kkt = kkt_conditions(phi, mass * (phi - target), mass, volume, PRESSURE, lower, upper)
    assert kkt.residual < 1e-13 and kkt.sign < 1e-13
    assert kkt.kappa == pytest.approx(kappa, abs=1e-12)
    other = np.full(len(mass), 0.4)
    gradient = mass * (other - target)
    assert kkt_conditions(other, gradient, mass, volume, PRESSURE, lower, upper).residual > 0.1


def test_parts_do_not_depend_on_mesh_units_or_size():
    def parts(cells, pascal=1.0, metre=1.0):
        points, mass, *_ = box(cells)
        mass = metre**3 * mass
        phi = np.clip(1.5 * points[:, 0] - 0.2, 0.0, 1.0)
        density = 4.0 + np.sin(5 * points[:, 1]) + np.where(phi >= 1, 1.0, 0.0)
        bounds = np.zeros(len(phi)), np.ones(len(phi))
        terms = (pascal * mass * density, mass, mass @ phi, pascal * PRESSURE, *bounds)
        kkt = kkt_conditions(phi, *terms)
        return np.array([kkt.residual, kkt.stationarity, kkt.complementarity, kkt.sign])

    coarse, fine, scaled = parts((8, 8, 2)), parts((16, 16, 4)), parts((8, 8, 2), 1e9, 1e-3)
    np.testing.assert_allclose(scaled, coarse, rtol=1e-9)
    np.testing.assert_allclose(fine, coarse, rtol=0.06)


def test_free_volume_and_fields_without_inactive_nodes():
    points, mass, lower, upper = box()
    phi = np.where(points[:, 0] > 0.5, 1.0, 0.0)
    density = np.where(points[:, 0] > 0.5, -1.0, 3.0)
    kkt = measure(phi, density, mass)
    assert kkt.kappa == pytest.approx(-1.0)  # midway between 1 and -3
    assert kkt.residual < 1e-14 and kkt.sign == 0.0
    kkt = kkt_conditions(phi, mass * (density + 2.0), mass, None, PRESSURE, lower, upper)
    assert kkt.kappa == 0.0 and kkt.volume_error == 0.0
    assert kkt.sign > 0 and kkt.residual > 0


def test_held_nodes_have_no_sign():
    points, mass, lower, upper = box()
    phi, density = stationary_density(points)
    held = points[:, 1] > 0.7
    density = density + np.where(held, 50.0 * np.where(phi > 0.5, 1, -1), 0.0)
    lower[held] = upper[held] = phi[held]
    kkt = kkt_conditions(phi, mass * density, mass, mass @ phi, PRESSURE, lower, upper)
    assert kkt.sign == 0.0 and kkt.stationarity < 1e-14 and kkt.residual < 1e-14
