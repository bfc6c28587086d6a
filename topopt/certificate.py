"""The proof that a run hands over with its design: optimality, and a check of the derivatives.

The state is solved anew, to a tight tolerance, so that nothing in the certificate rests on the
loose solves of the way. The derivatives are compared with central differences of J itself, whose
states need not be as exact: the compliance errs by the square of the state's residual.
"""

from dataclasses import asdict, dataclass

import numpy as np

from topopt.kkt import KKT

STATE_TOLERANCE = 1e-8
DIFFERENCE_TOLERANCE = 1e-6  # of the states on both sides
DIRECTIONS = 2
LONGEST_CHANGE = 1e-4  # of phi at any node, in the differences


@dataclass(frozen=True)
class DerivativeCheck:
    """One direction d of the comparison.

    Parameters
    ----------
    derivative, difference : float [J]
        grad J . d, and (J(phi + t d) - J(phi - t d)) / (2 t), with the largest entry of d being 1.
    step : float
        t.
    relative_error : float
        Of the derivative against the difference, relative to the larger one.
    """

    derivative: float
    difference: float
    step: float
    relative_error: float


@dataclass(frozen=True)
class Certificate:
    """How far a design is from optimal, and whether its derivatives are right.

    Parameters
    ----------
    kkt : KKT
        Its figures do not depend on the mesh size: stationarity on the inactive nodes,
        complementarity, signs of the multipliers, volume, and the residual of all in one.
    bounds_violation : float
        How far phi leaves its bounds.
    state_residual : float
        |f - K u| / |f| of the state that the figures are computed with.
    compliance_error_J : float [J]
        Estimate of the compliance's error by that residual.
    objective_J : float [J]
    derivatives : tuple of DerivativeCheck
    """

    kkt: KKT
    bounds_violation: float
    state_residual: float
    compliance_error_J: float
    objective_J: float
    derivatives: tuple[DerivativeCheck, ...]

    def as_dict(self):
        """The figures by name, for JSON."""
        return asdict(self)


def certify(flow, loop, rng):
    """Measure a run's last design.

    Parameters
    ----------
    flow : Flow
        See `topopt.optimize.prepare`.
    loop : LoopState
        Where the run ended.
    rng : numpy.random.Generator
        Draws the directions of the differences.

    Returns
    -------
    Certificate
    """
    phi = loop.phi
    state = flow.model.solve(phi, loop.state.displacements, STATE_TOLERANCE)
    gradient = flow.gradient(phi, state)
    outside = np.maximum(flow.lower - phi, phi - flow.upper)
    checks = [check_derivative(flow, phi, state, gradient, rng) for _ in range(DIRECTIONS)]
    return Certificate(
        kkt=flow.conditions(phi, gradient),
        bounds_violation=float(outside.max(initial=0.0)),
        state_residual=state.residual,
        compliance_error_J=state.compliance_error,
        objective_J=flow.objective(phi, state),
        derivatives=tuple(checks),
    )


def check_derivative(flow, phi, state, gradient, rng):
    """Compare the gradient (n,) at phi (n,) with a central difference along a random direction.

    The nodes' parts are drawn of one sign where the gradient is negative and of the other where it
    is positive, so that they do not cancel and every node counts.
    """
    direction = rng.uniform(0.5, 1.0, len(phi)) * np.where(gradient < 0.0, 1.0, -1.0)
    direction *= np.where(flow.upper > flow.lower, 1.0, 0.0)
    direction /= np.abs(direction).max(initial=1e-300)
    derivative, t = float(gradient @ direction), LONGEST_CHANGE
    values, start = [], state.displacements
    for sign in (1.0, -1.0):
        moved = phi + sign * t * direction
        there = flow.model.solve(moved, start, DIFFERENCE_TOLERANCE, near=True)
        values.append(flow.objective(moved, there))
        start = 2.0 * state.displacements - there.displacements  # to second order in t
    difference = (values[0] - values[1]) / (2.0 * t)
    size = max(abs(derivative), abs(difference)) or 1.0
    return DerivativeCheck(derivative, difference, t, abs(derivative - difference) / size)
