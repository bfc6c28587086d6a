"""Supports, loads, symmetry planes and named sets on meshes; every refusal is one sentence."""

from dataclasses import replace

import numpy as np
import pytest

from meshes import InvalidCase, SymmetryPlane
from meshes.structured import bcc_box
from tests import shapes
from tests.topopt.problems import bridge, table, tower
from topopt.boundary import attach_sets, boundary_conditions, check_problem
from topopt.problem import Box, Load, Support, SurfaceDomain

INF = np.inf


def box_mesh(problem, cells=(13, 4, 5)):
    return bcc_box(problem.domain.lower, problem.domain.upper, cells)


def sentence(call, *arguments):
    """The message of the InvalidCase that a call raises."""
    with pytest.raises(InvalidCase) as caught:
        call(*arguments)
    message = str(caught.value)
    assert message.endswith(".") and "\n" not in message
    return message


def refusal(problem, early):
    """What is said of a problem, before it is meshed or on a mesh."""
    if early:
        return sentence(check_problem, problem)
    return sentence(boundary_conditions, box_mesh(problem), problem)


@pytest.mark.parametrize(
    "problem, force",
    [(bridge(), (0, 0, -0.24)), (table(), (0, 0, -0.96)), (tower(), (-0.96, 0, 0))],
)
def test_the_three_cases_carry_their_force_and_are_held(problem, force):
    mesh = box_mesh(problem)
    conditions = boundary_conditions(mesh, problem)
    np.testing.assert_allclose(conditions.forces.sum(axis=0), force, rtol=1e-13, atol=1e-18)
    for plane in problem.symmetry:
        held = conditions.fixed[:, plane.axis]
        assert np.all(held[mesh.points[:, plane.axis] == 0.0])
    check_problem(problem)


def test_the_bridge_holds_exactly_its_ends_and_its_symmetry_planes():
    problem = bridge()
    mesh = box_mesh(problem)
    x, y, z = mesh.points.T
    ends = (z == 0) & (x >= 0.045)
    wanted = np.stack([ends | (x == 0), ends | (y == 0), ends], axis=1)
    conditions = boundary_conditions(mesh, problem)
    np.testing.assert_array_equal(conditions.fixed, wanted)
    assert set(conditions.load_forces) == {"deck"}
    np.testing.assert_array_equal(conditions.load_forces["deck"], conditions.forces)
    assert not conditions.forces.flags.writeable and not conditions.fixed.flags.writeable


def test_sets_name_facets_by_overlap_and_nodes_by_place():
    problem = bridge()
    mesh = attach_sets(box_mesh(problem), problem)
    assert set(mesh.facet_sets) == {"symmetry:x=0", "symmetry:y=0", "load:deck", "support:ends"}
    assert mesh.symmetry == problem.symmetry
    corners = mesh.points[mesh.facets]
    deck = np.zeros(len(mesh.facets), bool)
    deck[mesh.facet_sets["load:deck"]] = True
    low = corners.min(axis=1)
    wanted = (low[:, 2] == 0.02) & (low[:, 0] < 0.01 - 1e-12) & (low[:, 1] < 0.01 - 1e-12)
    assert np.all(wanted[deck])  # overlapping facets have a corner below both bounds
    inside = wanted & (corners[:, :, :2].max(axis=(1, 2)) <= 0.01 + 1e-12)
    assert inside.any() and np.all(deck[inside])
    assert deck.sum() > inside.sum()  # partly covered ones belong to it
    ends = mesh.points[mesh.node_sets["support:ends"]]
    assert np.all(ends[:, 2] == 0) and np.all(ends[:, 0] >= 0.045)
    y_zero = mesh.facet_sets["symmetry:y=0"]
    assert np.all(corners[y_zero][:, :, 1] == 0) and len(y_zero) == 2 * (13 * 5) * 2


def test_facets_on_symmetry_planes_carry_no_load_and_hold_no_support():
    problem = bridge()
    thick = replace(
        problem,
        loads=(Load("deck", Box((-1, -1, 0.016), (0.01, 0.01, 1)), (0, 0, -1.0)),),
        supports=(Support("low", Box((-1, -1, -1), (1, 1, 0.004))),),
    )
    mesh = box_mesh(problem)
    conditions = boundary_conditions(mesh, thick)
    np.testing.assert_allclose(conditions.forces[:, 2].sum(), -1e-4, rtol=1e-13)  # the top alone
    x, y, z = mesh.points.T
    inner = (y == 0) & (x > 0) & (x < 0.05) & (z > 0) & (z <= 0.004)
    assert inner.any()
    assert not conditions.fixed[inner][:, [0, 2]].any() and conditions.fixed[inner, 1].all()
    found = attach_sets(mesh, thick).facet_sets
    assert not set(found["load:deck"]) & set(found["symmetry:y=0"])


def test_several_loads_are_kept_apart_and_summed():
    problem = bridge()
    side = Load("side", Box((0, 0.015, 0), (INF, 0.015, INF)), (0, -3.0, 1.0))
    conditions = boundary_conditions(
        box_mesh(problem), replace(problem, loads=(*problem.loads, side))
    )
    np.testing.assert_allclose(
        conditions.load_forces["side"].sum(axis=0), np.array([0, -3, 1]) * 0.05 * 0.02, rtol=1e-13
    )
    total = conditions.load_forces["side"] + conditions.load_forces["deck"]
    np.testing.assert_array_equal(conditions.forces, total)


def test_no_load_at_all_gives_zero_forces():
    problem = replace(bridge(), loads=())
    assert not boundary_conditions(box_mesh(problem), problem).forces.any()


