"""The state problem against closed forms, convergence orders, scikit-fem, and identities."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from skfem import LinearForm

from meshes.structured import bcc_box
from tests.topopt import reference_elasticity as twin
from topopt.elasticity import ElasticModel, von_mises
from topopt.geometry import mass_product, tet_geometry
from topopt.interpolation import stiffness_factor
from topopt.problem import Material
from topopt.weak_form import vector_basis

E, NU = 1.85e9, 0.35
LAME = {"lame_lambda": E * NU / ((1 + NU) * (1 - 2 * NU)), "lame_mu": E / (2 * (1 + NU))}


def held_at_corners(mesh):
    """The 3-2-1 support of a box: no rigid motion is left, and no stretching is hindered."""
    lower, upper = mesh.points.min(axis=0), mesh.points.max(axis=0)
    fixed = np.zeros(mesh.points.shape, bool)
    for axis, held in ((None, (0, 1, 2)), (0, (1, 2)), (1, (2,))):
        corner = lower.copy()
        if axis is not None:
            corner[axis] = upper[axis]
        fixed[np.flatnonzero((mesh.points == corner).all(axis=1))[0], list(held)] = True
    return fixed


@pytest.mark.parametrize("solver", ["direct", "pyamg", "multigrid"])
def test_patch_test_linear_displacement_is_reproduced(solver):
    mesh = twin.perturbed_box((0, 0, 0), (0.05, 0.015, 0.02), (8, 3, 4))
    material = Material(**LAME)
    # u = H x with H upper triangular vanishes where the 3-2-1 support holds it.
    gradient = 1e-3 * np.array([[2.0, -3.0, 1.0], [0.0, -1.0, 4.0], [0.0, 0.0, 1.5]])
    exact = mesh.points @ gradient.T
    stress = twin.stress_tensor((gradient + gradient.T) / 2, material)
    conditions = twin.conditions(held_at_corners(mesh), twin.traction_forces(mesh, stress))
    model = ElasticModel(mesh, twin.make_problem(**LAME), conditions, solver)
    state = model.solve(np.ones(len(mesh.points)), tolerance=1e-11)
    assert_allclose(state.displacement, exact, rtol=0, atol=1e-8 * np.abs(exact).max())
    energy = 0.015 * 0.05 * 0.02 * np.sum(stress * gradient)
    assert state.compliance == pytest.approx(energy, rel=1e-12)


def test_uniaxial_bar():
    length, side, pull = 0.1, 0.02, 3e5
    mesh = bcc_box((0, 0, 0), (length, side, side), (10, 2, 2))
    p = mesh.points
    fixed = p == 0.0  # symmetry planes at x = 0, y = 0 and z = 0
    forces = twin.traction_forces(mesh, np.diag([pull, 0.0, 0.0]))
    conditions = twin.conditions(fixed, np.where(p[:, :1] > 0.0, forces, 0.0))
    model = ElasticModel(mesh, twin.make_problem(**LAME), conditions)
    phi = np.ones(len(p))
    state = model.solve(phi, tolerance=1e-11)
    strain = pull / E
    exact = p * [strain, -NU * strain, -NU * strain]
    assert_allclose(state.displacement, exact, rtol=0, atol=1e-9 * strain * length)
    assert state.compliance == pytest.approx(pull * side**2 * strain * length, rel=1e-10)
    assert_allclose(state.energy_density, pull * strain, rtol=1e-8)
    assert_allclose(von_mises(model, state, phi), pull, rtol=1e-8)


# --- manufactured solution -------------------------------------------------------------------

AMPLITUDE = np.array([1.0, 0.5, -0.3])


def bubble(x):
    """s = sin pi x sin pi y sin pi z, its gradient (.., 3), and its second derivatives."""
    sine, cosine = np.sin(np.pi * x), np.cos(np.pi * x)
    value = sine.prod(axis=-1)
    gradient = np.empty_like(x)
    hessian = np.empty((*x.shape, 3))
    for i in range(3):
        factors = [cosine[..., k] if k == i else sine[..., k] for k in range(3)]
        gradient[..., i] = np.pi * np.prod(factors, axis=0)
        for j in range(3):
            if i == j:
                hessian[..., i, i] = -(np.pi**2) * value
            else:
                k = 3 - i - j
                hessian[..., i, j] = np.pi**2 * cosine[..., i] * cosine[..., j] * sine[..., k]
    return value, gradient, hessian


def manufactured_errors(cells):
    """H1-seminorm and L2 errors for u = AMPLITUDE s on the unit cube, clamped all around."""
    mesh = twin.perturbed_box((0, 0, 0), (1, 1, 1), (cells,) * 3, amount=0.1)
    geometry = tet_geometry(mesh)
    # f = -div sigma(u) = -(lambda + mu) grad div u - mu Lap u
    _, _, hessian = bubble(mesh.points)
    lame_lambda, lame_mu = LAME["lame_lambda"], LAME["lame_mu"]
    body = -(lame_lambda + lame_mu) * hessian @ AMPLITUDE
    body -= lame_mu * np.outer(np.trace(hessian, axis1=1, axis2=2), AMPLITUDE)
    forces = [mass_product(mesh.tets, geometry.volumes, component) for component in body.T]
    fixed = np.zeros(mesh.points.shape, bool)
    fixed[np.unique(mesh.facets)] = True
    conditions = twin.conditions(fixed, np.stack(forces, axis=1))
    model = ElasticModel(mesh, twin.make_problem(**LAME), conditions)
    state = model.solve(np.ones(len(mesh.points)), tolerance=1e-9)
    return error_norms(mesh, geometry, state.displacement)


def error_norms(mesh, geometry, displacement):
    corners = displacement[mesh.tets]
    found_gradient = np.einsum("eai,eaj->eij", corners, geometry.gradients)
    square_h1 = square_l2 = 0.0
    weights = np.full((4, 4), 0.1381966011250105) + np.eye(4) * (1 - 4 * 0.1381966011250105)
    for shape in weights:  # the four-point rule of degree 2
        value, gradient, _ = bubble(np.einsum("a,eai->ei", shape, mesh.points[mesh.tets]))
        off = np.einsum("a,eai->ei", shape, corners) - value[:, None] * AMPLITUDE
        off_gradient = found_gradient - AMPLITUDE[:, None] * gradient[:, None, :]
        square_l2 += geometry.volumes @ np.sum(off**2, axis=1) / 4
        square_h1 += geometry.volumes @ np.sum(off_gradient**2, axis=(1, 2)) / 4
    return np.sqrt(square_h1), np.sqrt(square_l2)


def test_manufactured_solution_converges_with_orders_one_and_two():
    cells = np.array([6, 9, 13])
    errors = np.array([manufactured_errors(n) for n in cells])
    h1, l2 = (-np.polyfit(np.log(cells), np.log(error), 1)[0] for error in errors.T)
    assert h1 == pytest.approx(1.0, abs=0.15)
    assert l2 == pytest.approx(2.0, abs=0.15)


# --- gravity ---------------------------------------------------------------------------------


def hanging_bar(cells, phi=1.0, void_ratio=1e-4):
    """A bar 0.1 m long without lateral contraction, hung up at its top: state and closed form."""
    length, side, density, g = 0.1, 0.02, 1240.0, 9.81
    material = {"lame_lambda": 0.0, "lame_mu": E / 2, "void_ratio": void_ratio}
    problem = twin.make_problem(gravity=(0, 0, -g), density=density, **material)
    mesh = bcc_box((0, 0, 0), (side, side, length), cells)
    fixed = np.zeros(mesh.points.shape, bool)
    fixed[mesh.points[:, 2] == length] = True
    conditions = twin.conditions(fixed, np.zeros(mesh.points.shape))
    state = ElasticModel(mesh, problem, conditions).solve(
        np.full(len(mesh.points), phi), tolerance=1e-10
    )
    return state.compliance, side**2 * (density * g) ** 2 * length**3 / (3 * E)


def test_hanging_bar_converges_to_the_closed_form():
    layers = np.array([4, 8, 16])
    lack = []
    for n in layers:
        compliance, exact = hanging_bar((max(1, n // 4), max(1, n // 4), n))
        lack.append(1.0 - compliance / exact)
    assert min(lack) > 0.0  # a conforming method is too stiff
    assert lack[-1] < 5e-3
    assert -np.polyfit(np.log(layers), np.log(lack), 1)[0] == pytest.approx(2.0, abs=0.15)


def test_weight_and_stiffness_follow_phi():
    full, _ = hanging_bar((2, 2, 8))
    half, _ = hanging_bar((2, 2, 8), phi=0.5, void_ratio=1e-2)
    assert half == pytest.approx(full * 0.5**2 / (1e-2 + 0.99 * 0.5**3), rel=1e-9)


def test_body_force_is_scikit_fems_integral():
    mesh = twin.perturbed_box((0, 0, 0), (1, 2, 1), (2, 3, 2))
    problem = twin.make_problem(gravity=(1.0, -2.0, -9.81), density=1000.0)
    nothing = np.zeros(mesh.points.shape)
    model = ElasticModel(mesh, problem, twin.conditions(nothing.astype(bool), nothing), "pyamg")
    phi = np.random.default_rng(0).random(len(mesh.points))

    @LinearForm
    def weight(v, w):
        return 1000.0 * w.phi * (1.0 * v[0] - 2.0 * v[1] - 9.81 * v[2])

    basis = vector_basis(mesh)
    basis = type(basis)(basis.mesh, basis.elem, intorder=2)
    scalar = basis.with_element(type(basis.elem.elem)())
    expected = weight.assemble(basis, phi=scalar.interpolate(phi))[basis.nodal_dofs].T
    assert_allclose(model.body_force(phi), expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    displacement = np.random.default_rng(1).standard_normal(mesh.points.shape)
    work = np.vdot(model.body_force(phi), displacement)
    assert model.body_force_work(displacement) @ phi == pytest.approx(work, rel=1e-12)


# --- a bridge --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bridge():
    mesh = bcc_box(twin.LOWER, twin.UPPER, (15, 5, 6))
    return mesh, twin.bridge_conditions(mesh), twin.arch(mesh.points)


@pytest.fixture(scope="module")
def bridge_states(bridge):
    mesh, conditions, phi = bridge
    problem = twin.make_problem(gravity=(0.0, 0.0, -9.81))
    models = {s: ElasticModel(mesh, problem, conditions, s) for s in ("direct", "multigrid")}
    states = {s: model.solve(phi, tolerance=1e-9) for s, model in models.items()}
    return models, states


def test_multigrid_and_scikit_fem_with_a_direct_solver_agree(bridge_states):
    _, states = bridge_states
    exact, found = states["direct"], states["multigrid"]
    assert (exact.solver, found.solver) == ("direct", "multigrid")
    assert found.compliance == pytest.approx(exact.compliance, rel=1e-12)
    size = np.abs(exact.displacement).max()
    assert_allclose(found.displacement, exact.displacement, rtol=0, atol=1e-6 * size)
    assert found.residual <= 1e-9


def test_compliance_is_the_elastic_energy(bridge, bridge_states):
    mesh, _, phi = bridge
    models, states = bridge_states
    factor = stiffness_factor(phi, mesh.tets, 1e-4)
    for name, state in states.items():
        energy = np.sum(factor * models[name].volumes * state.energy_density)
        assert energy == pytest.approx(state.compliance, rel=1e-10)


def test_energy_density_and_von_mises_against_their_twins(bridge, bridge_states):
    mesh, _, phi = bridge
    models, states = bridge_states
    u = states["direct"].displacement
    expected = twin.energy_density(mesh, u, Material())
    assert_allclose(models["direct"].energy_density(u), expected, rtol=1e-10)
    factor = stiffness_factor(phi, mesh.tets, 1e-4)
    expected = twin.von_mises(mesh, u, Material(), factor)
    found = von_mises(models["direct"], states["direct"], phi)
    assert_allclose(found, expected, rtol=1e-8, atol=1e-9 * expected.max())


def test_forces_of_stresses_are_products_with_the_stiffness_matrix():
    mesh = twin.perturbed_box((0, 0, 0), (2, 1, 1), (2, 1, 1))
    free = twin.conditions(np.zeros(mesh.points.shape, bool), np.zeros(mesh.points.shape))
    model = ElasticModel(mesh, twin.make_problem(), free, "direct")
    rng = np.random.default_rng(8)
    u, v, factor = *rng.normal(size=(2, *mesh.points.shape)), rng.random(len(mesh.tets))
    matrix = twin.stiffness(mesh, model.material, factor, free.fixed)
    forces = model.internal_forces(u, factor)
    assert_allclose(forces.ravel(), matrix @ u.ravel(), atol=1e-12 * np.abs(forces).max())
    mixed = (factor * model.volumes) @ (model.energy_density(u + v) - model.energy_density(u - v))
    assert 0.25 * mixed == pytest.approx(np.vdot(v, forces), rel=1e-12)


def test_fixed_degrees_of_freedom_stay_at_zero(bridge, bridge_states):
    _, conditions, _ = bridge
    for state in bridge_states[1].values():
        assert not state.displacement[conditions.fixed].any()


def test_compliance_of_a_loose_solve_is_second_order_and_its_error_known(bridge, bridge_states):
    _, _, phi = bridge
    models, states = bridge_states
    exact = states["direct"].compliance
    loose = models["multigrid"].solve(phi, tolerance=3e-3)
    assert 1e-12 * exact < abs(loose.compliance - exact) < 1e-4 * exact
    assert loose.compliance_error == pytest.approx(exact - loose.compliance, rel=0.5)


def test_a_warm_start_needs_fewer_iterations(bridge, bridge_states):
    _, _, phi = bridge
    models, states = bridge_states
    start = states["multigrid"].displacement
    moved = np.clip(phi * 1.01, 0.0, 1.0)
    cold = models["multigrid"].solve(moved, tolerance=1e-5)
    warm = models["multigrid"].solve(moved, start=start, tolerance=1e-5)
    assert warm.iterations < cold.iterations
    assert warm.compliance == pytest.approx(cold.compliance, rel=1e-8)


def test_near_designs_are_solved_as_exactly_with_the_hierarchy_at_hand(bridge):
    mesh, conditions, phi = bridge
    near, anew = (ElasticModel(mesh, twin.make_problem(), conditions, "multigrid") for _ in "ab")
    near.solve(phi, tolerance=1e-3)
    other = np.clip(phi + 0.01 * np.random.default_rng(3).standard_normal(len(phi)), 0.0, 1.0)
    found, expected = (
        near.solve(other, tolerance=1e-9, near=True),
        anew.solve(other, tolerance=1e-9),
    )
    assert found.residual <= 1e-9 and found.iterations >= expected.iterations
    assert found.compliance == pytest.approx(expected.compliance, rel=1e-12)
    assert_array_equal(  # the hierarchy of another design is not kept for longer than asked
        near.solve(other, tolerance=1e-9).displacement, expected.displacement
    )


def test_responses_are_those_of_the_state_handed_in(bridge):
    """Stresses are kept between responses to one state, and not for another."""
    mesh, conditions, phi = bridge
    kept, anew = (ElasticModel(mesh, twin.make_problem(), conditions, "multigrid") for _ in "ab")
    direction = np.random.default_rng(4).standard_normal(len(phi))
    first, second = (kept.solve(p, tolerance=1e-8) for p in (phi, 0.1 + 0.8 * phi))
    kept.response(phi, first, direction)
    after = kept.response(0.1 + 0.8 * phi, second, direction, tolerance=1e-8)
    alone = anew.response(0.1 + 0.8 * phi, second, direction, tolerance=1e-8)
    assert_array_equal(after.energy_density, alone.energy_density)


def test_compliance_of_a_loose_warm_start_is_second_order(bridge, bridge_states):
    """f.u of a warm start is off by the residual itself; f.u + r.u only by its square."""
    _, _, phi = bridge
    models, states = bridge_states
    model, exact = models["multigrid"], states["direct"].compliance
    other = model.solve(0.05 + 0.9 * phi, tolerance=1e-6)
    loose = model.solve(phi, start=other.displacement, tolerance=3e-2)
    first_order = np.vdot(model.forces(phi), loose.displacement)
    assert abs(loose.compliance - exact) < 0.1 * abs(first_order - exact)
    error = exact - loose.compliance
    assert 0.4 * error < loose.compliance_error < 30.0 * error  # that before the last iteration


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_lengths_times_s_give_compliance_times_s_cubed(bridge, bridge_states, scale):
    _, conditions, phi = bridge
    big = bcc_box(twin.LOWER, scale * np.array(twin.UPPER), (15, 5, 6))
    larger = twin.conditions(conditions.fixed, conditions.forces * scale**2)
    problem = twin.make_problem(gravity=(0.0, 0.0, -9.81 / scale))
    state = ElasticModel(big, problem, larger, "multigrid").solve(phi, tolerance=1e-9)
    expected = bridge_states[1]["direct"].compliance * scale**3
    assert state.compliance == pytest.approx(expected, rel=1e-11)
