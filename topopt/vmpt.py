"""The variable-metric projected gradient method: `method: vmpt`.

Each step minimises J'(phi)(v - phi) + 1/2 a(v - phi, v - phi) over box and volume and then
backtracks along v - phi until J falls enough (Armijo). The metric a is that of the flow's step,
gamma eps (grad, grad) + D, and a low-rank part that makes it agree with how the gradient changed
along the last steps (limited-memory BFGS, `topopt.secants`). The active sets of the programme are
those of box and volume, so that near a solution the method is a quasi-Newton one.

Notes
-----
L. Blank, C. Rupprecht, An extension of the projected gradient method to a Banach space setting
with application in structural topology optimization, SIAM J. Control Optim. 55 (2017).
"""

from dataclasses import replace

import numpy as np

from topopt.flow import LEAST_DECREASE, Flow
from topopt.gradient import concavity
from topopt.pdas import solve_step
from topopt.secants import Secants
from topopt.step_control import sufficient_decrease

MAX_TRIALS = 12
LEAST_CUT, MOST_CUT = 0.5, 0.1  # how much of a refused step the next trial keeps


class ProjectedGradient(Flow):
    """The method on one mesh; see `Flow` for the parameters."""

    def advance(self, loop):
        """Take one step: the new LoopState, or None if nothing decreases J any more."""
        advanced = self._descend(loop, loop.secants)
        if advanced is None and len(loop.secants.steps):
            advanced = self._descend(loop, Secants.none(len(loop.phi)))
        return advanced

    def _descend(self, loop, secants):
        """One step in the metric that the secants give, or None if J cannot be made to fall."""
        rule = loop.rule
        metric = rule.metric(self.mass, concavity(self.model, loop.phi, loop.state))
        programme = self._programme(loop, metric, secants)
        step = solve_step(programme, loop.phi)
        direction = step.x - loop.phi
        slope = float(loop.gradient @ direction)
        if not slope < -LEAST_DECREASE * abs(loop.objective):
            return None
        share, iterations = 1.0, 0
        for rejected in range(MAX_TRIALS):
            phi = step.x if rejected == 0 else self._between(loop.phi, direction, share)
            state = self._solve(loop, phi)
            iterations += state.iterations
            after = self.objective(phi, state)
            if sufficient_decrease(loop.objective, after, share * slope):
                rule = rule.accepted(first_try=True) if rejected == 0 else rule
                effort = (rejected, step.iterations, iterations)
                tau = self._tau(metric)
                there = self._arrive(phi, state, rule, loop.history, secants, tau, effort)
                pair = there.phi - loop.phi, there.gradient - loop.gradient
                return replace(there, secants=secants.after(*pair))
            share *= cut(share * slope, after - loop.objective)
            rule = rule.rejected()
        return None

    def _between(self, phi, direction, share):
        """The field at a share of the way, within the bounds to the last bit."""
        return np.clip(phi + share * direction, self.lower, self.upper)


def cut(slope, change):
    """Where the parabola through J, its slope < 0 and the change at the step's end is least.

    Kept within [0.1, 0.5] of the step.
    """
    least = -slope / (2.0 * (change - slope))
    return min(max(least, MOST_CUT), LEAST_CUT)
