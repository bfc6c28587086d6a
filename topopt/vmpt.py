"""The variable-metric projected gradient method: `method: vmpt`.

Each step minimises J'(phi)(v - phi) + 1/2 a(v - phi, v - phi) over box and volume and then
backtracks along v - phi until J falls enough (Armijo). The metric a is that of the flow's step,
gamma eps (grad, grad) + D, and a low-rank part that makes it agree with how the gradient changed
along the last steps (limited-memory BFGS, `topopt.secants`). The active sets of the programme are
those of box and volume, so that near a solution the method is a quasi-Newton one.

What past steps tell is not what the next one needs to know. So before a step is taken, the
programme's solution d is asked for J''(phi) d, which one more right side of the state problem
answers; the pair joins the metric, and the programme is solved again (`PRODUCTS` times).

Notes
-----
L. Blank, C. Rupprecht, An extension of the projected gradient method to a Banach space setting
with application in structural topology optimization, SIAM J. Control Optim. 55 (2017).
"""

from dataclasses import replace

import numpy as np

from topopt.flow import LEAST_DECREASE, Flow
from topopt.gradient import concavity, curvature_along
from topopt.pdas import solve_step
from topopt.secants import SecantMetric, Secants
from topopt.step_control import sufficient_decrease

PRODUCTS = 2  # with J'' in a step, at most
RESPONSE_TOLERANCE = 0.2  # relative residual; of u', J'' d and d.J'' d much less is off
MAX_TRIALS = 12
LEAST_CUT, MOST_CUT = 0.5, 0.1  # how much of a refused step the next trial keeps


class ProjectedGradient(Flow):
    """The method on one mesh; see `Flow` for the parameters."""

    _learnt = None  # the last step's SecantMetric: spares work if the next step goes on from it

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
        learnt = self._metric_that_knows(secants, metric)
        step, trial = self._informed_step(loop, metric, learnt)
        direction = step.x - loop.phi
        slope = float(loop.gradient @ direction)
        if not slope < -LEAST_DECREASE * abs(loop.objective):
            return None
        share, iterations = 1.0, trial.iterations
        for rejected in range(MAX_TRIALS):
            phi = step.x if rejected == 0 else self._between(loop.phi, direction, share)
            state = self._solve(loop, phi, trial.displacements(direction, share))
            iterations += state.iterations
            after = self.objective(phi, state)
            if sufficient_decrease(loop.objective, after, share * slope):
                rule = rule.accepted(first_try=True) if rejected == 0 else rule
                effort = (rejected, trial.systems, iterations)
                tau = self._tau(metric)
                there = self._arrive(phi, state, rule, loop.history, secants, tau, effort)
                learnt.learn(there.phi - loop.phi, there.gradient - loop.gradient)
                self._learnt = learnt
                return replace(there, secants=learnt.secants)
            share *= cut(share * slope, after - loop.objective)
            rule = rule.rejected()
        return None

    def _metric_that_knows(self, secants, diagonal):
        """The SecantMetric of the pairs over the base diag(diagonal) + gamma eps A."""
        if self._learnt is not None and self._learnt.secants is secants:
            return self._learnt.rebased(diagonal)
        return SecantMetric(secants, self.energy.stiffness, self.gamma * self.energy.eps, diagonal)

    def _informed_step(self, loop, metric, learnt):
        """The step of the programme whose metric knows how J bends along the steps before it.

        The SecantMetric takes in the pairs found on the way.

        Returns
        -------
        step : StepSolution
        found : Foresight
        """
        found, step = Foresight(self.mass, loop.state.displacements), None
        drafts = PRODUCTS
        while True:
            draft = drafts > 0
            programme = self._programme(loop, metric, learnt.low_rank_part(), draft)
            step = solve_step(programme, loop.phi if step is None else step.x, draft)
            found.systems += step.iterations
            if drafts == 0:
                return step, found
            direction = step.x - loop.phi
            falls = float(loop.gradient @ direction) < -LEAST_DECREASE * abs(loop.objective)
            drafts = drafts - 1 if falls else 0
            if falls:
                bend, response = self.curvature_along(loop, direction, found.change(direction))
                found.add(direction, response)
                learnt.learn(direction, bend)

    def curvature_along(self, loop, direction, guess=None):
        """J''(phi) d (n,) along a direction d (n,), and the model's Response to it.

        The guess (c, n, 3) of how the displacements change is where the solver starts.
        """
        terms = (loop.phi, loop.state, direction, RESPONSE_TOLERANCE, guess)
        response = self.model.response(*terms)
        elastic = curvature_along(self.model, loop.phi, loop.state, direction, response)
        change = self.energy.gradient(loop.phi + direction) - self.energy.gradient(loop.phi)
        return elastic + self.gamma * change, response

    def _between(self, phi, direction, share):
        """The field at a share of the way, within the bounds to the last bit."""
        return np.clip(phi + share * direction, self.lower, self.upper)


class Foresight:
    """What the products of one step told: the displacements' responses, and the work done.

    Parameters
    ----------
    mass : (n,) float array
    displacements : (c, n, 3) float array
        Where the step starts.
    """

    def __init__(self, mass, displacements):
        self._mass, self._start = mass, displacements
        self._directions, self._responses = [], []
        self.iterations = self.systems = 0

    def add(self, direction, response):
        """Remember a direction (n,) and the Response to it."""
        self._directions.append(direction)
        self._responses.append(response.displacements)
        self.iterations += response.iterations

    def change(self, direction):
        """How the displacements change along a direction, as far as known: (c, n, 3) or None."""
        if not self._directions:
            return None
        known = np.stack(self._directions)
        gram = (known * self._mass) @ known.T
        shares = np.linalg.lstsq(gram, known @ (self._mass * direction), rcond=1e-10)[0]
        return np.tensordot(shares, np.stack(self._responses), axes=1)

    def displacements(self, direction, share):
        """First-order guess (c, n, 3) of the displacements at a share of the way along a step."""
        change = self.change(direction)
        return self._start if change is None else self._start + share * change


def cut(slope, change):
    """Where the parabola through J, its slope < 0 and the change at the step's end is least.

    Kept within [0.1, 0.5] of the step.
    """
    least = -slope / (2.0 * (change - slope))
    return min(max(least, MOST_CUT), LEAST_CUT)
