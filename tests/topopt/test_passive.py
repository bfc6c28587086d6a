"""Passive regions: nodes that keep their phase, and what is said where they cannot."""

from dataclasses import replace

import numpy as np
import pytest

from meshes import InvalidCase
from tests.topopt.small_problems import cantilever
from topopt.geometry import tet_geometry
from topopt.optimize import OptimizationSettings, optimize, prepare
from topopt.passive import passive_bounds
from topopt.problem import Box, Passive, Sphere

INF = np.inf
DECK = Passive("deck", Box((-INF, -INF, 0.035), (INF, INF, 0.04)), solid=True)
HOLE = Passive("hole", Sphere((0.02, 0.01, 0.015), 0.008), solid=False)


def passive_cantilever(*regions, cells=(6, 2, 8), **changes):
    mesh, problem = cantilever(cells)
    return mesh, replace(problem, passive=regions, **changes)


@pytest.mark.parametrize(
    ("method", "step"),
    [("vmpt", "variable_metric"), ("allen_cahn", "variable_metric"), ("allen_cahn", "fixed")],
)
def test_passive_nodes_keep_their_phase_and_the_volume_counts_them(method, step):
    mesh, problem = passive_cantilever(DECK, HOLE)
    tau = 1e-5 if step == "fixed" else None
    method = "allen_cahn" if step == "fixed" else "vmpt"
    settings = OptimizationSettings(steps=3, method=method, tolerance=0.0, step=step, tau=tau)
    fields = []
    result = optimize(mesh, problem, settings, callback=lambda _, loop: fields.append(loop.phi))
    assert len(fields) == 4
    z = mesh.points[:, 2]
    hole = np.linalg.norm(mesh.points - HOLE.region.center, axis=1) <= HOLE.region.radius
    mass = tet_geometry(mesh).lumped_mass
    for phi in fields:
        assert np.all(phi[z >= 0.035] == 1.0)
        assert np.all(phi[hole] == 0.0)
        assert mass @ phi == pytest.approx(0.4 * mass.sum(), rel=1e-12)
    free = optimize(mesh, replace(problem, passive=()), settings)
    assert not np.all(free.phase_field.values[z >= 0.035] > 0.99)
    assert result.history[-1].objective_J > 0.0


def test_a_run_with_passive_regions_ends_stationary():
    """The KKT residual counts the free nodes only, so it falls as without such regions."""
    mesh, problem = passive_cantilever(DECK, HOLE, cells=(6, 2, 4))
    settings = OptimizationSettings(steps=300, tolerance=1e-5, stagnation=0.0)
    result = optimize(mesh, problem, settings)
    assert result.outcome == "tolerance"
    assert result.kkt.sign < 1e-5


def test_solid_wins_on_a_shared_face():
    below = Passive("below", Box((-INF,) * 3, (INF, INF, 0.035)), solid=False)
    mesh, problem = passive_cantilever(DECK, below, cells=(6, 2, 8))
    lower, upper = passive_bounds(mesh, problem)
    z = mesh.points[:, 2]
    np.testing.assert_array_equal(lower, z >= 0.035)
    np.testing.assert_array_equal(upper, z >= 0.035)
    assert (z == 0.035).any()


@pytest.mark.parametrize(
    ("regions", "fraction", "sentence"),
    [
        (
            (DECK,),
            0.1,
            "volume_fraction is 0.1, but the passive solid regions alone take at least 0.1",
        ),
        (
            (Passive("most", Box((-INF,) * 3, (INF, INF, 0.03)), False),),
            0.4,
            "the passive void regions leave at most 0.2",
        ),
        ((DECK, DECK), 0.4, "'deck' is given twice"),
        (
            (Passive("far", Sphere((1, 0, 0), 0.1), True),),
            0.4,
            "'far' holds no node of the mesh: it is the sphere around",
        ),
    ],
)
def test_regions_that_cannot_be(regions, fraction, sentence):
    mesh, problem = passive_cantilever(*regions, volume_fraction=fraction)
    with pytest.raises(InvalidCase, match=sentence) as caught:
        prepare(mesh, problem, OptimizationSettings())
    assert str(caught.value).endswith(".")
