"""The step's quadratic programme against an independent solver, and the road to its solution."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_matrix

from meshes.errors import InvalidCase, NotConverged
from meshes.structured import bcc_box
from tests.topopt import reference_optimizer as reference
from topopt import pdas
from topopt.box_qp import StepQP, meet_volume, sets_of, solve_globalised
from topopt.ginzburg_landau import GinzburgLandau
from topopt.low_rank_kernels import pack
from topopt.pdas import DRAFT_ITERATIONS, active_set_iteration, solve_step
from topopt.projection import project_in_metric, project_volume
from topopt.reduced_system import ReducedSystem
from topopt.secants import SecantMetric, Secants

MESH = bcc_box((0, 0, 0), (3, 1, 1), (5, 2, 1))
ENERGY = GinzburgLandau(MESH, 0.3)


def mesh_qp(coupling, seed=0, volume_fraction=0.3, roughness=1.0):
    """A programme on a small mesh; `coupling` is tau gamma eps / h^2."""
    rng = np.random.default_rng(seed)
    n, mass, h = len(ENERGY.mass), ENERGY.mass, 0.5
    phi = project_volume(
        0.5 + np.sin(3 * MESH.points @ rng.normal(size=3)),
        *(mass, volume_fraction * mass.sum(), np.zeros(n), np.ones(n)),
    )
    linear = mass * (phi + roughness * rng.normal(size=n))
    bounds = np.zeros(n), np.ones(n)
    volume = volume_fraction * mass.sum()
    return StepQP(ENERGY.stiffness, coupling * h**2, mass, linear, mass, volume, *bounds), phi


def random_qp(seed, n):
    """A programme on a random weighted graph, some nodes held, over six decades of coupling."""
    rng = np.random.default_rng(seed)
    weights = np.triu(rng.uniform(0, 1, (n, n)) * (rng.uniform(size=(n, n)) < 0.4), 1)
    weights += weights.T
    graph = csr_matrix(np.diag(weights.sum(1)) - weights)
    mass = rng.uniform(0.5, 2.0, n)
    diagonal = mass * 10.0 ** rng.uniform(-3, 1)
    linear = 10.0 ** rng.uniform(-2, 1.5) * rng.normal(size=n)
    lower, upper = np.zeros(n), np.ones(n)
    held = rng.uniform(size=n) < 0.2
    lower[held] = upper[held] = rng.integers(0, 2, held.sum())
    volume = mass @ lower + rng.uniform(0.02, 0.98) * (mass @ (upper - lower))
    coupling = 10.0 ** rng.uniform(-3, 3)
    return StepQP(graph, coupling, diagonal, linear, mass, volume, lower, upper)


def check(qp, solution, exact=None):
    """Box and volume exactly, the minimiser to 1e-8, multipliers of the right sign.

    The programme is strictly convex, so balance, signs and bounds alone prove the minimiser.
    """
    x, mu = solution.x, solution.mu
    if exact is not None:
        assert np.abs(x - exact).max() < 1e-8
    assert np.all((x >= qp.lower) & (x <= qp.upper))
    assert qp.mass @ x == pytest.approx(qp.volume, rel=1e-14)
    np.testing.assert_array_equal(solution.sets, sets_of(qp, x))
    free = qp.upper > qp.lower
    worst = np.abs(mu).max(initial=0.0)
    assert np.all(mu[free & (x == qp.upper)] >= -1e-8 * worst)
    assert np.all(mu[free & (x == qp.lower)] <= 1e-8 * worst)
    assert np.all(mu[free & (x > qp.lower) & (x < qp.upper)] == 0.0)
    balance = reference.dense_hessian(qp) @ x - qp.linear + solution.kappa * qp.mass + qp.mass * mu
    scale = np.abs(qp.linear).max() + np.abs(qp.jacobi).max() + abs(solution.kappa)
    assert np.abs(balance).max() < 1e-8 * scale


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(0, 10**9), st.integers(2, 24))
def test_random_programmes_match_the_reference(seed, n):
    qp = random_qp(seed, n)
    start = np.clip(np.full(n, 0.5), qp.lower, qp.upper)
    exact, _ = reference.solve_qp_by_bisection(qp)
    check(qp, solve_step(qp, start), exact)
    check(qp, solve_globalised(qp, start, 0.0), exact)


@pytest.mark.parametrize("coupling", [0.01, 0.3, 3.0, 300.0])
def test_mesh_programmes_match_the_reference(coupling):
    qp, phi = mesh_qp(coupling)
    check(qp, solve_step(qp, phi), reference.solve_qp_by_bisection(qp)[0])


def test_short_steps_need_few_iterations_and_no_fallback():
    for seed in range(10):
        qp, phi = mesh_qp(0.01, seed, roughness=0.1)
        solution = solve_step(qp, phi)
        assert not solution.fallback
        assert solution.iterations <= 4


def sets_with_the_thesis_constant(qp, x, mu, trace):
    """(2.20) with c = 1 / tau, remembering what comes out."""
    c = qp.diagonal / qp.mass
    sets = (c * (x - qp.upper) + mu > 0).astype(np.int8) - (c * (x - qp.lower) + mu < 0)
    trace.append(sets)
    return sets


def test_long_steps_need_no_fallback_but_with_c_of_one_over_tau(monkeypatch):
    """With the thesis's c plain iterations cycle or run empty, and the fallback solves them all."""
    ends = []
    for seed in range(30):
        qp, phi = mesh_qp(3.0, seed, volume_fraction=0.3, roughness=0.3)
        exact = solve_step(qp, phi)
        assert not exact.fallback and exact.iterations <= 8
        trace = []
        with monkeypatch.context() as patch:
            patch.setattr(
                pdas,
                "update_sets",
                lambda *terms, to=trace: sets_with_the_thesis_constant(*terms, to),
            )
            solution = solve_step(qp, phi)
        check(qp, solution, exact.x)
        if solution.fallback:
            ends.append("cycle" if np.any(trace[-1] == 0) else "empty")
    assert {"cycle", "empty"} <= set(ends)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_programmes_are_solved_as_exactly_as_is_asked_for(tolerance):
    """In the root mean square, within ten times; box and volume hold to the last bit."""
    for seed in range(5):
        qp, phi = mesh_qp(3.0, seed, roughness=0.3)
        exact = solve_step(qp, phi).x
        solution = solve_step(replace(qp, tolerance=tolerance), phi)
        error = np.sqrt(qp.mass @ (solution.x - exact) ** 2 / qp.mass.sum())
        assert error < 10.0 * tolerance and not solution.fallback
        assert np.all((solution.x >= qp.lower) & (solution.x <= qp.upper))
        assert qp.mass @ solution.x == pytest.approx(qp.volume, rel=1e-14)


