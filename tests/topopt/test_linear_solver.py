"""The slot: choice by name, fall-back, and the errors of solvers that stall."""

import logging

import numpy as np
import pytest
from scipy.sparse import bsr_array

from meshes.errors import InvalidCase, NotConverged
from meshes.structured import bcc_box
from tests.topopt import reference_elasticity as twin
from topopt.assembly import Assembler
from topopt.geometry import tet_geometry
from topopt.linear_solver import (
    DirectSolver,
    FallbackSolver,
    PyamgSolver,
    make_solver,
    rigid_body_modes,
)
from topopt.multigrid import MultigridSolver
from topopt.problem import Material


def system(cells=(10, 3, 4), fixed=None):
    """Matrix, modes and forces of a bridge of uniform material."""
    mesh = bcc_box(twin.LOWER, twin.UPPER, cells)
    conditions = twin.bridge_conditions(mesh)
    fixed = conditions.fixed if fixed is None else np.broadcast_to(fixed, conditions.fixed.shape)
    geometry = tet_geometry(mesh)
    assembler = Assembler(mesh.tets, geometry.volumes, geometry.gradients, Material(), fixed)
    matrix = assembler.assemble(np.ones(len(mesh.tets)))
    forces = np.where(fixed, 0.0, conditions.forces)
    return matrix, rigid_body_modes(mesh.points, fixed), forces


@pytest.mark.parametrize("name", ["multigrid", "pyamg", "direct", "auto"])
def test_every_solver_keeps_its_promise(name):
    matrix, modes, forces = system()
    solver = make_solver(name, matrix, modes)
    solver.update(matrix)
    solution = solver.solve(forces, tolerance=1e-7)
    residual = forces.ravel() - matrix @ solution.displacement.ravel()
    assert np.linalg.norm(residual) <= 1e-7 * np.linalg.norm(forces)
    np.testing.assert_allclose(solution.residual_vector.ravel(), residual, atol=1e-12)
    assert len(solution.history) >= 1
    again = solver.solve(forces, start=solution.displacement, tolerance=1e-7)
    assert again.iterations <= 1


@pytest.mark.parametrize("name", ["multigrid", "pyamg"])
@pytest.mark.parametrize("tolerance", [0.1, 1e-3])
def test_the_energy_of_the_error_is_estimated(name, tolerance):
    matrix, modes, forces = system()
    solver = make_solver(name, matrix, modes)
    solver.update(matrix)
    solution = solver.solve(forces, tolerance=tolerance)
    error = np.linalg.solve(matrix.toarray(), solution.residual_vector.ravel())
    energy = error @ solution.residual_vector.ravel()
    most = 3.0 if name == "pyamg" else 30.0  # the other takes the last iteration but one
    assert 0.3 * energy < solution.error_energy < most * energy
    again = solver.solve(forces, start=solution.displacement, tolerance=tolerance)
    assert again.iterations == 0 and 0.3 * energy < again.error_energy < 3.0 * energy


def test_a_start_is_scaled_and_never_much_worse_than_none():
    matrix, modes, forces = system()
    solver = make_solver("multigrid", matrix, modes)
    solver.update(matrix)
    solution = solver.solve(forces, tolerance=1e-8)
    twofold = solver.solve(forces, start=-30.0 * solution.displacement, tolerance=1e-6)
    assert len(twofold.history) == 2  # that of the scaled start, and the true one once more
    from_nothing = solver.solve(forces, tolerance=1e-6).iterations
    wild = 1e6 * np.random.default_rng(0).standard_normal(forces.shape)
    wild *= np.abs(solution.displacement).max()
    assert solver.solve(forces, start=wild, tolerance=1e-6).iterations <= from_nothing + 3


def test_auto_factorises_small_systems_and_takes_multigrid_for_others():
    matrix, modes, _ = system((1, 1, 1))
    assert isinstance(make_solver("auto", matrix, modes), DirectSolver)
    matrix, modes, forces = system((16, 5, 6))
    solver = make_solver("auto", matrix, modes)
    solver.update(matrix)
    assert solver.solve(forces).solver == "multigrid"


def test_unknown_name():
    matrix, modes, _ = system((1, 1, 1))
    with pytest.raises(InvalidCase, match=r"one of auto, multigrid, pyamg, direct, got 'gpu'"):
        make_solver("gpu", matrix, modes)


@pytest.mark.parametrize("name", ["multigrid", "pyamg", "direct"])
def test_no_load_no_displacement(name):
    matrix, modes, forces = system((4, 2, 2))
    solver = make_solver(name, matrix, modes)
    solver.update(matrix)
    assert not solver.solve(0 * forces).displacement.any()


def test_stalled_solvers_say_so_and_carry_their_history():
    matrix, modes, forces = system()
    for solver in (
        MultigridSolver(matrix, modes, max_iterations=3),
        PyamgSolver(modes, max_iterations=3),
    ):
        solver.update(matrix)
        with pytest.raises(NotConverged, match="stalled") as caught:
            solver.solve(forces, tolerance=1e-9)
        assert len(caught.value.history) > 3
        assert min(caught.value.history) > 1e-9


def test_fall_back_is_logged_and_answers(caplog):
    matrix, modes, forces = system()
    solver = FallbackSolver(
        [
            lambda: MultigridSolver(matrix, modes, max_iterations=2),
            lambda: PyamgSolver(modes, max_iterations=2),
            DirectSolver,
        ]
    )
    for _ in range(2):  # every matrix starts again with the first solver
        caplog.clear()
        solver.update(matrix)
        with caplog.at_level(logging.WARNING, logger="phasemesh"):
            solution = solver.solve(forces, tolerance=1e-8)
        assert solution.solver == "direct"
        assert solution.history[-1] <= 1e-8
        said = [record.getMessage() for record in caplog.records]
        assert [m.split()[0] for m in said] == ["multigrid", "pyamg"]
    hopeless = FallbackSolver([lambda: PyamgSolver(modes, max_iterations=2)])
    hopeless.update(matrix)
    with pytest.raises(NotConverged):
        hopeless.solve(forces, tolerance=1e-8)


def test_a_singular_matrix_is_named_not_solved():
    matrix, _, forces = system((4, 2, 2))
    singular = matrix.toarray()
    singular[0] = singular[:, 0] = 0.0
    with pytest.raises(NotConverged, match="supports"):
        solver = DirectSolver()
        solver.update(bsr_array(singular, blocksize=(3, 3)))
        solver.solve(np.ones_like(forces))


def test_rigid_body_modes_span_translations_and_rotations():
    points = np.random.default_rng(0).uniform(2.0, 9.0, (30, 3))
    modes = rigid_body_modes(points, np.zeros((30, 3), bool)).reshape(90, 6)
    spin = np.array([[0, -3, 2], [3, 0, -1], [-2, 1, 0.0]])
    motion = (points @ spin.T + [5.0, 6.0, 7.0]).ravel()
    rest = motion - modes @ np.linalg.lstsq(modes, motion)[0]
    assert np.abs(rest).max() <= 1e-12 * np.abs(motion).max()
    fixed = np.random.default_rng(1).random((30, 3)) < 0.5
    assert not rigid_body_modes(points, fixed)[fixed].any()
