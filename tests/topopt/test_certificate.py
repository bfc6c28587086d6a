"""The certificate: right figures at a good design, and a planted bug in the gradient is seen."""

import numpy as np
import pytest

from tests.topopt.small_problems import cantilever
from topopt import flow as flow_module
from topopt.certificate import certify
from topopt.optimize import OptimizationSettings, optimize, prepare

ENDLESS = {"tolerance": 0.0, "stagnation": 0.0}


def certificate(steps, gravity=(0.0, 0.0, 0.0)):
    mesh, problem = cantilever((6, 2, 4), gravity=gravity)
    settings = OptimizationSettings(steps, solver="direct", **ENDLESS)
    result = optimize(mesh, problem, settings)
    flow = prepare(mesh, problem, settings, result.loop)
    return certify(flow, result.loop, np.random.default_rng(5)), result


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.0, 0.0, -9.81e4)])
def test_derivatives_are_those_of_the_objective(gravity):
    found, _ = certificate(10, gravity)
    assert len(found.derivatives) == 2
    for check in found.derivatives:
        assert check.relative_error < 1e-5
        assert abs(check.derivative) > 1e-3 * found.objective_J
    first, second = found.derivatives
    assert first.derivative != second.derivative


def test_tells_optimality_from_the_state_solved_tightly():
    early, _ = certificate(3)
    late, result = certificate(60)
    assert late.kkt.residual < 0.05 * early.kkt.residual
    assert late.kkt.residual == pytest.approx(result.kkt.residual, rel=0.01)
    assert late.bounds_violation == 0.0 and late.kkt.volume_error < 1e-12
    assert late.state_residual < 1e-8
    assert late.objective_J == pytest.approx(result.history[-1].objective_J, rel=1e-9)
    again, _ = certificate(60)
    assert again.as_dict() == late.as_dict()


def test_a_bug_in_the_gradient_is_seen(monkeypatch):
    right = flow_module.compliance_gradient
    monkeypatch.setattr(
        flow_module, "compliance_gradient", lambda *arguments: 1.001 * right(*arguments)
    )
    found, _ = certificate(5)
    assert max(check.relative_error for check in found.derivatives) > 1e-4
