"""The gathering assembly against scikit-fem, a dense twin, and itself on other threads."""

import numba
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from meshes.structured import bcc_box
from tests.topopt import reference_elasticity as twin
from topopt.assembly import Assembler, edges_and_tets
from topopt.geometry import tet_geometry
from topopt.problem import Material
from topopt.weak_form import WeakFormAssembler


def setting(mesh, seed=0):
    """Random factors over four decades, random fixed degrees of freedom, and the assembler."""
    rng = np.random.default_rng(seed)
    fixed = rng.random(mesh.points.shape) < 0.1
    factor = 10 ** rng.uniform(-4, 0, len(mesh.tets))
    geometry = tet_geometry(mesh)
    assembler = Assembler(mesh.tets, geometry.volumes, geometry.gradients, Material(), fixed)
    return assembler, factor, fixed


@pytest.mark.parametrize(
    "mesh",
    [
        bcc_box((0, 0, 0), (0.05, 0.015, 0.02), (10, 3, 4)),
        twin.perturbed_box((0, 0, 0), (1e3, 2e3, 1e4), (4, 3, 4), amount=0.25),
    ],
    ids=["bcc", "perturbed"],
)
def test_matrix_is_scikit_fems(mesh):
    assembler, factor, fixed = setting(mesh)
    matrix = assembler.assemble(factor)
    reference = WeakFormAssembler(mesh, Material(), fixed).assemble(factor)
    assert abs(matrix - reference).max() <= 1e-14 * abs(reference).max()


def test_a_matrix_may_take_the_place_of_an_earlier_one():
    mesh = bcc_box((0, 0, 0), (1, 1, 1), (3, 2, 2))
    assembler, factor, _ = setting(mesh)
    fresh = assembler.assemble(factor)
    earlier = assembler.assemble(factor[::-1])
    assert np.any(earlier.data != fresh.data)
    again = assembler.assemble(factor, earlier)
    assert np.shares_memory(again.data, earlier.data)
    assert_array_equal(again.data, fresh.data)


def test_both_assemblies_are_the_dense_twins():
    mesh = twin.perturbed_box((0, 0, 0), (1.0, 2.0, 1.0), (1, 2, 1))
    assembler, factor, fixed = setting(mesh)
    dense = twin.stiffness(mesh, Material(), factor, fixed)
    size = np.abs(dense).max()
    assert_allclose(assembler.assemble(factor).toarray(), dense, rtol=0, atol=1e-14 * size)
    reference = WeakFormAssembler(mesh, Material(), fixed).assemble(factor)
    assert_allclose(reference.toarray(), dense, rtol=0, atol=1e-14 * size)


def test_fixed_rows_and_columns_hold_their_diagonal_entry_alone():
    mesh = bcc_box((0, 0, 0), (1, 1, 1), (2, 2, 2))
    assembler, factor, fixed = setting(mesh)
    matrix = assembler.assemble(factor).toarray()
    held = np.flatnonzero(fixed)
    assert np.all(np.diag(matrix) > 0)
    off_diagonal = matrix - np.diag(np.diag(matrix))
    assert not off_diagonal[held].any()
    assert not off_diagonal[:, held].any()


def test_rigid_motions_cost_no_energy():
    mesh = twin.perturbed_box((0, 0, 0), (1, 1, 1), (3, 2, 2))
    geometry = tet_geometry(mesh)
    free = np.zeros(mesh.points.shape, bool)
    assembler = Assembler(mesh.tets, geometry.volumes, geometry.gradients, Material(), free)
    matrix = assembler.assemble(np.random.default_rng(0).random(len(mesh.tets)))
    spin = np.array([[0, -3, 2], [3, 0, -1], [-2, 1, 0.0]])
    motion = (mesh.points @ spin.T + [5, 6, 7]).ravel()
    assert np.abs(matrix @ motion).max() <= 1e-13 * abs(matrix).max() * np.abs(motion).max()


def test_edges_and_the_tets_around_them():
    mesh = bcc_box((0, 0, 0), (1, 1, 1), (2, 1, 2))
    edges, start, corners = edges_and_tets(mesh.tets, len(mesh.points))
    around = {}
    for e, tet in enumerate(mesh.tets):
        for a in range(4):
            for b in range(4):
                if tet[a] < tet[b]:
                    around.setdefault((tet[a], tet[b]), set()).add((e, a, b))
    assert [tuple(edge) for edge in edges] == sorted(around)
    for s, edge in enumerate(edges):
        codes = corners[start[s] : start[s + 1]]
        found = {(code >> 4, (code >> 2) & 3, code & 3) for code in codes}
        assert found == around[tuple(edge)]


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="one thread only")
def test_same_bits_on_one_thread_and_on_two():
    assembler, factor, _ = setting(bcc_box((0, 0, 0), (1, 1, 1), (6, 6, 6)))
    results = []
    for threads in (1, 2):
        numba.set_num_threads(threads)
        results.append(assembler.assemble(factor).data)
    assert_array_equal(*results)
