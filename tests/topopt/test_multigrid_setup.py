"""Each set-up kernel of the hierarchy against a slow twin, and what the theory asks of it."""

import numpy as np
import pyamg.aggregation
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse import csr_array

from tests.topopt import reference_elasticity as twin
from topopt.assembly import Assembler
from topopt.geometry import morton_order, tet_geometry
from topopt.linear_solver import rigid_body_modes
from topopt.multigrid.aggregation import DEPENDENT, aggregate_level, aggregate_nodes
from topopt.multigrid.hierarchy import Hierarchy
from topopt.multigrid.patterns import MAX_CHUNKS, equal_chunks
from topopt.problem import Material


def random_graph(n, seed):
    """A symmetric graph with self-loops, as a csr_array and as sets of neighbours."""
    points = np.random.default_rng(seed).random((n, 3))
    near = np.linalg.norm(points[:, None] - points, axis=2) < 0.25
    neighbours = [set(np.flatnonzero(row)) - {i} for i, row in enumerate(near)]
    return csr_array(near.astype(np.int32)), neighbours


@pytest.mark.parametrize("seed", range(4))
def test_aggregates_against_their_twin(seed):
    graph, neighbours = random_graph(200, seed)
    taking_part = np.random.default_rng(seed).random(200) > 0.1 * seed
    aggregates, count = aggregate_nodes(graph.indptr, graph.indices, taking_part)
    expected, expected_count = twin.aggregate(neighbours, taking_part)
    assert count == expected_count
    assert_array_equal(aggregates, expected)


def test_aggregates_are_as_many_as_pyamgs():
    graph, _ = random_graph(600, 7)
    _, count = aggregate_nodes(graph.indptr, graph.indices, np.ones(600, bool))
    theirs, _ = pyamg.aggregation.standard_aggregation(graph)
    assert count == pytest.approx(theirs.shape[1], rel=0.05)


@pytest.fixture(scope="module")
def setting():
    """A random mesh with a hierarchy of three levels on it: hierarchy, matrix, modes."""
    mesh = twin.perturbed_box(twin.LOWER, twin.UPPER, (6, 3, 3), amount=0.2)
    conditions = twin.bridge_conditions(mesh)
    order = morton_order(mesh.points)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    geometry = tet_geometry(mesh)
    fixed = conditions.fixed[order]
    assembler = Assembler(place[mesh.tets], geometry.volumes, geometry.gradients, Material(), fixed)
    factor = 10 ** np.random.default_rng(0).uniform(-4, 0, len(mesh.tets))
    modes = rigid_body_modes(mesh.points[order], fixed)
    hierarchy = Hierarchy(assembler.assemble(np.ones(len(mesh.tets))), modes, coarsest=60)
    matrix = assembler.assemble(factor)
    hierarchy.update(matrix.data)
    assert [level.width for level in hierarchy.levels] == [3, 6, 6]
    return hierarchy, matrix, modes


def test_tentative_prolongator_is_orthonormal_and_holds_the_modes(setting):
    hierarchy, _, modes = setting
    for aggregation in hierarchy.aggregations:
        t = aggregation.tentative
        member = aggregation.aggregates >= 0
        assert np.all(aggregation.aggregates[~np.any(modes != 0, axis=(1, 2))] < 0)
        again = np.einsum(
            "nbc,ncd->nbd", t[member], aggregation.coarse_modes[aggregation.aggregates[member]]
        )
        assert_allclose(again, modes[member], atol=1e-13 * np.abs(modes).max())
        gram = np.zeros((aggregation.count, 6, 6))
        np.add.at(gram, aggregation.aggregates[member], np.einsum("nbc,nbd->ncd", t, t)[member])
        diagonal = np.einsum("gii->gi", gram)
        assert np.all(np.isclose(diagonal, 1.0) | (diagonal == 0.0))
        assert_allclose(gram, np.einsum("gi,ij->gij", diagonal, np.eye(6)), atol=1e-9)
        modes = aggregation.coarse_modes


