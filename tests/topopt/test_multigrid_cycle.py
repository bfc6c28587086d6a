"""The cycle against dense twins; symmetry, definiteness, two-grid convergence, robustness."""

from itertools import pairwise

import numba
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from meshes.structured import bcc_box
from tests.topopt import reference_elasticity as twin
from topopt.elasticity import ElasticModel
from topopt.interpolation import stiffness_factor
from topopt.multigrid import CycleSettings, cycle_kernels, solver_kernels
from topopt.multigrid.cycle import (
    apply_cycle,
    chebyshev_steps,
    smooth,
    smooth_from_zero,
    solve_by_krylov,
)
from topopt.multigrid.hierarchy import SINGLE
from topopt.multigrid.solver import MultigridSolver

V_CYCLE = CycleSettings(krylov_unknowns=0)


def bridge_solver(mesh, void_ratio=1e-4, phi=None, settings=None, **options):
    """A multigrid solver with the matrix of an arch, and the forces on it, in solver order."""
    conditions = twin.bridge_conditions(mesh)
    model = ElasticModel(mesh, twin.make_problem(void_ratio=void_ratio), conditions, "pyamg")
    phi = twin.arch(mesh.points) if phi is None else phi
    assemble = model._assembler.assemble
    factor = stiffness_factor(phi, mesh.tets, void_ratio)[model._tet_order]
    solver = MultigridSolver(
        assemble(np.ones(len(factor))), model._solver._modes.reshape(-1, 3, 6), settings, **options
    )
    solver.update(assemble(factor))
    return solver, np.where(conditions.fixed, 0.0, conditions.forces)[model._order]


@pytest.fixture(scope="module")
def levels():
    mesh = twin.perturbed_box(twin.LOWER, twin.UPPER, (6, 2, 3))
    return bridge_solver(mesh, coarsest=60)[0].hierarchy.levels


def dense_matrix(level):
    return twin.dense(level.pattern, level.blocks.astype(float), level.pattern.rows)


def test_cycle_kernels_against_dense_twins(levels):
    assert [level.width for level in levels] == [3, 6, 6]
    rng = np.random.default_rng(0)
    for level, coarse in pairwise(levels):
        a = dense_matrix(level)
        p = twin.dense(
            level.transfer.prolongator, level.p_blocks.astype(float), coarse.pattern.rows
        )
        d = np.zeros_like(a)
        for row, block in enumerate(level.inverse):
            part = slice(row * level.width, (row + 1) * level.width)
            d[part, part] = block
        f, x, step, r = (rng.standard_normal(level.f.shape).astype(SINGLE) for _ in range(4))
        out = np.empty_like(f)

        def close(found, expected):
            size = np.abs(expected).max()
            assert_allclose(found.ravel(), expected, rtol=0, atol=3e-6 * size)

        level.take_residual(f, x, out)
        close(out, f.ravel() - a @ x.ravel())
        level.step[:] = step
        level.apply_step(f, x, SINGLE(0.3), SINGLE(0.7), out)
        expected = 0.3 * step.ravel() + 0.7 * d @ (f.ravel() - a @ x.ravel())
        close(level.step, expected)
        close(out, x.ravel() + expected)
        cycle_kernels.first_step(level.chunks, level.inverse, f, SINGLE(0.7), level.step, out)
        close(out, 0.7 * d @ f.ravel())
        level.residual[:] = r
        level.restrict(coarse)
        close(coarse.f, p.T @ r.ravel())
        coarse.x[:] = rng.standard_normal(coarse.x.shape)
        level.x[:] = x
        level.prolong(coarse)
        close(level.x, x.ravel() + p @ coarse.x.ravel())
        found = cycle_kernels.inner_product(f, r)
        assert found == pytest.approx(f.ravel().astype(float) @ r.ravel().astype(float), rel=1e-6)
    coarsest = levels[-1]
    f = rng.standard_normal(coarsest.f.shape).astype(SINGLE)
    out = np.empty_like(f)
    cycle_kernels.dense_product(coarsest.dense_inverse, f, out)
    inverse = coarsest.dense_inverse.astype(float).transpose(0, 2, 1, 3).reshape(f.size, f.size)
    close(out, inverse @ f.ravel())


