"""The quadratic programme of one step, and the slow road to its solution that cannot fail.

minimise 1/2 x^T H x - b^T x  over  lower <= x <= upper,  m^T x = V,

H = diag(D) + coupling A, plus a part W^T C W of low rank where the metric knows of past steps
(`topopt.secants`). H is symmetric positive definite, so the minimiser is unique, and
V(kappa) = m^T x(kappa), with x(kappa) the minimiser of the box problem whose linear term is
b - kappa m, is continuous and falls with kappa. `solve_globalised` finds its root by a safeguarded
Newton method; each value of V is one box problem, solved by the two-metric projected Newton method.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix

from meshes.errors import NotConverged
from topopt.geometry import INDEX, unsigned
from topopt.low_rank_kernels import gram, multiply, threads_that_pay
from topopt.reduced_system import ReducedSystem

CG_TOLERANCE = 1e-12
ACCURACY = 1e-9  # see `StepQP.accuracy`
MAX_KAPPA_UPDATES = 200
MAX_NEWTON_STEPS = 200


@dataclass(frozen=True, eq=False)
class StepQP:
    """The quadratic programme of one step.

    Parameters
    ----------
    stiffness : (n, n) CSR matrix [m]
        A.
    coupling : float
        gamma eps.
    diagonal, linear, mass : (n,) float arrays
        D > 0, b and m.
    volume : float or None [m^3]
        V; None leaves the volume free.
    lower, upper : (n,) float arrays
        Bounds; equal ones hold a node.
    learned : (k, n) float32 array, optional
        W; no rows if not given.
    core : (k, k) float array, optional
        C, symmetric; H as a whole is positive definite.
    tolerance : float
        Of the linear systems, in units of the box.
    """

    stiffness: csr_matrix
    coupling: float
    diagonal: np.ndarray
    linear: np.ndarray
    mass: np.ndarray
    volume: float | None
    lower: np.ndarray
    upper: np.ndarray
    learned: np.ndarray | None = None
    core: np.ndarray | None = None
    tolerance: float = CG_TOLERANCE

    def __post_init__(self):
        if self.learned is None:
            object.__setattr__(self, "learned", np.zeros((0, len(self.mass)), np.float32))
            object.__setattr__(self, "core", np.zeros((0, 0)))

    @cached_property
    def jacobi(self):
        """Diagonal (n,) of H without its low-rank part."""
        return self.diagonal + self.coupling * self.stiffness.diagonal()

    @cached_property
    def movable(self):
        """Nodes (n,) whose bounds differ."""
        return self.upper > self.lower

    @property
    def accuracy(self):
        """Largest natural residual, in units of the box, that is returned."""
        return max(ACCURACY, 100.0 * self.tolerance)

    @property
    def matrix(self):
        """What the kernels take of H."""
        a = self.stiffness
        return unsigned(a.indptr), unsigned(a.indices), a.data, self.coupling, self.diagonal

    def product(self, x):
        """H x (n,)."""
        out = np.empty(len(x))
        lifted = self.core @ gram(self.learned, x[None])[:, 0]
        with threads_that_pay(len(x)):
            multiply(*self.matrix, self.learned, lifted, x, out)
        return out

    def objective(self, x):
        """1/2 x^T H x - b^T x."""
        return float(0.5 * (x @ self.product(x)) - self.linear @ x)

    def multiplier(self, x, kappa):
        """b - H x - kappa m (n,): the bound multiplier mu times the mass."""
        return self.linear - self.product(x) - kappa * self.mass

    def natural_residual(self, x, kappa):
        """Largest |x - clip(x + (b - H x - kappa m) / diag(H))|: 0 at the solution."""
        moved = np.clip(x + self.multiplier(x, kappa) / self.jacobi, self.lower, self.upper)
        return float(np.abs(moved - x).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class StepSolution:
    """The solution of a step's quadratic programme.

    Parameters
    ----------
    x : (n,) float array
        Within the bounds, active nodes exactly on them, m^T x = V.
    kappa : float [Pa]
        Multiplier of the volume.
    mu : (n,) float array [Pa]
        Multiplier of the bounds, positive at upper ones, 0 between.
    sets : (n,) int8 array
        1 on the upper bound, -1 on the lower one, 0 between.
    iterations : int
        Linear systems solved.
    fallback : bool
        Whether the globalised solver was needed.
    """

    x: np.ndarray
    kappa: float
    mu: np.ndarray
    sets: np.ndarray
    iterations: int
    fallback: bool


def as_rows(mask):
    """Indices of a boolean mask, as the kernels want them."""
    return np.flatnonzero(mask).astype(INDEX)


def sets_of(qp, x):
    """Active sets (n,) of a field within the bounds; held nodes count as on the lower one."""
    sets = (x >= qp.upper).astype(np.int8) - (x <= qp.lower).astype(np.int8)
    sets[~qp.movable] = -1
    return sets


def on_bounds(qp, sets, x):
    """Return x (n,) with the active nodes on their bounds."""
    return np.where(sets > 0, qp.upper, np.where(sets < 0, qp.lower, x))


def solve_equality(qp, sets, x, reduction=0.0):
    """Minimise over the inactive nodes, the active ones held at their bounds, volume met.

    Parameters
    ----------
    qp : StepQP
    sets : (n,) int8 array
        With at least one inactive node.
    x : (n,) float array
        Start.
    reduction : float
        How much smaller than the start's the residual need only get.

    Returns
    -------
    x : (n,) float array
        Not necessarily within the bounds.
    kappa : float
    solved : bool
        Whether to the programme's tolerance.
    """
    system = ReducedSystem(qp, as_rows(sets == 0))
    x = on_bounds(qp, sets, x)
    answer = system.precondition(system.mass)
    missing = qp.volume - float(qp.mass @ x)
    x[system.rows] += missing / float(system.mass @ answer) * answer
    right_side = (qp.linear - qp.product(x))[system.rows]
    moved, kappa, solved = system.solve_in_plane(right_side, answer, reduction)
    x[system.rows] += moved
    return x, kappa, solved


def projected_newton(qp, kappa, x, tolerance=1e-13):
    """Minimise 1/2 x^T H x - (b - kappa m)^T x over the bounds alone.

    Parameters
    ----------
    qp : StepQP
    kappa : float
    x : (n,) float array
        Start within the bounds.
    tolerance : float
        On the natural residual.

    Returns
    -------
    x : (n,) float array
    solves : int
        Linear systems solved.

    Raises
    ------
    NotConverged

    Notes
    -----
    D. Bertsekas, Projected Newton methods for optimization problems with simple constraints,
    SIAM J. Control Optim. 20 (1982).
    """
    reach = float(np.max(qp.upper - qp.lower))
    history = []
    for solves in range(MAX_NEWTON_STEPS):
        slope = -qp.multiplier(x, kappa)
        jacobi_step = np.clip(x - slope / qp.jacobi, qp.lower, qp.upper) - x
        history.append(float(np.abs(jacobi_step).max()))
        if history[-1] <= tolerance * reach:
            return x, solves
        near = min(1e-3 * reach, history[-1])
        held = (x <= qp.lower + near) & (slope > 0) | (x >= qp.upper - near) & (slope < 0)
        rows = as_rows(~held & qp.movable)
        step = slope / qp.jacobi
        if rows.size:
            scale = reach * np.sqrt(qp.jacobi[rows].sum())
            step[rows] = ReducedSystem(qp, rows).solve(slope[rows], scale)
        moved = _backtrack(qp, x, slope, step)
        if moved is None:  # rounding is all that is left
            break
        x = moved
    if history[-1] <= qp.accuracy * reach:
        return x, solves
    raise NotConverged("projected Newton stalled on the step's box problem.", history)


def _backtrack(qp, x, slope, step):
    """Return clip(x - alpha step) with sufficient decrease, alpha = 1, 1/2, ...; None if none."""
    alpha = 1.0
    while alpha > 1e-9:
        moved = np.clip(x - alpha * step, qp.lower, qp.upper)
        change = moved - x
        gain = slope @ change
        if gain < 0 and gain + 0.5 * (change @ qp.product(change)) <= 1e-4 * gain:
            return moved
        alpha *= 0.5
    return None


def solve_globalised(qp, x, kappa):
    """Solve a step's quadratic programme from any start (x within the bounds, kappa).

    Returns
    -------
    StepSolution

    Raises
    ------
    NotConverged
        If even this fails; nothing unconverged is ever returned.
    """
    low = float(np.min((qp.linear - qp.product(qp.upper)) / qp.mass))
    high = float(np.max((qp.linear - qp.product(qp.lower)) / qp.mass))
    kappa = min(max(kappa, low), high)
    last, total, history = np.inf, 0, []
    for _ in range(MAX_KAPPA_UPDATES):
        x, solves = projected_newton(qp, kappa, x)
        total += solves
        excess = float(qp.mass @ x) - qp.volume
        history.append(excess)
        if abs(excess) <= 1e-13 * qp.volume:
            break
        low, high = (max(low, kappa), high) if excess > 0 else (low, min(high, kappa))
        trial = kappa + excess / volume_slope(qp, x)
        slow = abs(excess) > 0.5 * last
        best, kappa = kappa, trial if low < trial < high and not slow else 0.5 * (low + high)
        last, total = abs(excess), total + 1
        if kappa in (best, low, high):
            break
    return _finish(qp, x, kappa, total, history)


def solve_box(qp, x):
    """Solve a programme without volume constraint from x (n,) within the bounds: StepSolution."""
    x, solves = projected_newton(qp, 0.0, x)
    return _solution(qp, x, 0.0, solves)


def volume_slope(qp, x):
    """-dV/dkappa at a solution x of the box problem: m_I . H_II^-1 m_I (inf if I is empty)."""
    rows = as_rows((x > qp.lower) & (x < qp.upper))
    if rows.size == 0:
        return np.inf
    mass = qp.mass[rows]
    scale = float(np.sqrt((mass * mass / qp.jacobi[rows]).sum()))
    return float(mass @ ReducedSystem(qp, rows).solve(mass, scale))


def _finish(qp, x, kappa, iterations, history):
    """Polish on the sets found, meet volume and box exactly, and check the result."""
    sets = sets_of(qp, x)
    reach = float(np.max(qp.upper - qp.lower))
    if np.any(sets == 0):
        polished, kappa_polished, _ = solve_equality(qp, sets, x)
        clipped = np.clip(polished, qp.lower, qp.upper)
        if np.abs(clipped - polished).max() <= 1e-12 * reach:
            x, kappa = clipped, kappa_polished
    if abs(float(qp.mass @ x) - qp.volume) > 1e-9 * qp.volume:
        raise NotConverged("the volume multiplier of a step was not found.", history)
    x = meet_volume(qp, x)
    residual = qp.natural_residual(x, kappa)
    if not residual <= qp.accuracy * reach:
        raise NotConverged(f"a step's quadratic programme is only solved to {residual:.1e}.")
    return _solution(qp, x, kappa, iterations + 1)


def meet_volume(qp, x):
    """Spread what is missing in volume over the inactive nodes, in proportion to their room."""
    inactive = (x > qp.lower) & (x < qp.upper)
    missing = qp.volume - float(qp.mass @ x)
    room = np.where(inactive, qp.upper - x if missing > 0 else x - qp.lower, 0.0)
    available = float(qp.mass @ room)
    return x + (missing / available) * room if available > 0 else x


def _solution(qp, x, kappa, iterations):
    """Wrap up a field within the bounds."""
    sets = sets_of(qp, x)
    mu = np.where(sets != 0, qp.multiplier(x, kappa) / qp.mass, 0.0)
    return StepSolution(x, kappa, mu, sets, iterations, True)
