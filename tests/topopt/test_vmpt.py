"""The projected gradient method against a dense optimiser, and against the flow."""

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.topopt.small_problems import cantilever
from topopt import vmpt
from topopt.optimize import METHODS, OptimizationSettings, optimize, prepare
from topopt.vmpt import cut

ENDLESS = {"tolerance": 0.0, "stagnation": 0.0, "solver": "direct", "state_tolerance": 1e-9}
NEAR = {"tolerance": 1e-3, "state_tolerance": 1e-4}


def dense_minimum(flow, start):
    """SLSQP on box and volume from a field (n,), in units of J at the start."""
    unit = abs(value_and_gradient(flow, start)[0])

    def scaled(phi):
        value, gradient = value_and_gradient(flow, np.clip(phi, 0.0, 1.0))
        return value / unit, gradient / unit

    constraint = {"type": "eq", "fun": lambda phi: flow.mass @ phi / flow.volume - 1.0}
    constraint["jac"] = lambda phi: flow.mass / flow.volume
    options = {"maxiter": 1000, "ftol": 1e-15}
    bounds = [(0.0, 1.0)] * len(start)
    return minimize(
        scaled, start, jac=True, method="SLSQP", bounds=bounds, constraints=[constraint],
        options=options,
    )  # fmt: skip


def value_and_gradient(flow, phi):
    state = flow.model.solve(phi, None, 1e-9)
    interface = flow.gamma * flow.energy.energy(phi)
    energy = flow.model.volumes * state.energy_density
    slope = np.zeros(len(phi))
    for tet, weight in zip(flow.model.mesh.tets, energy):  # d/dphi of the mean of phi^3, by hand
        p = phi[tet]
        for a, node in enumerate(tet):
            others = np.delete(p, a)
            pairs = others[0] * others[1] + others[0] * others[2] + others[1] * others[2]
            h2 = pairs + (others**2).sum()
            slope[node] -= weight * (h2 + 2.0 * p[a] * others.sum() + 3.0 * p[a] ** 2) / 20.0
    slope *= 1.0 - flow.model.material.void_ratio
    return state.compliance + interface, slope + flow.gamma * flow.energy.gradient(phi)


def test_agrees_with_sequential_quadratic_programming():
    mesh, problem = cantilever((3, 1, 2), eps=0.012, gamma=0.1)
    settings = OptimizationSettings(steps=200, **ENDLESS)
    result = optimize(mesh, problem, settings)
    phi = result.phase_field.values
    assert result.kkt.residual < 1e-6 and len(result.history) < 60
    flow = prepare(mesh, problem, settings)
    away = np.clip(phi + 0.02 * np.sin(np.arange(len(phi))), 0.0, 1.0)
    dense = dense_minimum(flow, away)
    assert np.sum((phi == 0.0) | (phi == 1.0)) > 5  # bounds matter
    np.testing.assert_allclose(phi, dense.x, atol=1e-6)


def test_needs_fewer_state_solves_than_the_flow():
    def solves(method, tolerance=1e-3):
        mesh, problem = cantilever((6, 2, 4))
        settings = {**ENDLESS, "tolerance": tolerance, "state_tolerance": 1e-4}
        result = optimize(mesh, problem, OptimizationSettings(400, method=method, **settings))
        assert result.outcome == "tolerance"
        assert np.all(np.diff([row.objective_J for row in result.history]) < 0)
        return sum(1 + row.rejected for row in result.history)

    assert 1.5 * solves("vmpt") < solves("allen_cahn")


def test_products_with_the_second_derivative_save_steps(monkeypatch):
    def steps(products):
        mesh, problem = cantilever((6, 2, 4))
        with monkeypatch.context() as patch:
            patch.setattr(vmpt, "PRODUCTS", products)
            result = optimize(mesh, problem, OptimizationSettings(400, **ENDLESS | NEAR))
        assert result.outcome == "tolerance"
        return len(result.history)

    assert 1.5 * steps(2) < steps(0)


def test_each_step_learns_from_its_products_and_guesses_the_displacements(monkeypatch):
    """The pairs are J'' d; the guess is right to first order: half the step, a quarter off."""
    guesses = []

    class Watched(vmpt.ProjectedGradient):
        def _solve(self, loop, phi, start=None):
            guesses.append((self, loop, phi, start))
            return super()._solve(loop, phi, start)

    mesh, problem = cantilever((4, 1, 2))
    monkeypatch.setitem(METHODS, "vmpt", Watched)
    result = optimize(mesh, problem, OptimizationSettings(4, **ENDLESS))
    secants = result.loop.secants
    assert len(secants.steps) == 4 * (vmpt.PRODUCTS + 1)
    flow, loop, phi, _ = guesses[-1]
    bend, _ = flow.curvature_along(loop, secants.steps[-2])
    np.testing.assert_allclose(bend, secants.changes[-2], atol=1e-9 * np.abs(bend).max())
    found = vmpt.Foresight(flow.mass, loop.state.displacements)
    direction = phi - loop.phi
    found.add(direction, flow.model.response(loop.phi, loop.state, direction, 1e-8))
    errors = []
    for share in (0.02, 0.01):
        exact = flow.model.solve(loop.phi + share * direction, None, 1e-8).displacements
        errors.append(np.abs(found.displacements(direction, share) - exact).max())
    assert 3.5 < errors[0] / errors[1] < 4.5


def test_pairs_are_steps_and_changes_of_the_gradient(monkeypatch):
    monkeypatch.setattr(vmpt, "PRODUCTS", 0)
    seen = []
    mesh, problem = cantilever((4, 1, 2))
    settings = OptimizationSettings(3, **ENDLESS)
    optimize(mesh, problem, settings, callback=lambda row, loop: seen.append(loop))
    steps = np.diff([loop.phi for loop in seen], axis=0)
    changes = np.diff([loop.gradient for loop in seen], axis=0)
    np.testing.assert_array_equal(seen[-1].secants.steps, steps)
    np.testing.assert_array_equal(seen[-1].secants.changes, changes)


def test_a_refused_step_is_cut_at_the_parabola():
    def parabola(x):
        return 2.0 * x * x - 1.4 * x  # least at 0.35

    assert cut(-1.4, parabola(1.0)) == pytest.approx(0.35)
    assert cut(-1.0, 1e6) == 0.1 and cut(-1.0, -0.5) == 0.5
