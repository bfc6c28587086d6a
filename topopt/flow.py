"""One run's machinery: what is fixed during it (`Flow`) and what a step changes (`LoopState`)."""

import time
from dataclasses import dataclass, replace

import numpy as np

from topopt.box_qp import CG_TOLERANCE, StepQP
from topopt.elasticity import State
from topopt.ginzburg_landau import GinzburgLandau
from topopt.gradient import compliance_gradient, concavity
from topopt.history import HistoryRow
from topopt.kkt import KKT, kkt_conditions
from topopt.parameters import auto_gamma
from topopt.pdas import solve_step
from topopt.projection import project_volume
from topopt.secants import Secants
from topopt.step_control import FixedStep, first_rule, sufficient_decrease

MAX_REJECTIONS = 40
STAGNATION_STEPS = 5
LEAST_DECREASE = 1e-13  # relative; below, J is only rounding
FINEST_TOLERANCE = 1e-10
FIRST_TOLERANCE = 1e-2  # of the state at the start, which tau and an open gamma follow
LAST_TOLERANCE = 1e-6  # of the state that a run ends with
STATE_SHARE = 1.0  # of the root of the last step's gain: how exactly the next state is solved
ERROR_SHARE = 0.1  # of the last step's gain: most that a compliance may be off by, as estimated
QP_SHARE = 1e-4  # of the KKT residual: how exactly a step's programme is solved
LOOSEST_QP = 1e-5
DRAFT = 100.0  # so much less exactly where the solution is only asked for a product with J''


@dataclass(frozen=True, eq=False)
class LoopState:
    """All that the next step depends on.

    Parameters
    ----------
    phi : (n,) float array
    state : State
        The state problem's solution for phi.
    gradient : (n,) float array [J]
        Nodal derivatives of J at phi.
    rule : FixedStep
        Or a subclass; holds tau.
    kkt : KKT
    gamma, eps : float
        As used; a run that is continued keeps them.
    history : tuple of HistoryRow
    secants : Secants
        What the last steps told about the second derivative; empty where the method is
        allen_cahn.
    """

    phi: np.ndarray
    state: State
    gradient: np.ndarray
    rule: FixedStep
    kkt: KKT
    gamma: float
    eps: float
    history: tuple[HistoryRow, ...]
    secants: Secants

    @property
    def level(self):
        """The mesh it is on, from 1, the coarsest of nested ones."""
        return self.history[-1].level

    @property
    def rows(self):
        """The rows of the history that belong to its level: the level's start and its steps."""
        return tuple(row for row in self.history if row.level == self.level)

    @property
    def values(self):
        """Nodal values (n,) of the phase field, under the name they have in a PhaseField."""
        return self.phi

    @property
    def objective(self):
        """J [J]."""
        return self.history[-1].objective_J


