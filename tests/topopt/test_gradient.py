"""The gradient of J against finite differences, gravity off and on."""

from dataclasses import replace

import numpy as np
import pytest

from tests.topopt.small_problems import cantilever
from topopt.boundary import boundary_conditions
from topopt.elasticity import ElasticModel
from topopt.ginzburg_landau import GinzburgLandau
from topopt.gradient import compliance_gradient, concavity, curvature_along
from topopt.problem import Box, LoadCase, Support

# as strong as the load, or the factor 2 of the weight would not be seen
GRAVITY = {"off": (0.0, 0.0, 0.0), "on": (3e3, -2e3, -5e4)}


@pytest.fixture(scope="module", params=sorted(GRAVITY))
def objective(request):
    """J(phi) and its gradient, on a small cantilever."""
    mesh, problem = cantilever((3, 1, 2), gravity=GRAVITY[request.param])
    model = ElasticModel(mesh, problem, boundary_conditions(mesh, problem), solver="direct")
    energy = GinzburgLandau(mesh, problem.eps)

    def value_and_gradient(phi):
        state = model.solve(phi, None, 1e-8)
        gradient = compliance_gradient(model, phi, state)
        gradient += problem.gamma * energy.gradient(phi)
        return state.compliance + problem.gamma * energy.energy(phi), gradient

    return model, value_and_gradient


def test_taylor_remainder_is_of_second_order(objective):
    model, value_and_gradient = objective
    rng = np.random.default_rng(2)
    n = len(model.mesh.points)
    phi, direction = rng.uniform(0.3, 0.7, n), rng.normal(size=n)
    value, gradient = value_and_gradient(phi)
    steps = 1e-3 * 0.5 ** np.arange(5)
    remainders = [
        abs(value_and_gradient(phi + t * direction)[0] - value - t * (gradient @ direction))
        for t in steps
    ]
    slope = np.polyfit(np.log(steps), np.log(remainders), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.02)


def test_gradient_by_central_differences(objective):
    model, value_and_gradient = objective
    rng = np.random.default_rng(3)
    phi = rng.uniform(0.2, 0.8, len(model.mesh.points))
    gradient = value_and_gradient(phi)[1]
    for i in rng.choice(len(phi), 5, replace=False):
        step = np.zeros(len(phi))
        step[i] = 1e-4
        ahead, behind = (value_and_gradient(phi + s * step)[0] for s in (1, -1))
        assert (ahead - behind) / 2e-4 == pytest.approx(gradient[i], rel=1e-5)


def test_concavity_is_the_row_sum_of_the_second_derivative(objective):
    """Derivative of the elastic gradient in the direction of the constant 1, displacement held."""
    model, _ = objective
    rng = np.random.default_rng(4)
    phi = rng.uniform(0.2, 0.8, len(model.mesh.points))
    state = model.solve(phi, None, 1e-8)
    ahead, behind = (compliance_gradient(model, phi + s * 1e-4, state) for s in (1, -1))
    np.testing.assert_allclose(concavity(model, phi, state), (behind - ahead) / 2e-4, rtol=1e-6)
    np.testing.assert_array_less(0.0, concavity(model, phi, state))


def everything_at_once():
    """Two load cases, one with gravity and an imposed displacement, and a spring."""
    mesh, problem = cantilever((3, 1, 2), gravity=GRAVITY["on"])
    far = Box((0.06, 0.0, 0.03), (0.06, 0.02, 0.04))
    low = Box((0.02, 0.0, 0.0), (0.04, 0.02, 0.0))
    supports = (
        *problem.supports,
        Support("pull", far, (2,), displacement=(0.0, 0.0, 1e-4)),
        Support("spring", low, stiffness=1e9),
    )
    cases = (LoadCase("tip", ("tip",), 1.0, False), LoadCase("own", (), 0.7, True, ("pull",)))
    problem = replace(problem, supports=supports, load_cases=cases)
    return ElasticModel(mesh, problem, boundary_conditions(mesh, problem), solver="direct")


def test_second_derivative_along_a_direction(objective):
    rng = np.random.default_rng(5)
    for model in (objective[0], everything_at_once()):
        n = len(model.mesh.points)
        phi, direction = rng.uniform(0.3, 0.7, n), rng.normal(size=n)
        state = model.solve(phi, None, 1e-8)
        response = model.response(phi, state, direction, 1e-8)
        step, around = 1e-4, []
        for sign in (1, -1):
            moved = phi + sign * step * direction
            there = model.solve(moved, None, 1e-8)
            around.append((compliance_gradient(model, moved, there), there.displacements))
        exact, exact_change = ((a - b) / (2 * step) for a, b in zip(*around, strict=True))
        found = curvature_along(model, phi, state, direction, response)
        np.testing.assert_allclose(found, exact, atol=1e-6 * np.abs(exact).max())
        change = np.abs(exact_change).max()
        np.testing.assert_allclose(response.displacements, exact_change, atol=1e-6 * change)
