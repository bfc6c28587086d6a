"""The optimisation: a flow of the phase field that makes J = F + gamma E fall.

Each step solves the state problem once (more if the step is rejected) and one quadratic programme
(`topopt.pdas`). Everything that a step leaves behind is one immutable `LoopState`: an interrupted
run ends with the last accepted one, and a run is resumed by starting from it.

Symbols: phi phase field, F compliance, E Ginzburg-Landau energy, gamma and eps its parameters.
"""

from dataclasses import dataclass, field

import numpy as np
from threadpoolctl import threadpool_limits

from meshes.errors import InvalidCase
from meshes.phase_field import PhaseField
from topopt.boundary import boundary_conditions, check_rigid_motions
from topopt.elasticity import ElasticModel, State
from topopt.flow import Flow, LoopState
from topopt.history import HistoryRow
from topopt.kkt import KKT
from topopt.levels import LevelStart
from topopt.parameters import auto_eps, warn_if_coarse
from topopt.passive import check_room, passive_bounds
from topopt.problem import moved
from topopt.step_control import RULES
from topopt.unloaded import Unloaded
from topopt.vmpt import ProjectedGradient

METHODS = {"vmpt": ProjectedGradient, "allen_cahn": Flow}


@dataclass(frozen=True)
class OptimizationSettings:
    """How to run.

    Parameters
    ----------
    steps : int
        Accepted steps at most, on this mesh.
    method : {"vmpt", "allen_cahn"}
        The projected gradient method in a metric that learns (`topopt.vmpt`), or the flow.
    step : {"variable_metric", "controlled", "fixed"}
        See `topopt.step_control`; vmpt takes it for the first guess of its metric, and never
        takes "fixed".
    tau : float or None [1/Pa]
        (First) step size; None takes one from the start's energy density.
    tolerance : float
        Stop when the KKT residual falls below; 0 never stops.
    stagnation : float
        Stop when J fell by less than this share over 5 accepted steps; 0 never stops.
    volume_constraint : bool
        False lets the volume go free (flows for analysis).
    solver : {"auto", "multigrid", "pyamg", "direct"}
        Of the state problem.
    state_tolerance : float
        Loosest relative residual of a state solve; it tightens as the steps' gains get small.
    check_resolution : bool
        Warn if too few elements cross the interface.
    """

    steps: int = 60
    method: str = "vmpt"
    step: str = "variable_metric"
    tau: float | None = None
    tolerance: float = 1e-3
    stagnation: float = 1e-4
    volume_constraint: bool = True
    solver: str = "auto"
    state_tolerance: float = 0.1
    check_resolution: bool = True


@dataclass(frozen=True, eq=False)
class OptimizationResult:
    """What a run ends with.

    Parameters
    ----------
    phase_field : PhaseField
    state : State
    history : tuple of HistoryRow
    kkt : KKT
    outcome : {"steps", "tolerance", "stagnation", "no_decrease", "interrupted"}
    gamma, eps : float
        As used; chosen where the problem leaves them open.
    loop : LoopState
        Give it to `optimize` as `start` to go on.
    """

    phase_field: PhaseField
    state: State
    history: tuple[HistoryRow, ...]
    kkt: KKT
    outcome: str
    gamma: float
    eps: float
    loop: LoopState = field(repr=False)


def optimize(mesh, problem, settings=None, start=None, callback=None, model=None):
    """Minimise compliance plus interface energy at the problem's volume.

    Parameters
    ----------
    mesh : TetMesh
    problem : Problem
    settings : OptimizationSettings, optional
    start : PhaseField, (n,) array, LevelStart or LoopState, optional
        The first field (projected onto box and volume), that of one of several nested meshes
        (`topopt.levels`), or where an earlier run ended; phi = m everywhere if not given.
    callback : function(HistoryRow, LoopState), optional
        Called after every accepted step, and for the start (row 0), with the step's row and all
        that belongs to it (`phi`, `state`; enough to go on from). A KeyboardInterrupt, from it or
        from anywhere else in the loop, ends the run with the last accepted step.
    model : ElasticModel, optional
        Another state problem than the problem's own.

    Returns
    -------
    OptimizationResult

    Raises
    ------
    InvalidCase
        If the problem or a setting cannot be run.
    NotConverged
        If a state problem or a quadratic programme cannot be solved.
    """
    with threadpool_limits(1, user_api="blas"):  # its threads would wait beside numba's
        return _optimize(mesh, problem, settings or OptimizationSettings(), start, callback, model)