def test_an_aggregate_without_rotations_gets_zero_columns():
    modes = rigid_body_modes(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]]), np.zeros((3, 3), bool))
    isolated = csr_array(np.eye(3, dtype=np.int32))
    aggregation = aggregate_level(isolated.indptr, isolated.indices, modes)
    assert aggregation.count == 3
    for g in range(3):
        lengths = np.linalg.norm(aggregation.tentative[g], axis=0)
        assert_allclose(np.sort(lengths), [0, 0, 0, 1, 1, 1], atol=1e-12)
    pair = csr_array(np.ones((2, 2), np.int32))  # two nodes cannot turn about their own line
    aggregation = aggregate_level(pair.indptr, pair.indices, modes[:2])
    lengths = np.linalg.norm(aggregation.tentative.reshape(6, 6), axis=0)
    assert np.sum(lengths > DEPENDENT) == 5


def test_smoothed_prolongator_and_galerkin_product_against_dense_twins(setting):
    hierarchy, _, _ = setting
    for level in hierarchy.levels[:-1]:
        b, count = level.width, level.transfer.coarse.rows
        a = twin.dense(level.pattern, level.blocks.astype(float), level.pattern.rows)
        d_inverse = np.linalg.inv(twin.block_diagonal(a, b))
        blocks = level.inverse.astype(float)
        for row in range(0, level.pattern.rows, 37):
            part = slice(row * b, row * b + b)
            assert_allclose(
                blocks[row], d_inverse[part, part], rtol=1e-5, atol=1e-5 * np.abs(blocks[row]).max()
            )
        root = np.linalg.cholesky(d_inverse)
        largest = np.linalg.eigvalsh(root.T @ a @ root)[-1]
        # the smoother of degree 2 stays convergent up to 1.3 times the estimate
        assert 0.8 * largest < level.largest < 1.05 * largest
        t = twin.dense_tentative(level, count)
        p = t - 4 / (3 * level.largest) * d_inverse @ (a @ t)
        found = twin.dense(level.transfer.prolongator, level.p_blocks.astype(float), count)
        assert_allclose(found, p, rtol=0, atol=2e-6 * np.abs(p).max())
        coarse = found.T @ a @ found
        dead = np.flatnonzero(np.diag(coarse) == 0.0)
        coarse[dead, dead] = 1.0
        galerkin = twin.dense(level.transfer.coarse, level.coarse_blocks.astype(float), count)
        assert_allclose(galerkin, coarse, rtol=0, atol=2e-6 * np.abs(coarse).max())
        assert_array_equal(galerkin, galerkin.T)


def test_smoothed_prolongator_keeps_rigid_motions_away_from_supports(setting):
    """P times the coarse modes is rigid where no support is near: the near-null-space property."""
    hierarchy, _, modes = setting
    level, aggregation = hierarchy.levels[0], hierarchy.aggregations[0]
    p = twin.dense(level.transfer.prolongator, level.p_blocks.astype(float), aggregation.count)
    rigid = (p @ aggregation.coarse_modes.reshape(-1, 6)).reshape(modes.shape)
    graph = level.pattern.graph()
    held = np.any(modes[:, range(3), range(3)] == 0.0, axis=1)
    away = graph @ held.astype(float) == 0.0
    assert away.sum() > 0.3 * len(away)
    assert_allclose(rigid[away], modes[away], atol=1e-5)


def test_coarsest_inverse(setting):
    coarsest = setting[0].levels[-1]
    dense = twin.dense(coarsest.pattern, coarsest.blocks.astype(float), coarsest.pattern.rows)
    inverse = coarsest.dense_inverse.astype(float).transpose(0, 2, 1, 3).reshape(dense.shape)
    identity = inverse @ dense
    assert_allclose(identity, np.eye(len(dense)), atol=1e-3)


def test_chunks_are_balanced_and_cover_every_row():
    work = np.random.default_rng(0).integers(0, 50, 20_000)
    chunks = equal_chunks(work)
    assert chunks[0] == 0 and chunks[-1] == len(work) and np.all(np.diff(chunks) >= 0)
    assert len(chunks) == MAX_CHUNKS + 1
    sums = np.add.reduceat(work, chunks[:-1])
    assert sums.max() < 1.1 * sums.mean()
    assert_array_equal(equal_chunks(np.ones(5)), [0, 5])