def test_outer_kernels_against_numpy():
    rng = np.random.default_rng(0)
    solver, f = bridge_solver(bcc_box(twin.LOWER, twin.UPPER, (6, 2, 3)))
    chunks, partial, matrix = solver._chunks, solver._partial, solver._matrix
    dense = twin.dense(solver.hierarchy.levels[0].pattern, matrix[2], len(f))
    p, q, x, r = (rng.standard_normal(f.shape) for _ in range(4))
    z, single = r.astype(SINGLE), np.empty(f.shape, SINGLE)
    product = np.empty_like(p)
    found = solver_kernels.multiply_and_dot(chunks, *matrix, z, r, q, product, partial)
    assert_allclose(product.ravel(), dense @ z.ravel(), atol=1e-12 * np.abs(product).max())
    assert_allclose(found, [np.vdot(z, r), np.vdot(z, product), np.vdot(z, q)], rtol=1e-12)
    before = [v.copy() for v in (p, q, x, r)]
    found = solver_kernels.advance(chunks, 0.2, 0.3, z, product, 0.5, p, q, x, r, single, partial)
    assert_allclose(p, z + 0.3 * before[0], rtol=1e-13, atol=1e-13)
    assert_allclose(q, product + 0.3 * before[1], rtol=0, atol=1e-14 * np.abs(product).max())
    assert_allclose(x, before[2] + 0.2 * p, rtol=1e-12, atol=1e-13)
    assert_allclose(r, before[3] - 0.2 * q, rtol=0, atol=1e-14 * np.abs(q).max())
    assert_allclose(single, 0.5 * r, rtol=1e-6)
    assert found == pytest.approx(np.vdot(r, r), rel=1e-12)
    found = solver_kernels.true_residual(chunks, *matrix, f, x, r, partial)
    assert_allclose(r.ravel(), f.ravel() - dense @ x.ravel(), atol=1e-12 * np.abs(r).max())
    assert found == pytest.approx(np.vdot(r, r), rel=1e-12)


@pytest.mark.parametrize("degree", [1, 2, 4])
def test_chebyshev_smoother_is_the_chebyshev_polynomial(degree):
    """The error is reduced by T_k((c - t) / d) / T_k(c / d) at each eigenvalue t."""
    lower, upper = 0.2, 1.1
    t = np.linspace(0.0, 1.2, 50)
    error, step = np.ones_like(t), np.zeros_like(t)
    for momentum, gain in chebyshev_steps(degree, lower, upper):
        step = momentum * step - gain * t * error
        error = error + step
    polynomial = np.polynomial.chebyshev.Chebyshev.basis(degree)
    centre, radius = (upper + lower) / 2, (upper - lower) / 2
    expected = polynomial((centre - t) / radius) / polynomial(centre / radius)
    assert_allclose(error, expected, atol=1e-13)


def cycle_matrix(levels, settings, depth=0):
    """The linear map f -> x of a cycle, column by column."""
    level = levels[depth]
    columns = []
    for unit in np.eye(level.f.size, dtype=SINGLE):
        level.f[:] = unit.reshape(level.f.shape)
        apply_cycle(levels, settings, depth)
        columns.append(level.x.astype(float).ravel())
    return np.array(columns).T


def test_v_cycle_is_symmetric_positive_definite(levels):
    b = cycle_matrix(levels, V_CYCLE)
    assert_allclose(b, b.T, atol=2e-5 * np.abs(b).max())
    d = 1 / np.sqrt(np.diag(b))  # eigenvalues are judged after scaling: void is 1e4 times softer
    assert np.linalg.eigvalsh((d[:, None] * b * d + (d[:, None] * b * d).T) / 2).min() > 1e-4


@pytest.mark.parametrize("material, limit", [("uniform", 0.65), ("arch", 0.85)])
def test_two_grid_cycle_and_v_cycle_converge(material, limit):
    """The spectral radius of I - B A, with the coarse level solved exactly and by a cycle."""
    mesh = twin.perturbed_box(twin.LOWER, twin.UPPER, (6, 2, 3))
    phi = np.ones(len(mesh.points)) if material == "uniform" else twin.arch(mesh.points)
    levels = bridge_solver(mesh, phi=phi, coarsest=60)[0].hierarchy.levels
    a = dense_matrix(levels[0])
    coarse = dense_matrix(levels[1])
    level = levels[0]
    p = twin.dense(level.transfer.prolongator, level.p_blocks.astype(float), levels[1].pattern.rows)
    identity = np.eye(len(a))
    columns = []
    for unit in np.eye(len(a), dtype=SINGLE):
        level.f[:] = unit.reshape(level.f.shape)
        smooth_from_zero(level, V_CYCLE.degree, V_CYCLE.lower, V_CYCLE.upper)
        columns.append(level.x.astype(float).ravel())
    smoothing = identity - np.array(columns).T @ a
    correction = identity - p @ np.linalg.solve(coarse, p.T @ a)
    root = np.linalg.cholesky(a)

    def radius(error):  # the error operators are self-adjoint in the energy a = root root^T
        symmetric = root.T @ np.linalg.solve(root, error.T).T
        return np.abs(np.linalg.eigvalsh((symmetric + symmetric.T) / 2)).max()

    two_grid = radius(smoothing @ correction @ smoothing)
    one_grid = radius(smoothing @ smoothing)
    v_cycle = radius(identity - cycle_matrix(levels, V_CYCLE) @ a)
    assert one_grid > 0.95  # a smoother alone does not converge
    assert two_grid < limit
    assert v_cycle < two_grid + 0.06