def _optimize(mesh, problem, settings, start, callback, model):
    """`optimize` itself."""
    flow = prepare(mesh, problem, settings, start, model)
    loop = start if isinstance(start, LoopState) else first_loop(flow, mesh, start)
    try:
        if callback and loop is not start:
            callback(loop.history[-1], loop)
        while (outcome := flow.outcome(loop)) is None:
            advanced = flow.advance(loop)
            if advanced is None:
                outcome = "no_decrease"
                break
            loop = advanced
            if callback:
                callback(loop.history[-1], loop)
    except KeyboardInterrupt:
        outcome = "interrupted"
    return OptimizationResult(
        phase_field=PhaseField(mesh, loop.phi),
        state=flow.polished(loop.phi, loop.state),
        history=loop.history,
        kkt=loop.kkt,
        outcome=outcome,
        gamma=loop.gamma,
        eps=loop.eps,
        loop=loop,
    )


def prepare(mesh, problem, settings, start=None, model=None):
    """Check the problem and return its Flow; see `optimize` for the parameters."""
    check_settings(settings)
    if not 0.0 < problem.volume_fraction < 1.0:
        raise InvalidCase(f"volume_fraction: must lie in (0, 1), got {problem.volume_fraction:g}.")
    if model is None:
        model = state_problem(mesh, problem, settings)
    gamma, eps, seconds, level = problem.gamma, problem.eps, 0.0, 1
    if isinstance(start, LoopState | LevelStart):
        gamma, eps, level = start.gamma, start.eps, start.level
        seconds = start.history[-1].seconds if start.history else 0.0
    eps = auto_eps(mesh) if eps is None else eps
    if settings.check_resolution:
        warn_if_coarse(mesh, eps, getattr(start, "phi", None))
    bounds = passive_bounds(mesh, problem)
    parameters = (problem.volume_fraction, eps, gamma, seconds, bounds, level)
    flow = METHODS[settings.method](mesh, model, settings, *parameters)
    if settings.volume_constraint:
        check_room(flow.mass, *bounds, problem.volume_fraction)
    return flow


def first_loop(flow, mesh, start):
    """The LoopState before the first step, from any start but a LoopState."""
    if isinstance(start, LevelStart):
        return flow.first(nodal_values(mesh, start.phi), start.history)
    return flow.first(nodal_values(mesh, start))


def state_problem(mesh, problem, settings):
    """The problem's elasticity on a mesh, or `Unloaded` if nothing loads or moves it."""
    if not (problem.loads or np.any(problem.gravity) or moved(problem.supports)):
        return Unloaded(mesh, problem)
    conditions = boundary_conditions(mesh, problem)
    check_rigid_motions(mesh, problem, conditions.fixed, conditions.springs)
    return ElasticModel(mesh, problem, conditions, settings.solver)


def nodal_values(mesh, start):
    """The start as an array (n,), or None."""
    if start is None:
        return None
    values = np.asarray(start.values if isinstance(start, PhaseField) else start, dtype=float)
    if values.shape != (len(mesh.points),) or not np.all(np.isfinite(values)):
        raise InvalidCase(
            f"start: needs one finite value for each of the mesh's {len(mesh.points)} nodes."
        )
    return values


def check_settings(settings):
    """Raise InvalidCase if a setting is out of range."""
    rules = {
        "steps": settings.steps >= 0,
        "method": settings.method in METHODS,
        "step": settings.step in RULES
        and (settings.method != "vmpt" or RULES[settings.step].monotone),
        "tau": settings.tau is None or settings.tau > 0.0,
        "tolerance": settings.tolerance >= 0.0,
        "stagnation": settings.stagnation >= 0.0,
        "state_tolerance": 0.0 < settings.state_tolerance <= 0.1,
    }
    for name, holds in rules.items():
        if not holds:
            wanted = {"method": "one of " + ", ".join(METHODS)}
            wanted["step"] = f"one of {', '.join(RULES)} (fixed with method: allen_cahn only)"
            wanted |= {"tau": "positive", "state_tolerance": "in (0, 0.1]"}
            raise InvalidCase(
                f"{name}: must be {wanted.get(name, 'at least 0')}, "
                f"got {getattr(settings, name)!r}."
            )
