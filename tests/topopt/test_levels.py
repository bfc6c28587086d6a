"""Coarse to fine: the same optimum in fewer fine steps, parameters of the levels, checkpoints."""

from dataclasses import replace

import numpy as np
import pytest

from tests.topopt.small_problems import cantilever
from topopt.checkpoint import Checkpoints
from topopt.geometry import tet_geometry
from topopt.levels import Levels, coarse_settings
from topopt.optimize import OptimizationSettings, optimize
from topopt.parameters import auto_eps

SETTINGS = OptimizationSettings(steps=80, tolerance=1e-2, stagnation=0.0, solver="multigrid")
COARSE, FINE = (6, 2, 4), (12, 4, 8)


def nested(settings=SETTINGS, callback=None, **changes):
    """(rough, result, meshes) of the small cantilever on two levels."""
    (coarse, problem), (fine, _) = cantilever(COARSE, **changes), cantilever(FINE, **changes)
    levels = Levels(problem, coarse, 2)
    rough = optimize(coarse, problem, coarse_settings(settings), levels.first(), callback)
    start = levels.next(coarse, rough.loop, fine)
    return rough, optimize(fine, problem, settings, start, callback), (coarse, fine)


@pytest.fixture(scope="module")
def finished():
    return nested()


@pytest.fixture(scope="module")
def alone():
    mesh, problem = cantilever(FINE)
    return optimize(mesh, problem, SETTINGS)


def test_the_optimum_is_the_same_in_half_the_fine_steps(finished, alone):
    _, result, _ = finished
    assert result.outcome == alone.outcome == "tolerance"
    one, two = result.history[-1].objective_J, alone.history[-1].objective_J
    assert one == pytest.approx(two, rel=0.02)
    assert len(result.loop.rows) - 1 <= 0.5 * (len(alone.history) - 1)
    assert (result.gamma, result.eps) == (alone.gamma, alone.eps)


def test_every_row_tells_its_level_and_has_the_volume(finished):
    rough, result, (coarse, fine) = finished
    steps = len(rough.history) - 1
    levels = [row.level for row in result.history]
    assert levels == [1] * (steps + 1) + [2] * len(result.loop.rows)
    assert [row.iteration for row in result.loop.rows[:3]] == [steps, steps + 1, steps + 2]
    for phi, mesh in ((rough.phase_field.values, coarse), (result.phase_field.values, fine)):
        mass = tet_geometry(mesh).lumped_mass
        assert mass @ phi == pytest.approx(0.4 * mass.sum(), rel=1e-12)
    assert all(row.volume_error < 1e-12 for row in result.history)
    assert result.loop.rows[0].seconds > rough.history[-1].seconds


def test_the_fine_start_is_near_the_coarse_end(finished):
    rough, result, _ = finished
    begun, coarse_end, first = (
        row.objective_J for row in (rough.history[0], rough.history[-1], result.loop.rows[0])
    )
    assert first - coarse_end < 0.25 * (begun - coarse_end)


def test_as_many_elements_cross_the_interface_on_every_level():
    coarse, problem = cantilever(COARSE)
    levels = Levels(replace(problem, eps=0.1), coarse, 3)
    assert [levels.eps_on(level) for level in (1, 2, 3)] == pytest.approx([0.4, 0.2, 0.1])
    assert levels.first().eps == levels.eps_on(1)


def test_what_is_left_open_is_chosen_for_the_last_mesh():
    settings = replace(SETTINGS, steps=1)
    rough, result, (coarse, fine) = nested(settings, gamma=None, eps=None)
    assert result.eps == pytest.approx(auto_eps(fine), rel=0.1)
    assert rough.eps == pytest.approx(auto_eps(coarse), rel=1e-12)
    assert result.gamma / result.eps == pytest.approx(rough.gamma / rough.eps, rel=1e-12)


@pytest.mark.parametrize("stop", [3, 8])
def test_a_run_goes_on_in_its_level_bit_for_bit(tmp_path, stop):
    settings = replace(SETTINGS, steps=6, tolerance=0.0, solver="direct")
    (coarse, problem), (fine, _) = cantilever((3, 1, 2)), cantilever((6, 2, 4))
    keep, levels = Checkpoints(tmp_path, {"mesh": ("a", "b")}), Levels(problem, coarse, 2)

    def through(start, callback=None):
        rows = []

        def note(row, loop):
            rows.append(row)
            if callback:
                callback(row, loop)

        if start.level == 1:
            rough = optimize(coarse, problem, settings, start, note)
            start = levels.next(coarse, rough.loop, fine)
        return optimize(fine, problem, settings, start, note)

    def stopping(row, loop):
        keep.write(loop)
        if row.iteration == stop:
            raise StopIteration

    whole = through(levels.first())
    with pytest.raises(StopIteration):
        through(levels.first(), stopping)
    start = keep.read()
    assert start.level == (1 if stop < 6 else 2) and start.history[-1].iteration == stop
    resumed = through(start)
    assert np.array_equal(resumed.phase_field.values, whole.phase_field.values)
    rows = [[replace(row, seconds=0.0) for row in r.history] for r in (resumed, whole)]
    assert rows[0] == rows[1]