def test_smoothing_goes_on_from_where_it_stands(levels):
    level = levels[0]
    a = dense_matrix(level)
    rng = np.random.default_rng(0)
    exact = rng.standard_normal(level.f.shape)
    level.f[:] = (a @ exact.ravel()).reshape(level.f.shape)
    level.x[:] = 0
    errors = []
    for _ in range(4):
        off = level.x - exact
        errors.append(off.ravel() @ a @ off.ravel())
        smooth(level, 2, 0.2, 1.1)
    assert np.all(np.diff(errors) < 0)


ROBUST = {
    "bcc": bcc_box(twin.LOWER, twin.UPPER, (20, 6, 8)),
    "random": twin.perturbed_box(twin.LOWER, twin.UPPER, (20, 6, 8), amount=0.25),
    "stretched": bcc_box(twin.LOWER, twin.UPPER, (10, 12, 8)),
}


@pytest.mark.parametrize("void_ratio", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("name", ["bcc", "random", "stretched"])
def test_iterations_do_not_depend_on_contrast_or_mesh(name, void_ratio):
    solver, f = bridge_solver(ROBUST[name], void_ratio)
    solution = solver.solve(f, tolerance=1e-6)
    limit = {"bcc": 22, "random": 26, "stretched": 34}[name]
    assert 5 < solution.iterations <= limit


def test_iterations_hardly_grow_with_the_mesh():
    counts = []
    for cells in ((10, 3, 4), (20, 6, 8), (30, 9, 12)):
        solver, f = bridge_solver(bcc_box(twin.LOWER, twin.UPPER, cells))
        counts.append(solver.solve(f, tolerance=1e-6).iterations)
    assert max(counts) <= 22


def test_k_cycle_needs_no_more_iterations_than_v_cycle():
    mesh = ROBUST["bcc"]
    counts = {}
    for name, unknowns in (("V", 0), ("K", 10**6)):
        settings = CycleSettings(krylov_unknowns=unknowns)
        solver, f = bridge_solver(mesh, settings=settings, coarsest=60)
        assert len(solver.hierarchy.levels) == 4 or len(solver.hierarchy.levels) == 3
        counts[name] = solver.solve(f, tolerance=1e-8).iterations
    assert counts["K"] < counts["V"]


def test_k_cycle_minimises_the_energy_over_two_directions(levels):
    """x = argmin of x.A x / 2 - f.x over the span of B f and B (f - alpha A B f)."""
    level, settings = levels[1], CycleSettings()
    a, b = dense_matrix(level), cycle_matrix(levels, settings, depth=1)
    f = np.random.default_rng(0).standard_normal(level.f.size)
    first = b @ f
    second = b @ (f - (first @ f) / (first @ a @ first) * a @ first)
    directions = np.stack([first, second], axis=1)
    weights = np.linalg.solve(directions.T @ a @ directions, directions.T @ f)
    expected = directions @ weights
    level.f[:] = f.reshape(level.f.shape)
    solve_by_krylov(levels, settings, 1)
    energy = np.sqrt(expected @ a @ expected)
    off = level.x.ravel() - expected
    assert np.sqrt(off @ a @ off) < 2e-6 * energy
    assert_allclose(level.f.ravel(), f, rtol=1e-6)


def test_numbers_do_not_depend_on_earlier_matrices():
    mesh = ROBUST["bcc"]
    solver, f = bridge_solver(mesh)
    matrix = solver._matrix
    first = solver.solve(f).displacement
    other, _ = bridge_solver(mesh, phi=np.ones(len(mesh.points)))
    stranger = other._matrix[2]
    for data in (stranger, matrix[2]):
        solver.hierarchy.update(data)
    assert_array_equal(solver.solve(f).displacement, first)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="one thread only")
def test_same_bits_on_one_thread_and_on_two():
    results = []
    for threads in (1, 2):
        numba.set_num_threads(threads)
        solver, f = bridge_solver(ROBUST["random"])
        results.append(solver.solve(f))
    assert results[0].history == results[1].history
    assert_array_equal(results[0].displacement, results[1].displacement)
