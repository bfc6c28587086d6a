"""Several load cases, imposed displacements and springs: closed forms, scikit-fem, gradients."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from meshes import InvalidCase
from meshes.structured import bcc_box
from tests.topopt.small_problems import cantilever
from topopt.boundary import attach_sets, boundary_conditions, check_problem, check_rigid_motions
from topopt.elasticity import ElasticModel, von_mises
from topopt.gradient import compliance_gradient, concavity
from topopt.optimize import OptimizationSettings, optimize, prepare
from topopt.problem import Box, BoxDomain, Load, LoadCase, Material, Problem, Support

INF = np.inf
E, NU = 1.85e9, 0.35
LAME = {"lame_lambda": E * NU / ((1 + NU) * (1 - 2 * NU)), "lame_mu": E / (2 * (1 + NU))}
SIZE = (0.06, 0.02, 0.04)
RIGHT = Box((0.06, -INF, -INF), (0.06, INF, INF))
UNDER = Box((0.0, -INF, 0.0), (0.025, INF, 0.0))  # its edge runs through facets


def two_cases(**changes):
    """A cantilever with two loads, gravity in one case only, and different weights."""
    mesh, problem = cantilever((3, 1, 2), gravity=(3e3, -2e3, -5e4))
    side = Load("side", RIGHT, (3e3, 0.0, 9e3))
    cases = (LoadCase("down", ("tip",), 2.0), LoadCase("up", ("side",), 0.5, gravity=False))
    return mesh, replace(problem, loads=(*problem.loads, side), load_cases=cases, **changes)


def with_springs():
    mesh, problem = two_cases()
    spring = Support("bed", UNDER, (0, 2), stiffness=4e9)
    return mesh, replace(problem, supports=(*problem.supports, spring))


def with_displacement():
    """A wall, an end that is lowered and twisted in one case, and a load in both."""
    mesh, problem = two_cases()
    jack = Support("jack", RIGHT, (0, 2), displacement=(2e-5, 0.0, -6e-5))
    loads = (replace(problem.loads[0], region=Box((0.02, -INF, 0.04), (0.04, INF, 0.04))),)
    cases = (LoadCase("both", ("tip",), 2.0, displacements=("jack",)), LoadCase("load", ("tip",)))
    return mesh, replace(problem, loads=loads, supports=(*problem.supports, jack), load_cases=cases)


PROBLEMS = {"cases": two_cases, "springs": with_springs, "displacement": with_displacement}


def model_of(mesh, problem, solver="direct"):
    return ElasticModel(mesh, problem, boundary_conditions(mesh, problem), solver)


def random_field(mesh, seed=2, low=0.3, high=0.7):
    return np.random.default_rng(seed).uniform(low, high, len(mesh.points))


@pytest.fixture(scope="module", params=sorted(PROBLEMS))
def weighted(request):
    mesh, problem = PROBLEMS[request.param]()
    return mesh, problem, model_of(mesh, problem)


def test_taylor_remainder_is_of_second_order(weighted):
    mesh, _, model = weighted
    phi, direction = random_field(mesh), np.random.default_rng(3).normal(size=len(mesh.points))
    state = model.solve(phi, None, 1e-8)
    slope = compliance_gradient(model, phi, state) @ direction
    steps = 1e-3 * 0.5 ** np.arange(5)
    values = [model.solve(phi + t * direction, None, 1e-8).compliance for t in steps]
    remainders = np.abs(np.array(values) - state.compliance - steps * slope)
    assert np.polyfit(np.log(steps), np.log(remainders), 1)[0] == pytest.approx(2.0, abs=0.02)
    assert abs(slope) > 1e-3 * abs(state.compliance)


def test_concavity_is_the_row_sum_of_the_second_derivative(weighted):
    mesh, _, model = weighted
    phi = random_field(mesh)
    state = model.solve(phi, None, 1e-8)
    ahead, behind = (compliance_gradient(model, phi + s * 1e-4, state) for s in (1, -1))
    assert_allclose(concavity(model, phi, state), (behind - ahead) / 2e-4, rtol=1e-6)


def test_each_case_is_the_problem_by_itself(weighted):
    mesh, problem, model = weighted
    phi = random_field(mesh)
    together = model.solve(phi, None, 1e-8)
    total, density = 0.0, 0.0
    for k, case in enumerate(problem.load_cases):
        gravity = problem.gravity if case.gravity else (0.0, 0.0, 0.0)
        supports = tuple(
            s if s.name in case.displacements else replace(s, displacement=(0.0, 0.0, 0.0))
            for s in problem.supports
        )
        loads = tuple(load for load in problem.loads if load.name in case.loads)
        alone = model_of(
            mesh,
            replace(problem, loads=loads, supports=supports, gravity=gravity, load_cases=()),
        ).solve(phi, None, 1e-8)
        assert_allclose(together.displacements[k], alone.displacement, atol=1e-12, rtol=1e-9)
        assert together.compliances[k] == pytest.approx(alone.compliance, rel=1e-9)
        total += case.weight * alone.compliance
        density = density + case.weight * alone.energy_density
    assert together.compliance == pytest.approx(total, rel=1e-9)
    assert_allclose(together.energy_density, density, rtol=1e-8, atol=1e-9 * density.max())


@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_every_solver_gives_the_same(name):
    mesh, problem = PROBLEMS[name]()
    phi = random_field(mesh)
    exact = model_of(mesh, problem).solve(phi, None, 1e-8)
    for solver in ("multigrid", "pyamg"):
        model = model_of(mesh, problem, solver)
        found = model.solve(phi, None, 1e-9)
        size = np.abs(exact.displacements).max()
        assert_allclose(found.displacements, exact.displacements, atol=1e-6 * size)
        assert found.compliance == pytest.approx(exact.compliance, rel=1e-9)
        warm = model.solve(phi, found.displacements, 1e-5)
        assert warm.iterations <= 2


@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_a_loose_solution_errs_in_second_order_and_the_estimate_tells(name):
    mesh, problem = PROBLEMS[name]()
    mesh = bcc_box((0, 0, 0), SIZE, (6, 2, 4))
    phi = random_field(mesh)
    exact = model_of(mesh, problem).solve(phi, None, 1e-8)
    loose = model_of(mesh, problem, "multigrid").solve(phi, None, 1e-2)
    error = exact.compliance - loose.compliance
    assert -1e-9 * abs(exact.compliance) < error < 1e-3 * abs(exact.compliance)
    assert error == pytest.approx(loose.compliance_error, rel=2.0)


def test_cases_run_to_a_design_that_serves_both():
    mesh, problem = cantilever((6, 2, 4))
    up = Load("up", Box((0.06, 0.0, 0.03), (0.06, 0.02, 0.04)), (0.0, 0.0, 30000.0))
    cases = (LoadCase("down", ("tip",)), LoadCase("up", ("up",)))
    both = replace(problem, loads=(*problem.loads, up), load_cases=cases)
    settings = OptimizationSettings(steps=8, solver="direct", tolerance=0.0)
    result = optimize(mesh, both, settings)
    values = [row.objective_J for row in result.history]
    assert all(after <= before for before, after in pairwise(values))
    single = optimize(mesh, problem, settings)
    model = model_of(mesh, both)
    worst_of_both = model.solve(result.phase_field.values, None, 1e-8).compliance
    assert worst_of_both < model.solve(single.phase_field.values, None, 1e-8).compliance


# --- imposed displacements --------------------------------------------------------------------


def bar(**changes):
    """A box between two ends that slide on their planes, free to contract: a uniaxial bar."""
    mesh = bcc_box((0, 0, 0), SIZE, (3, 1, 2))
    ends = (
        Support("left", Box((0, -INF, -INF), (0, INF, INF)), (0,)),
        Support("right", RIGHT, (0,), displacement=(1e-4, 0.0, 0.0)),
        Support("front", Box((-INF, 0, -INF), (INF, 0, INF)), (1,)),
        Support("floor", Box((-INF, -INF, 0), (INF, INF, 0)), (2,)),
    )
    problem = Problem(BoxDomain((0, 0, 0), SIZE), ends, (), 0.5, material=Material(**LAME))
    return mesh, replace(problem, **changes)


@pytest.mark.parametrize("solver", ["direct", "multigrid"])
def test_a_stretched_bar_pulls_with_its_closed_form(solver):
    mesh, problem = bar()
    model = model_of(mesh, problem, solver)
    phi = np.ones(len(mesh.points))
    state = model.solve(phi, None, 1e-8)
    force = E * SIZE[1] * SIZE[2] * 1e-4 / SIZE[0]
    assert state.compliance == pytest.approx(-force * 1e-4, rel=1e-7)  # - R.u_D
    reactions = model.reactions(phi, state)
    right = mesh.points[:, 0] == SIZE[0]
    assert_allclose(reactions[right].sum(axis=0), (force, 0, 0), rtol=1e-6, atol=1e-6 * force)
    assert_allclose(reactions.sum(axis=0), 0.0, atol=1e-6 * force)
    strain = np.array([1.0, -NU, -NU]) * 1e-4 / SIZE[0]
    assert_allclose(state.displacement, mesh.points * strain, atol=1e-11)
    assert_allclose(von_mises(model, state, phi), E * strain[0], rtol=1e-6)


def test_displacement_alone_is_stiffened():
    """- R.u_D falls: the part resists more."""
    mesh, problem = cantilever((6, 2, 4), loads=())
    tip = Box((0.06, -INF, 0.0), (0.06, INF, 0.01))
    jack = Support("jack", tip, (2,), displacement=(0.0, 0.0, -1e-4))
    problem = replace(problem, supports=(*problem.supports, jack), gamma=None)
    settings = OptimizationSettings(steps=6, solver="direct", tolerance=0.0)
    result = optimize(mesh, problem, settings)
    values = [row.compliance_J for row in result.history]
    objectives = [row.objective_J for row in result.history]
    assert result.gamma > 0.0
    assert values[-1] < 2.0 * values[0] < 0.0
    assert all(after <= before for before, after in pairwise(objectives))


def test_each_case_imposes_its_own_displacements_and_holds_the_others():
    mesh, problem = bar()
    left, right = (replace(s, displacement=(1e-4, 0, 0)) for s in problem.supports[:2])
    cases = (LoadCase("a", displacements=("left",)), LoadCase("b", displacements=("right",)))
    problem = replace(problem, supports=(left, right, *problem.supports[2:]), load_cases=cases)
    first, second = (case.displacement[:, 0] for case in boundary_conditions(mesh, problem).cases)
    x = mesh.points[:, 0]
    np.testing.assert_array_equal(first, np.where(x == 0.0, 1e-4, 0.0))
    np.testing.assert_array_equal(second, np.where(x == SIZE[0], 1e-4, 0.0))


def test_contradicting_displacements_are_refused():
    mesh, problem = bar()
    corner = Support("corner", Box((0.06, -INF, 0), (0.06, INF, 0)), (0, 2))
    with pytest.raises(InvalidCase, match="support 'corner' moves nodes in x"):
        boundary_conditions(mesh, replace(problem, supports=(*problem.supports, corner)))


# --- springs ----------------------------------------------------------------------------------


def test_springs_are_scikit_fems_facet_mass_matrix():
    from skfem import BilinearForm, ElementTetP1, FacetBasis, MeshTet

    mesh = bcc_box((0, 0, 0), SIZE, (6, 2, 4))
    region = Box((0.0, -INF, 0.0), (0.03, INF, 0.0))  # follows the mesh
    _, problem = bar()
    bed = Support("bed", region, (0, 2), stiffness=7e8)
    problem = replace(problem, supports=(*problem.supports[:3], bed))
    springs = boundary_conditions(mesh, problem).springs
    found = np.zeros((len(mesh.points), len(mesh.points), 3))
    found[springs.rows, springs.columns] = springs.blocks

    fem = MeshTet(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.tets.T))
    facets = fem.facets_satisfying(lambda x: (x[2] == 0.0) & (x[0] < 0.03))
    basis = FacetBasis(fem, ElementTetP1(), facets=facets)
    mass = BilinearForm(lambda u, v, _: u * v).assemble(basis).toarray()
    assert_allclose(found[:, :, 0], 7e8 * mass, rtol=1e-12, atol=1e-12 * 7e8 * mass.max())
    assert_allclose(found[:, :, 2], found[:, :, 0])
    assert not found[:, :, 1].any()


def test_springs_on_partly_covered_facets_have_the_area_and_its_moments():
    mesh, problem = with_springs()
    springs = boundary_conditions(mesh, problem).springs
    x = mesh.points[:, 0]
    total = springs.blocks[:, 0].sum()
    second = (springs.blocks[:, 0] * x[springs.rows] * x[springs.columns]).sum()
    assert total == pytest.approx(4e9 * 0.025 * 0.02, rel=1e-12)
    assert second == pytest.approx(4e9 * 0.02 * 0.025**3 / 3, rel=1e-12)


@pytest.mark.parametrize("solver", ["direct", "multigrid"])
def test_a_bar_on_springs_is_as_soft_as_both_in_series(solver):
    mesh, problem = bar()
    bed = Support("left", problem.supports[0].region, (0,), stiffness=5e10)
    pull = Load("pull", RIGHT, (1e5, 0.0, 0.0))
    problem = replace(problem, supports=(bed, *problem.supports[2:]), loads=(pull,))
    conditions = boundary_conditions(mesh, problem)
    check_problem(problem)
    check_rigid_motions(mesh, problem, conditions.fixed, conditions.springs)
    state = ElasticModel(mesh, problem, conditions, solver).solve(np.ones(len(mesh.points)))
    end = 1e5 * (1 / 5e10 + SIZE[0] / E)
    assert_allclose(state.displacement[mesh.points[:, 0] == SIZE[0], 0], end, rtol=1e-5)
    assert state.compliance == pytest.approx(1e5 * SIZE[1] * SIZE[2] * end, rel=1e-6)
    sets = attach_sets(mesh, problem)
    assert np.all(mesh.points[sets.node_sets["support:left"], 0] == 0.0)


def test_springs_in_too_few_directions_leave_motions_free():
    mesh, problem = bar()
    bed = Support("bed", UNDER, (2,), stiffness=1e9)
    problem = replace(problem, supports=(bed,), loads=(Load("pull", RIGHT, (1.0, 0.0, 0.0)),))
    with pytest.raises(InvalidCase, match="support 'bed' leaves 3 rigid motions free"):
        check_problem(problem)
    conditions = boundary_conditions(mesh, problem)
    with pytest.raises(InvalidCase, match="leaves 3 rigid motions free"):
        check_rigid_motions(mesh, problem, conditions.fixed, conditions.springs)


# --- refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"load_cases": (LoadCase("a", ("tip", "hat")),)}, "load case 'a' names 'hat'"),
        ({"load_cases": (LoadCase("a", ("tip",)),)}, "'side' acts in no load case"),
        ({"load_cases": (LoadCase("a", ("tip", "side"), 0.0),)}, "has the weight 0"),
        (
            {"load_cases": (LoadCase("a", ("tip",)), LoadCase("a", ("side",)))},
            "load case 'a' is given twice",
        ),
        (
            {"load_cases": (LoadCase("a", ("tip", "side"), displacements=("wall",)),)},
            "no such support with a displacement; there is none at all",
        ),
    ],
)
def test_bad_load_cases_are_refused_before_meshing(changes, sentence):
    _, problem = two_cases()
    with pytest.raises(InvalidCase, match=sentence):
        check_problem(replace(problem, **changes))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"stiffness": 0.0}, "stiffness 0 N/m"),
        ({"stiffness": np.nan}, "stiffness nan N/m"),
        ({"stiffness": 1e9, "displacement": (1e-3, 0, 0)}, "a stiffness and a displacement"),
        ({"fixed": (1,), "displacement": (1e-3, 0, 0)}, "0 in the directions"),
        ({"displacement": (np.inf, 0, 0)}, "three finite numbers"),
        ({"stiffness": 1e9, "region": Box((0, 0, 0), (0, 0.02, 0))}, "no area to act on"),
    ],
)
def test_bad_supports_are_refused_before_meshing(changes, sentence):
    _, problem = cantilever()
    wall = replace(problem.supports[0], **changes)
    with pytest.raises(InvalidCase, match=sentence):
        check_problem(replace(problem, supports=(wall,)))


def test_a_case_in_which_nothing_acts_is_refused():
    mesh, problem = two_cases(gravity=(0.0, 0.0, 0.0))
    empty = replace(problem, load_cases=(*problem.load_cases, LoadCase("empty")))
    with pytest.raises(InvalidCase, match="load case 'empty': nothing acts in it"):
        prepare(mesh, empty, OptimizationSettings())
