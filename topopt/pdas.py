"""Primal-dual active set strategy for one step of the flow.

The semi-implicit step (2.19) is a strictly convex quadratic programme (`topopt.box_qp.StepQP`).
The strategy guesses which nodes sit at 0 and 1, solves a linear system on the rest, and moves
nodes between the sets by the sign of their multipliers until nothing moves any more. It can
cycle, and it can run out of inactive nodes; then the globalised solver takes over.
"""

from dataclasses import replace
from hashlib import blake2b

import numpy as np

from topopt.box_qp import (
    CG_TOLERANCE,
    StepSolution,
    meet_volume,
    sets_of,
    solve_box,
    solve_equality,
    solve_globalised,
)
from topopt.projection import project_in_metric

MAX_ITERATIONS = 30
DRAFT_ITERATIONS = 6
NEAR = 100.0  # tolerances of the linear systems: what the sets may still be off by
REDUCTION = 0.01  # of a linear system's residual, while the sets still change


def solve_step(qp, start, draft=False):
    """Solve a step's quadratic programme.

    Parameters
    ----------
    qp : StepQP
    start : (n,) float array
        The field before the step, within the bounds.
    draft : bool
        Whether a field near the solution will do where the sets do not come to rest: then the
        last one is moved to box and volume, or the first one kept if that is better.

    Returns
    -------
    StepSolution

    Raises
    ------
    InvalidCase
        If the bounds do not allow the volume.
    NotConverged
        If the programme cannot be solved (numbers that are not finite).

    Notes
    -----
    Thesis section 2.2.5.2. The sets start from a projected Jacobi step, which already meets the
    volume: for short steps they are often the final ones.
    """
    exact = replace(qp, tolerance=CG_TOLERANCE)
    if qp.volume is None:
        return solve_box(exact, start)
    guess, kappa = first_guess(qp, start)
    solution = active_set_iteration(qp, sets_of(qp, guess), guess, draft)
    return solve_globalised(exact, guess, kappa) if solution is None else solution


def first_guess(qp, start):
    """One projected Jacobi step from the start: (x, kappa), x within the bounds, at the volume."""
    linear = qp.jacobi * start + qp.linear - qp.product(start)
    return project_in_metric(linear, qp.jacobi, qp.mass, qp.volume, qp.lower, qp.upper)


def active_set_iteration(qp, sets, x, draft=False):
    """Run the plain strategy from the given sets.

    Returns
    -------
    StepSolution or None
        None, but for a draft, if the sets repeat without standing still or no node is inactive.
    """
    first, seen, reduction = x, set(), REDUCTION
    for iteration in range(1, (DRAFT_ITERATIONS if draft else MAX_ITERATIONS) + 1):
        if not np.any(sets == 0):
            break
        x, kappa, solved = solve_equality(qp, sets, x, reduction)
        multiplier = qp.multiplier(x, kappa)
        mu = np.where(sets != 0, multiplier / qp.mass, 0.0)
        updated = update_sets(qp, x, mu)
        stand = np.array_equal(updated, sets)
        if solved and (stand or is_near(qp, x, multiplier)):
            x = meet_volume(qp, np.clip(x, qp.lower, qp.upper))
            sets = sets_of(qp, x)
            mu = np.where(sets != 0, multiplier / qp.mass, 0.0)
            return StepSolution(x, kappa, mu, sets, iteration, False)
        digest = blake2b(updated.tobytes(), digest_size=16).digest()
        if stand or digest in seen:
            if reduction == 0.0 or draft:
                break
            reduction = 0.0
            seen.clear()
        seen.add(digest)
        sets = updated
    return _draft(qp, first, x, iteration) if draft else None


def _draft(qp, first, last, iterations):
    """The better one of the first field (n,) and the last, which is moved to box and volume."""
    bounds = (qp.lower, qp.upper)
    moved, kappa = project_in_metric(qp.jacobi * last, qp.jacobi, qp.mass, qp.volume, *bounds)
    x = min((first, moved), key=qp.objective)
    sets = sets_of(qp, x)
    mu = np.where(sets != 0, qp.multiplier(x, kappa) / qp.mass, 0.0)
    return StepSolution(x, kappa, mu, sets, iterations, False)


def is_near(qp, x, multiplier):
    """Whether only nodes within the accuracy asked for would still change sets."""
    within = np.clip(x, qp.lower, qp.upper)
    moved = np.clip(within + multiplier / qp.jacobi, qp.lower, qp.upper)
    off = max(float(np.abs(x - within).max()), float(np.abs(moved - within).max()))
    return off <= NEAR * qp.tolerance * float(np.max(qp.upper - qp.lower))


def update_sets(qp, x, mu):
    """The sets (n,) of (2.20) with c = diag(H) / m.

    The thesis leaves c > 0 open. It only decides whether a node may change from one bound to the
    other at once; with c = 1 / tau long steps make whole regions do so, and cycle.
    """
    c = qp.jacobi / qp.mass
    sets = (c * (x - qp.upper) + mu > 0).astype(np.int8) - (c * (x - qp.lower) + mu < 0)
    sets[~qp.movable] = -1
    return sets