class Flow:
    """The flow of one problem on one mesh: `method: allen_cahn`.

    Parameters
    ----------
    mesh : TetMesh
    model : ElasticModel
        Or anything with its `solve`, `mesh`, `geometry`, `volumes`, `material` and `gravity`.
    settings : OptimizationSettings
    volume_fraction : float
    eps : float [m]
    gamma : float or None [J/m^2]
        None chooses it from the compliance of the start.
    seconds : float
        Wall time already spent.
    bounds : pair of (n,) float arrays, optional
        Least and greatest phi at every node, equal in passive regions; 0 and 1 if not given.
    level : int
        Number of the mesh among nested ones, from 1.
    """

    def __init__(
        self, mesh, model, settings, volume_fraction, eps, gamma, seconds=0.0, bounds=None, level=1
    ):
        self.model, self.settings, self.gamma, self.level = model, settings, gamma, level
        self.volume_fraction = volume_fraction
        self.energy = GinzburgLandau(mesh, eps, geometry=model.geometry)
        self.mass = self.energy.mass
        self.domain_volume = float(self.mass.sum())
        self.volume = volume_fraction * self.domain_volume if settings.volume_constraint else None
        nodes = len(self.mass)
        self.lower, self.upper = bounds or (np.zeros(nodes), np.ones(nodes))
        self._began = time.perf_counter() - seconds

    @property
    def pressure(self):
        """gamma / eps [Pa]: the scale of the interface's driving force."""
        return self.gamma / self.energy.eps

    def first(self, start=None, history=()):
        """The loop's state before the first step, from nodal values (n,) or phi = m.

        `history` holds the rows of coarser levels.
        """
        phi = np.full(len(self.mass), self.volume_fraction) if start is None else start
        if self.volume is None:
            phi = np.clip(phi, self.lower, self.upper)
        else:
            phi = project_volume(phi, self.mass, self.volume, self.lower, self.upper)
        state = self.model.solve(phi, None, min(self.settings.state_tolerance, FIRST_TOLERANCE))
        if self.gamma is None:
            whole = (state.compliance, self.volume_fraction, self.domain_volume, self.energy.eps)
            self.gamma = auto_gamma(*whole)
        curvature = concavity(self.model, phi, state)
        rule = first_rule(self.settings, self.pressure, float(curvature.sum()) / self.domain_volume)
        tau = self._tau(rule.metric(self.mass, curvature))
        return self._arrive(phi, state, rule, history, Secants.none(len(phi)), tau)

    def advance(self, loop):
        """Take one accepted step: the new LoopState, or None if nothing decreases J any more."""
        rule = loop.rule
        curvature = concavity(self.model, loop.phi, loop.state)
        counts = np.zeros(2, int)  # systems of the quadratic programmes, iterations of the states
        for rejected in range(MAX_REJECTIONS):
            metric = rule.metric(self.mass, curvature)
            step = solve_step(self._programme(loop, metric), loop.phi)
            slope = float(loop.gradient @ (step.x - loop.phi))
            if rule.monotone and not slope < -LEAST_DECREASE * abs(loop.objective):
                return None
            state = self._solve(loop, step.x)
            counts += step.iterations, state.iterations
            after = self.objective(step.x, state)
            if not rule.monotone or sufficient_decrease(loop.objective, after, slope):
                effort = (rejected, *counts.tolist())
                rule = rule.accepted(first_try=rejected == 0)
                tau = self._tau(metric)
                return self._arrive(step.x, state, rule, loop.history, loop.secants, tau, effort)
            rule = rule.rejected()
        return None

    def outcome(self, loop):
        """Why the run ends here, or None if it goes on."""
        settings, history = self.settings, loop.rows
        if len(history) > settings.steps:
            return "steps"
        if loop.kkt.residual < settings.tolerance:
            return "tolerance"
        if settings.stagnation > 0.0 and len(history) > STAGNATION_STEPS:
            before = history[-1 - STAGNATION_STEPS].objective_J
            if before - loop.objective < settings.stagnation * abs(before):
                return "stagnation"
        return None

    def objective(self, phi, state):
        """J [J] at phi (n,), its state given."""
        return state.compliance + self.gamma * self.energy.energy(phi)

    def gradient(self, phi, state):
        """Nodal derivatives (n,) [J] of J at phi (n,), its state given."""
        elastic = compliance_gradient(self.model, phi, state)
        return elastic + self.gamma * self.energy.gradient(phi)

    def conditions(self, phi, gradient):
        """The KKT of a field (n,) with the nodal derivatives (n,) of J."""
        volume = (self.volume, self.pressure, self.lower, self.upper)
        return kkt_conditions(phi, gradient, self.mass, *volume)

    def polished(self, phi, state):
        """The State of phi (n,), as exact as what a run ends with is told."""
        if state.residual <= LAST_TOLERANCE:
            return state
        return self.model.solve(phi, state.displacements, LAST_TOLERANCE)

    def _programme(self, loop, metric, low_rank=(), draft=False):
        """The quadratic programme of one step from `loop` in the metric D (n,) + W^T C W."""
        stiffness, coupling = self.energy.stiffness, self.gamma * self.energy.eps
        bounds = (self.volume, self.lower, self.upper)
        qp = StepQP(stiffness, coupling, metric, loop.gradient, self.mass, *bounds, *low_rank)
        tolerance = min(max(QP_SHARE * loop.kkt.residual, CG_TOLERANCE), LOOSEST_QP)
        tolerance *= DRAFT if draft else 1.0
        return replace(qp, linear=qp.product(loop.phi) - loop.gradient, tolerance=tolerance)

    def _solve(self, loop, phi, start=None):
        """Solve the state problem, to a tolerance that follows the gain of the last step.

        The iterations start from the displacements `start`, the loop's if not given.
        """
        rows, tolerance = loop.rows, self.settings.state_tolerance
        gain = 1.0
        if len(rows) > 1:
            gain = abs(1.0 - rows[-1].objective_J / rows[-2].objective_J)
            tolerance = min(tolerance, max(STATE_SHARE * np.sqrt(gain), FINEST_TOLERANCE))
        start = loop.state.displacements if start is None else start
        state = self.model.solve(phi, start, tolerance)
        if state.compliance_error > ERROR_SHARE * gain * abs(loop.objective):
            tolerance = max(1e-2 * tolerance, FINEST_TOLERANCE)
            state = self.model.solve(phi, state.displacements, tolerance)
        return state

    def _arrive(self, phi, state, rule, history, secants, tau, effort=(0, 0, None)):
        """The LoopState at phi, its history longer by one row."""
        rejected, systems, iterations = effort
        iterations = state.iterations if iterations is None else iterations
        gradient = self.gradient(phi, state)
        kkt = self.conditions(phi, gradient)
        if kkt.residual < self.settings.tolerance and state.residual > LAST_TOLERANCE:
            state = self.polished(phi, state)  # the run may end here: make sure
            iterations += state.iterations
            gradient = self.gradient(phi, state)
            kkt = self.conditions(phi, gradient)
        interface = self.gamma * self.energy.energy(phi)
        row = HistoryRow(
            iteration=self._number(history),
            level=self.level,
            compliance_J=state.compliance,
            ginzburg_landau_J=interface,
            objective_J=state.compliance + interface,
            volume_fraction=float(self.mass @ phi) / self.domain_volume,
            tau=tau,
            rejected=rejected,
            pdas_iterations=systems,
            state_iterations=iterations,
            kkt_residual=kkt.residual,
            kkt_stationarity=kkt.stationarity,
            kkt_complementarity=kkt.complementarity,
            kkt_sign=kkt.sign,
            volume_error=kkt.volume_error,
            seconds=time.perf_counter() - self._began,
        )
        parameters = (self.gamma, self.energy.eps)
        history = (*history, row)
        return LoopState(phi, state, gradient, rule, kkt, *parameters, history, secants)

    def _number(self, history):
        """The number of the next row; a level's start is no step and has the last one's."""
        if not history:
            return 0
        return history[-1].iteration + (history[-1].level == self.level)

    def _tau(self, metric):
        """The step size of a metric: exactly tau for M / tau, its mean otherwise."""
        return self.domain_volume / float(metric.sum())