def test_packed_rows_and_their_products():
    rng = np.random.default_rng(4)
    learned, jacobi = rng.normal(size=(5, 5000)).astype(np.float32), rng.uniform(1, 2, 3000)
    rows = np.sort(rng.permutation(5000)[:3000]).astype(np.uint32)
    packed, weight = pack(learned, rows, jacobi)
    np.testing.assert_array_equal(packed, learned[:, rows])
    np.testing.assert_allclose(weight, (packed / jacobi) @ packed.T, rtol=1e-6)
    exact = (packed.astype(float) / jacobi) @ packed.T.astype(float)
    np.testing.assert_allclose(weight, exact, atol=1e-11)


def check_draft(qp, start, draft):
    """Within box and volume, and no worse than its start, after a few systems."""
    assert draft.iterations <= DRAFT_ITERATIONS
    assert np.all((draft.x >= qp.lower) & (draft.x <= qp.upper))
    assert qp.mass @ draft.x == pytest.approx(qp.volume, rel=1e-13)
    assert qp.objective(draft.x) <= qp.objective(start)


def test_bad_first_sets_fail_and_the_fallback_does_not():
    failed = 0
    for seed in range(12):
        qp, phi = mesh_qp(30.0, seed)
        rng = np.random.default_rng(seed)
        sets = np.where(phi > 0.5, 1, -1) * (rng.uniform(size=len(phi)) > 0.1)
        if active_set_iteration(qp, sets.astype(np.int8), phi) is None:
            failed += 1
            check_draft(qp, phi, active_set_iteration(qp, sets.astype(np.int8), phi, draft=True))
            exact = reference.solve_qp_by_bisection(qp)[0] if failed == 1 else None
            check(qp, solve_globalised(qp, phi, 0.0), exact)
    assert failed >= 2


def test_empty_inactive_set_goes_to_the_fallback():
    """All nodes guessed active: kappa would be 0/0."""
    qp, phi = mesh_qp(0.3)
    sets = np.where(phi > 0.5, 1, -1).astype(np.int8)
    assert active_set_iteration(qp, sets, phi) is None
    check(qp, solve_globalised(qp, phi, 0.0), reference.solve_qp_by_bisection(qp)[0])


def test_bang_bang_solution_without_inactive_nodes():
    """The volume of a whole set of nodes, and a linear term that wants exactly them."""
    qp, phi = mesh_qp(1e-6)
    chosen = MESH.points[:, 0] < 0.9
    linear = np.where(chosen, 50.0, -50.0) * qp.mass
    volume = float(qp.mass @ chosen)
    qp = StepQP(
        *(qp.stiffness, qp.coupling, qp.diagonal, linear, qp.mass, volume, qp.lower, qp.upper)
    )
    solution = solve_step(qp, np.full(len(phi), volume / qp.mass.sum()))
    np.testing.assert_array_equal(solution.x, chosen.astype(float))


@pytest.mark.parametrize("off", [1e-9, -1e-9])
def test_missing_volume_is_spread_over_the_inactive_nodes(off):
    qp, phi = mesh_qp(0.5)
    inactive = (phi > 0) & (phi < 1)
    moved = meet_volume(qp, np.where(inactive, phi * (1 - phi) * off + phi, phi))
    assert qp.mass @ moved == pytest.approx(qp.volume, rel=1e-15)
    np.testing.assert_array_equal(moved[~inactive], phi[~inactive])
    assert np.all((moved >= 0) & (moved <= 1))