def test_force_on_held_degrees_of_freedom_is_reported_and_all_of_it_refused():
    problem = bridge()
    foot = Load("foot", Box((0.04, 0, 0), (0.05, 0.015, 0)), (0, 0, -5.0))
    words = []
    mesh = box_mesh(problem, (10, 3, 4))
    conditions = boundary_conditions(
        mesh, replace(problem, loads=(*problem.loads, foot)), words.append
    )
    held = np.abs(conditions.load_forces["foot"][conditions.fixed]).sum() / (5 * 0.01 * 0.015)
    assert 0.3 < held < 0.9
    assert words == [
        f"load 'foot': {100 * held:.3g} % of it acts on held degrees of freedom and goes straight "
        "into the supports."
    ]
    idle = replace(problem, loads=(Load("foot", Box((0.0475, 0, 0), (0.05, 0.01, 0)), (0, 0, 1)),))
    assert "held degrees of freedom only" in sentence(boundary_conditions, mesh, idle)
    boundary_conditions(mesh, replace(idle, gravity=(0, 0, -9.81)))  # its weight does work


@pytest.mark.parametrize("early", [True, False])
def test_bad_loads_are_refused(early):
    def refused(*loads):
        problem = replace(bridge(), loads=loads)
        call = (
            (check_problem, problem) if early else (boundary_conditions, box_mesh(problem), problem)
        )
        return sentence(*call)

    deck = bridge().loads[0]
    away = replace(deck, region=Box((0, 0, 0.021), (0.01, 0.01, 0.03)))
    assert "load 'deck' touches no boundary facet" in refused(away)
    assert "[0, 0.02] m" in refused(away)
    inside = replace(deck, region=Box((0.01, 0.003, 0.003), (0.02, 0.01, 0.01)))
    assert "touches no boundary facet" in refused(inside)
    edge = replace(deck, region=Box((0, 0.015, 0.02), (1, 0.015, 0.02)))
    assert "touches no boundary facet" in refused(edge)
    on_symmetry = replace(deck, region=Box((0, -1, -1), (0, 1, 1)))
    assert "symmetry planes do not count" in refused(on_symmetry)
    assert "traction (0, 0, 0) Pa" in refused(replace(deck, traction=(0, 0, 0)))
    assert "finite" in refused(replace(deck, traction=(0, np.nan, 0)))
    assert "load 'deck' is given twice" in refused(deck, deck)


@pytest.mark.parametrize("early", [True, False])
def test_bad_supports_and_symmetry_planes_are_refused(early):
    def refused(**changes):
        problem = replace(bridge(), **changes)
        call = (
            (check_problem, problem) if early else (boundary_conditions, box_mesh(problem), problem)
        )
        return sentence(*call)

    ends = bridge().supports[0]
    away = replace(ends, region=Box((0.06, 0, 0), (0.07, 1, 0)))
    assert "support 'ends'" in refused(supports=(away,))
    assert "[0.06, 0.07]" in refused(supports=(away,))
    assert "holds no direction" in refused(supports=(replace(ends, fixed=()),))
    assert "support 'ends' is given twice" in refused(supports=(ends, ends))
    middle = refused(symmetry=(SymmetryPlane(0, 0.02),))
    assert "symmetry plane x=0.02 cuts through the domain" in middle and "[0, 0.05] m" in middle
    assert "touches no flat face" in refused(symmetry=(SymmetryPlane(1, -0.001),))


def test_a_support_between_the_nodes_asks_for_a_finer_mesh():
    tiny = Support("pin", Box((0.0301, 0.0061, 0), (0.0309, 0.0069, 0)))
    problem = replace(bridge(), supports=(*bridge().supports, tiny))
    check_problem(problem)
    message = sentence(boundary_conditions, box_mesh(problem), problem)
    assert "support 'pin' holds no node" in message and "refine the mesh" in message
    fine = bcc_box(problem.domain.lower, problem.domain.upper, (100, 30, 4))
    assert len(attach_sets(fine, problem).node_sets["support:pin"]) > 0


def test_a_knife_edge_holds_nodes_but_no_facet():
    edge = Support("edge", Box((0.05, -INF, 0), (0.05, INF, 0)))
    problem = replace(bridge(), supports=(edge,))
    check_problem(problem)
    mesh = attach_sets(box_mesh(problem), problem)
    assert len(mesh.node_sets["support:edge"]) == 5
    assert len(mesh.facet_sets["support:edge"]) == 0


def test_a_surface_domain_is_checked_early_too():
    cube = SurfaceDomain(shapes.cube(2.0))
    problem = replace(
        bridge(),
        domain=cube,
        supports=(Support("floor", Box((-INF, -INF, 0), (INF, INF, 0))),),
        loads=(Load("lid", Box((0.5, 0.5, 2), (1, 1, 2)), (0, 0, -1.0)),),
        symmetry=(SymmetryPlane(0), SymmetryPlane(1, 2.0)),
    )
    check_problem(problem)
    lid = replace(problem.loads[0], region=Box((0, 0, 2.1), (1, 1, 3)))
    assert "load 'lid'" in sentence(check_problem, replace(problem, loads=(lid,)))


@pytest.mark.parametrize("scale", [2.0**30, 2.0**-30, 1e-9, 1e9])
def test_conditions_do_not_depend_on_the_unit_of_length(scale):
    small, large = bridge(), bridge(scale)
    one = boundary_conditions(box_mesh(small), small)
    other = boundary_conditions(box_mesh(large), large)
    np.testing.assert_array_equal(one.fixed, other.fixed)
    np.testing.assert_allclose(
        other.forces, one.forces * scale**2, rtol=1e-9, atol=1e-13 * scale**2
    )
