"""The Ginzburg-Landau energy: matrices, gradient, constants per area, and its flow alone."""

import numpy as np
import pytest

from meshes.structured import bcc_box
from topopt.ginzburg_landau import POTENTIALS, GinzburgLandau, interface_width
from topopt.optimize import OptimizationSettings, optimize
from topopt.problem import BoxDomain, Problem


def bar(elements_across, width=1.0):
    """A quasi-1D bar along x, four interface widths long, with eps such that one is `width`."""
    eps = width * np.sqrt(2.0) / np.pi
    h = width / elements_across
    cells = (4 * elements_across, 1, 1)
    return bcc_box((-2 * width, 0, 0), (2 * width, h, h), cells), eps


def sine_profile(x, eps):
    """Equilibrium of the obstacle potential, 1/2 at x = 0."""
    return 0.5 * (1.0 + np.sin(np.clip(np.sqrt(2.0) * x / eps, -np.pi / 2, np.pi / 2)))


def tanh_profile(x, eps):
    """Equilibrium of the double well: eps phi' = sqrt(2 Psi) = phi (1 - phi) / sqrt 2."""
    return 0.5 * (1.0 + np.tanh(x / (2.0 * np.sqrt(2.0) * eps)))


def test_linear_field_has_its_exact_gradient_energy():
    mesh = bcc_box((0, 0, 0), (2, 1, 1), (4, 2, 2))
    energy = GinzburgLandau(mesh, 0.5)
    phi = mesh.points @ [0.3, -0.2, 0.1]
    assert phi @ (energy.stiffness @ phi) == pytest.approx(2 * (0.09 + 0.04 + 0.01), rel=1e-12)
    assert np.abs(energy.stiffness @ np.ones(len(phi))).max() < 1e-13
    assert energy.mass.sum() == pytest.approx(2.0, rel=1e-13)


@pytest.mark.parametrize("potential", sorted(POTENTIALS))
def test_gradient_is_that_of_the_energy(potential):
    rng = np.random.default_rng(1)
    mesh = bcc_box((0, 0, 0), (1, 1, 1), (2, 2, 2))
    energy = GinzburgLandau(mesh, 0.3, potential)
    phi, direction = rng.uniform(0, 1, (2, len(mesh.points)))
    steps = np.array([1e-2, 1e-3])
    slope = energy.gradient(phi) @ direction
    remainders = [abs(energy.energy(phi + t * direction) - energy.energy(phi) - t * slope)
                  for t in steps]  # fmt: skip
    assert np.log10(remainders[0] / remainders[1]) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize(
    "potential, constant, profile",
    [("obstacle", 0.55536, sine_profile), ("double_well", 0.11785, tanh_profile)],
)
def test_energy_per_unit_area(potential, constant, profile):
    """An equilibrium interface costs sqrt2 pi / 8, or 1 / (6 sqrt2); converging at order 2."""
    assert POTENTIALS[potential].energy_constant == pytest.approx(constant, abs=5e-6)
    errors = []
    for elements in (8, 16):
        mesh, eps = bar(elements)
        eps = eps if potential == "obstacle" else eps / 8  # the tails of tanh must fit in
        energy = GinzburgLandau(mesh, eps, potential)
        area = 1.0 / elements**2
        errors.append(energy.energy(profile(mesh.points[:, 0], eps)) / area / constant - 1.0)
    assert abs(errors[1]) < (2e-3 if potential == "obstacle" else 5e-2)
    assert np.log2(abs(errors[0] / errors[1])) > 1.5


def test_flow_finds_the_sine_profile():
    """Elasticity off, the volume held: a step function relaxes to the obstacle profile."""
    mesh, eps = bar(12)
    x = mesh.points[:, 0]
    problem = Problem(BoxDomain((-2, 0, 0), (2, 1, 1)), (), (), 0.5, gamma=1.0, eps=eps)
    settings = OptimizationSettings(steps=60, tolerance=1e-9, stagnation=0.0)
    result = optimize(mesh, problem, settings, start=(x > 0).astype(float))
    phi = result.phase_field.values
    assert result.kkt.residual < 1e-6
    np.testing.assert_allclose(phi, sine_profile(x, eps), atol=0.01)
    assert np.abs(x[(phi > 0) & (phi < 1)]).max() < 0.5
    order = np.argsort(x)
    quarter = np.interp([0.25, 0.75], phi[order], x[order])
    assert 3.0 * np.ptp(quarter) == pytest.approx(interface_width(eps), rel=0.01)
    assert interface_width(eps) == pytest.approx(1.0)