def test_without_volume_constraint():
    qp, phi = mesh_qp(0.5)
    free = StepQP(
        *(qp.stiffness, qp.coupling, qp.diagonal, qp.linear, qp.mass, None, qp.lower, qp.upper)
    )
    exact = reference.box_minimiser(reference.dense_hessian(qp), qp.linear, qp.lower, qp.upper)
    solution = solve_step(free, phi)
    np.testing.assert_allclose(solution.x, exact, atol=1e-9)
    assert solution.kappa == 0.0


def test_impossible_volume_is_refused():
    qp, _ = mesh_qp(0.5)
    with pytest.raises(InvalidCase, match="cannot be met"):
        project_in_metric(qp.linear, qp.diagonal, qp.mass, 3.5, qp.lower, qp.upper)


def test_numbers_that_are_not_finite_are_refused():
    qp, phi = mesh_qp(0.5)
    phi[3] = np.nan
    qp.linear[3] = np.nan
    with pytest.raises(NotConverged):
        solve_step(qp, phi)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(0, 10**9), st.integers(1, 40))
def test_projection_matches_bisection(seed, n):
    qp = random_qp(seed, n)
    terms = (qp.linear, qp.diagonal, qp.mass, qp.volume, qp.lower, qp.upper)
    x, _ = project_in_metric(*terms)
    np.testing.assert_allclose(x, reference.project_by_bisection(*terms), atol=1e-9)
    assert qp.mass @ x == pytest.approx(qp.volume, rel=1e-13)


def test_scaling_the_programme_changes_nothing():
    """Lengths of 1e-9 and 1e9: every term of the programme times one power of two."""
    qp, phi = mesh_qp(30.0, seed=1)
    plain = solve_step(qp, phi)
    for factor in (2.0**-90, 2.0**90):
        terms = (factor * v for v in (qp.diagonal, qp.linear, qp.mass, qp.volume))
        scaled = StepQP(qp.stiffness, factor * qp.coupling, *terms, qp.lower, qp.upper)
        np.testing.assert_array_equal(solve_step(scaled, phi).x, plain.x)


def with_low_rank(qp, phi, count=5):
    """The same programme where the metric knows of a few past steps."""
    steps = np.random.default_rng(7).normal(size=(count, len(phi)))
    changes = qp.mass * steps * np.linspace(0.05, 40.0, len(phi))
    parts = SecantMetric(
        Secants(steps, changes), qp.stiffness, qp.coupling, qp.diagonal
    ).low_rank_part()
    return replace(qp, learned=parts[0], core=parts[1])


@pytest.mark.parametrize("learned", [False, True])
def test_products_match_their_twin(learned):
    qp, phi = mesh_qp(3.0)
    qp = with_low_rank(qp, phi) if learned else qp
    expected = reference.multiply(*qp.matrix, qp.learned, qp.core @ (qp.learned @ phi), phi)
    np.testing.assert_allclose(qp.product(phi), expected, rtol=1e-11)


@pytest.mark.parametrize("learned", [False, True])
def test_reduced_systems_against_dense_ones(learned):
    """The answers with and without the plane; threads change no bit."""
    qp, phi = mesh_qp(3.0)
    qp = with_low_rank(qp, phi) if learned else qp
    rows = np.flatnonzero(MESH.points[:, 0] < 1.3).astype(np.int32)
    hessian, mass = reference.dense_hessian(qp)[np.ix_(rows, rows)], qp.mass[rows]
    right = np.random.default_rng(0).normal(size=len(rows))
    system = ReducedSystem(qp, rows)
    np.testing.assert_allclose(system.solve(right, 1.0), np.linalg.solve(hessian, right), atol=1e-9)
    bordered = np.block([[hessian, mass[:, None]], [mass[None], np.zeros((1, 1))]])
    exact = np.linalg.solve(bordered, np.append(right, 0.0))
    answer = system.precondition(mass)
    before, results = numba.get_num_threads(), []
    try:
        for threads in {1, min(2, numba.config.NUMBA_NUM_THREADS)}:
            numba.set_num_threads(threads)
            x, kappa, solved = system.solve_in_plane(right, answer)
            assert solved
            np.testing.assert_allclose(np.append(x, kappa), exact, atol=1e-9)
            assert abs(mass @ x) < 1e-14 * mass.sum()
            results.append(x.tobytes())
    finally:
        numba.set_num_threads(before)
    assert len(set(results)) == 1


def test_a_matrix_that_is_not_definite_is_refused():
    qp, _ = mesh_qp(3.0)
    lowered = -0.5 * qp.coupling * qp.stiffness.diagonal()
    rows = np.arange(len(qp.mass), dtype=np.int32)
    system = ReducedSystem(replace(qp, diagonal=lowered), rows)
    with pytest.raises(NotConverged):
        system.solve(np.ones(len(rows)), 1.0)
