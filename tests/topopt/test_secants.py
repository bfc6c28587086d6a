"""The metric that learns: its low-rank part against dense BFGS updates, and programmes with it."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from tests.topopt import reference_optimizer as reference
from tests.topopt.test_pdas import ENERGY, check, mesh_qp
from topopt.low_rank_kernels import gram
from topopt.pdas import solve_step
from topopt.secants import DAMPING, MEMORY, SecantMetric, Secants

COUPLING = 0.02


def curved_pairs(count, seed=0, least=0.5):
    """Pairs of a quadratic function whose curvature in units of the mass starts at `least`."""
    rng = np.random.default_rng(seed)
    mass = ENERGY.mass
    curvature = mass * np.linspace(least, 6.0, len(mass))
    steps = rng.normal(size=(count, len(mass)))
    return Secants(steps, steps * curvature + 0.05 * COUPLING * (steps @ ENERGY.stiffness))


def base():
    return np.diag(ENERGY.mass) + COUPLING * ENERGY.stiffness.toarray()


def metric_of(secants):
    learned, core = SecantMetric(secants, ENERGY.stiffness, COUPLING, ENERGY.mass).low_rank_part()
    return base() + learned.T.astype(float) @ core @ learned.astype(float)


def test_compact_form_is_the_chain_of_updates():
    secants = curved_pairs(6)
    expected = reference.bfgs(base(), zip(secants.steps, secants.changes))
    metric = metric_of(secants)
    assert np.abs(metric - expected).max() < 1e-6 * np.abs(expected).max()  # single precision
    np.testing.assert_allclose(
        metric @ secants.steps[-1], secants.changes[-1], atol=1e-6 * np.abs(expected).max()
    )


def test_pairs_taken_over_to_another_base_give_the_bits_of_new_ones():
    pairs, none = curved_pairs(5), Secants.none(len(ENERGY.mass))
    first = SecantMetric(none, ENERGY.stiffness, COUPLING, ENERGY.mass)
    for step, change in zip(pairs.steps, pairs.changes):
        first.learn(step, change)
    diagonal = ENERGY.mass * np.linspace(1.0, 3.0, len(ENERGY.mass))
    taken_over = first.rebased(diagonal)
    for count in (5, 6):  # as they are, and with one more pair
        new = SecantMetric(taken_over.secants, ENERGY.stiffness, COUPLING, diagonal)
        assert len(taken_over.secants.steps) == count
        for part, whole in zip(taken_over.low_rank_part(), new.low_rank_part(), strict=True):
            np.testing.assert_array_equal(part, whole)
        more = curved_pairs(1, seed=7)
        taken_over.learn(more.steps[0], more.changes[0])
    assert len(first.secants.steps) == 5  # the one taken over from knows nothing of it


@pytest.mark.parametrize("least", [-3.0, 0.0])
def test_definite_where_the_objective_bends_downward(least):
    secants = curved_pairs(8, seed=1, least=least)
    downward = Secants(secants.steps, -abs(secants.changes) * np.sign(secants.steps))
    for pairs in (secants, downward):
        relative = np.linalg.solve(base(), metric_of(pairs))
        assert np.linalg.eigvals(relative).real.min() > 0.0
    step = downward.steps[-1]
    damped = step @ metric_of(downward) @ step
    assert damped == pytest.approx(DAMPING * (step @ base() @ step), rel=1e-5)


def test_memory_keeps_the_newest_pairs_and_skips_empty_steps():
    pairs = curved_pairs(MEMORY + 3)
    none = Secants.none(len(ENERGY.mass))
    metric = SecantMetric(none, ENERGY.stiffness, COUPLING, ENERGY.mass)
    assert len(metric.low_rank_part()[0]) == 0 and metric.secants.steps.shape == none.steps.shape
    for step, change in zip(pairs.steps, pairs.changes):
        metric.learn(step, change)
    np.testing.assert_array_equal(metric.secants.steps, pairs.steps[3:])
    np.testing.assert_array_equal(metric.secants.changes, pairs.changes[3:])
    newest = SecantMetric(metric.secants, ENERGY.stiffness, COUPLING, ENERGY.mass).low_rank_part()
    for part, whole in zip(metric.low_rank_part(), newest, strict=True):
        np.testing.assert_array_equal(part, whole)
    some = curved_pairs(3)
    padded = Secants(
        np.vstack([some.steps, 0 * some.steps[:1]]), np.vstack([some.changes, 0 * some.changes[:1]])
    )
    np.testing.assert_allclose(metric_of(padded), metric_of(some), rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("coupling", [0.1, 30.0])
def test_programmes_with_a_low_rank_part_match_the_reference(seed, coupling):
    qp, phi = mesh_qp(coupling, seed)
    steps = np.random.default_rng(seed).normal(size=(5, len(phi)))
    steps[3] = steps[2] + 1e-4 * steps[3]  # nearly dependent ones, too
    changes = qp.mass * steps * np.linspace(0.05, 40.0, len(phi))
    parts = SecantMetric(
        Secants(steps, changes), qp.stiffness, qp.coupling, qp.diagonal
    ).low_rank_part()
    qp = replace(qp, learned=parts[0], core=parts[1])
    exact, _ = reference.solve_qp_by_bisection(qp)
    check(qp, solve_step(qp, phi), exact)
    np.testing.assert_allclose(qp.product(phi), reference.dense_hessian(qp) @ phi, rtol=1e-10)


def test_gram_is_the_product_with_any_number_of_threads():
    rng = np.random.default_rng(3)
    left, right = rng.normal(size=(6, 5000)).astype(np.float32), rng.normal(size=(3, 5000))
    product = gram(left, right)
    np.testing.assert_allclose(product, left.astype(float) @ right.T, atol=1e-10)
    before = numba.get_num_threads()
    try:
        for threads in {1, min(2, numba.config.NUMBA_NUM_THREADS)}:
            numba.set_num_threads(threads)
            assert gram(left, right).tobytes() == product.tobytes()
    finally:
        numba.set_num_threads(before)
