"""The flow as a whole: laws of the interface, monotone decrease, exact volume, repeatable runs."""

import logging
from dataclasses import astuple, replace

import numba
import numpy as np
import pytest

from meshes import InvalidCase, PhaseField
from meshes.structured import bcc_box
from tests.topopt.small_problems import cantilever, unloaded
from tests.topopt.test_ginzburg_landau import sine_profile
from topopt.geometry import tet_geometry
from topopt.history import read_history, write_history
from topopt.optimize import OptimizationSettings, optimize, prepare
from topopt.parameters import measured_interface, warn_if_coarse

ENDLESS = {"tolerance": 0.0, "stagnation": 0.0}
THESIS = {"method": "allen_cahn", "step": "fixed"}


def run(steps=12, start=None, callback=None, cells=(6, 2, 4), scale=1.0, changes=None, **settings):
    """Optimise the small cantilever."""
    mesh, problem = cantilever(cells, scale, **(changes or {}))
    settings = OptimizationSettings(steps=steps, solver="direct", **{**ENDLESS, **settings})
    return optimize(mesh, problem, settings, start, callback)


@pytest.fixture(scope="module")
def finished():
    return run(tau=0.01)


def column(result, name):
    return np.array([getattr(row, name) for row in result.history])


def sphere_octant(radius, size, elements_across):
    """A ball about the origin with eps = 1, in [0, size]^3: (mesh, phi)."""
    cells = round(size * elements_across / 2.2214)
    mesh = bcc_box((0, 0, 0), (size,) * 3, (cells,) * 3)
    return mesh, sine_profile(radius - np.linalg.norm(mesh.points, axis=1), 1.0)


def flow_of_ball(mesh, phi, steps, **settings):
    """The flow without loads, gamma = eps = 1: radius after each step, and the result."""
    mass = tet_geometry(mesh).lumped_mass
    problem = unloaded((1.0, 1.0, 1.0), float(mass @ phi / mass.sum()), eps=1.0)
    settings = OptimizationSettings(steps=steps, **ENDLESS, **settings)
    radii = []

    def remember(row, field):
        radii.append((6.0 / np.pi * (mass @ field.values)) ** (1.0 / 3.0))

    result = optimize(mesh, problem, settings, phi, remember)
    return np.array(radii), result


def test_sphere_shrinks_by_the_law():
    """R^2 = R0^2 - 4 gamma eps n tau / (1 + 2 tau gamma / eps): volume free, no load."""
    mesh, phi = sphere_octant(radius=8.0, size=9.5, elements_across=6)
    tau, steps = 1.0, 10
    radii, _ = flow_of_ball(mesh, phi, steps, tau=tau, **THESIS, volume_constraint=False)
    expected = 4.0 * np.arange(steps + 1) * tau / (1.0 + 2.0 * tau)
    shrunk = radii[0] ** 2 - radii**2
    assert radii[0] == pytest.approx(8.0, rel=0.01)
    np.testing.assert_allclose(np.diff(shrunk), np.diff(expected), rtol=0.03)
    assert shrunk[-1] == pytest.approx(expected[-1], rel=0.03)


def test_sphere_of_given_volume_stands_still():
    mesh, phi = sphere_octant(radius=4.0, size=5.5, elements_across=6)
    radii, result = flow_of_ball(mesh, phi, 20, tau=0.5)
    moved = result.phase_field.values
    np.testing.assert_allclose(radii, radii[0], rtol=1e-12)
    half = np.abs(moved - 0.5) < 0.2
    distance = np.linalg.norm(mesh.points[half], axis=1) - np.interp(
        moved[half], sine_profile(np.linspace(-1.1, 1.1, 99), 1.0), np.linspace(1.1, -1.1, 99)
    )
    assert np.abs(distance - 4.0).max() < 0.1
    assert result.kkt.residual < 1e-3


def test_objective_never_rises_and_compliance_falls(finished):
    objective = column(finished, "objective_J")
    assert len(objective) == 13 and finished.outcome == "steps"
    assert np.all(np.diff(objective) < 0)
    assert objective[-1] < 0.5 * objective[0]
    assert finished.state.compliance < finished.history[0].compliance_J
    parts = column(finished, "compliance_J") + column(finished, "ginzburg_landau_J")
    np.testing.assert_allclose(parts, objective, rtol=1e-14)
    assert finished.history[-1].kkt_residual < 0.5 * finished.history[0].kkt_residual


def test_volume_and_box_are_exact_in_every_step():
    def check(row, field):
        assert row.volume_fraction == pytest.approx(0.4, rel=1e-13)
        assert row.volume_error < 1e-12
        assert field.values.min() >= 0.0 and field.values.max() <= 1.0

    result = run(6, callback=check, tau=0.01)
    assert [row.iteration for row in result.history] == list(range(7))


@pytest.mark.parametrize("method", ["vmpt", "allen_cahn"])
@pytest.mark.parametrize("step", ["controlled", "variable_metric"])
def test_every_method_descends_by_every_rule(method, step):
    objective = column(run(8, method=method, step=step, tau=None), "objective_J")
    assert np.all(np.diff(objective) < 0) and objective[-1] < 0.6 * objective[0]


def test_fixed_step_keeps_tau_and_takes_every_step():
    result = run(4, **THESIS, tau=0.02)
    np.testing.assert_allclose(column(result, "tau"), 0.02, rtol=1e-12)
    assert np.all(column(result, "rejected") == 0) and len(result.history) == 5


def test_a_rising_objective_does_not_end_a_run_without_stagnation():
    """A step that is too long lets J rise; with stagnation 0 only the steps end the run."""
    loop = run(1).loop
    rising = tuple(replace(loop.history[0], objective_J=1.0 + k) for k in range(7))
    mesh, problem = cantilever((6, 2, 4), 1.0)
    flows = [
        prepare(mesh, problem, OptimizationSettings(steps=50, solver="direct", **settings))
        for settings in (ENDLESS, {**ENDLESS, "stagnation": 1e-4})
    ]
    outcomes = [flow.outcome(replace(loop, history=rising)) for flow in flows]
    assert outcomes == [None, "stagnation"]


def test_too_long_a_first_step_is_rejected():
    result = run(3, tau=10.0, method="allen_cahn")
    assert result.history[1].rejected > 0
    assert result.history[1].tau < 10.0
    assert np.all(np.diff(column(result, "objective_J")) < 0)


@pytest.mark.parametrize("scale", [2.0, 1e-3])
def test_scaling_lengths_scales_the_compliance_by_the_cube(scale):
    """g, C and tau unchanged; eps and gamma scaled with the lengths."""
    plain, scaled = run(5, tau=0.01), run(5, tau=0.01, scale=scale)
    for name in ("compliance_J", "ginzburg_landau_J"):
        np.testing.assert_allclose(column(scaled, name), scale**3 * column(plain, name), rtol=1e-9)
    np.testing.assert_allclose(scaled.phase_field.values, plain.phase_field.values, atol=1e-8)


def without_seconds(result):
    return [astuple(row)[:-1] for row in result.history]


def test_same_bytes_on_every_run_and_with_one_or_two_threads():
    serial = run(3, tau=0.01)
    before = numba.get_num_threads()
    try:
        for threads in {1, min(2, numba.config.NUMBA_NUM_THREADS)}:
            numba.set_num_threads(threads)
            again = run(3, tau=0.01)
            assert again.phase_field.values.tobytes() == serial.phase_field.values.tobytes()
            assert without_seconds(again) == without_seconds(serial)
    finally:
        numba.set_num_threads(before)


def test_continued_run_equals_the_uninterrupted_one(finished):
    first = run(5, tau=0.01)
    assert len(first.history) == 6
    resumed = run(12, start=first.loop, tau=0.01)
    assert resumed.phase_field.values.tobytes() == finished.phase_field.values.tobytes()
    assert without_seconds(resumed) == without_seconds(finished)
    assert np.all(np.diff(column(resumed, "seconds")) > 0)


def test_interrupt_leaves_the_last_accepted_step(finished):
    def stop(row, field):
        if row.iteration == 3:
            raise KeyboardInterrupt

    result = run(12, callback=stop, tau=0.01)
    assert result.outcome == "interrupted"
    assert without_seconds(result) == without_seconds(finished)[:4]


def test_stops_by_tolerance_and_by_stagnation(finished):
    tolerance = 1.0001 * finished.history[6].kkt_residual
    by_tolerance = run(12, tau=0.01, tolerance=tolerance)
    assert by_tolerance.outcome == "tolerance" and len(by_tolerance.history) <= 7
    by_stagnation = run(12, tau=0.01, stagnation=0.5)
    assert by_stagnation.outcome == "stagnation"
    objective = column(by_stagnation, "objective_J")
    assert objective[-1] > 0.5 * objective[-6]


def test_ends_with_a_state_solved_exactly_whatever_the_way_was():
    mesh, problem = cantilever((12, 4, 8))  # too large for the direct solver
    settings = OptimizationSettings(60, state_tolerance=1e-2, tolerance=0.02, stagnation=0.0)
    result = optimize(mesh, problem, settings)
    flow = prepare(mesh, problem, settings, result.loop)
    assert result.outcome == "tolerance" and result.state.residual <= 1e-6
    exact = flow.model.solve(result.phase_field.values, None, 1e-9)
    kkt = flow.conditions(result.loop.phi, flow.gradient(result.loop.phi, exact))
    assert result.kkt.residual == pytest.approx(kkt.residual, rel=1e-5)
    assert result.loop.objective == pytest.approx(flow.objective(result.loop.phi, exact), rel=1e-10)
    first = optimize(mesh, problem, replace(settings, steps=2))
    assert first.loop.state.residual > 1e-6 > first.state.residual


def test_says_so_when_nothing_decreases_any_more():
    mesh = bcc_box((0, 0, 0), (1, 1, 1), (2, 2, 2))
    settings = OptimizationSettings(steps=60, tau=1.0, **ENDLESS)
    result = optimize(mesh, unloaded((1, 1, 1), 0.3, eps=5.0), settings)
    assert result.outcome == "no_decrease"
    assert len(result.history) < 60


def test_start_is_projected_onto_box_and_volume():
    mesh, _ = cantilever()
    start = PhaseField(mesh, np.linspace(-1.0, 3.0, len(mesh.points)))
    row = run(1, start=start, tau=0.01).history[0]
    assert row.volume_fraction == pytest.approx(0.4, rel=1e-13)


def test_gamma_and_eps_are_chosen_when_left_open():
    result = run(25, changes={"gamma": None, "eps": None}, tau=None)
    mesh, _ = cantilever()
    assert warn_if_coarse(mesh, result.eps) == pytest.approx(6.0)
    density = result.history[-1].compliance_J / (0.4 * 0.06 * 0.02 * 0.04)
    assert 0.02 < result.gamma / result.eps / density < 2.0


def test_coarse_meshes_are_told_the_edge_that_would_do(caplog):
    mesh, _ = cantilever()
    with caplog.at_level(logging.WARNING, "phasemesh"):
        across = warn_if_coarse(mesh, 0.004)
    assert across < 4.0 and f"only {across:.1f} elements" in caplog.text
    advised = float(caplog.text.split("an edge length of ")[1].split()[0])
    assert 4 * advised == pytest.approx(np.pi * 0.004 / np.sqrt(2), rel=0.05)
    caplog.clear()
    warn_if_coarse(mesh, 0.04)
    assert not caplog.text


def test_measured_interface_of_a_known_slope():
    mesh = bcc_box((0, 0, 0), (2, 1, 1), (8, 4, 4))
    width, elements = measured_interface(mesh, tet_geometry(mesh), 0.5 * mesh.points[:, 0])
    assert width == pytest.approx(1.6)
    assert elements == pytest.approx(1.6 / (0.25 * 0.91), rel=0.05)  # mean edge 0.91 cells


@pytest.mark.parametrize(
    "settings, named",
    [
        ({"step": "newton"}, "step"),
        ({"step": "fixed"}, "step"),
        ({"method": "oc"}, "method"),
        ({"tau": -1.0}, "tau"),
        ({"steps": -1}, "steps"),
    ],
)
def test_bad_settings_are_refused_by_name(settings, named):
    with pytest.raises(InvalidCase, match=f"^{named}: "):
        run(**settings)


def test_bad_starts_and_fractions_are_refused():
    with pytest.raises(InvalidCase, match="start: "):
        run(start=np.full(7, 0.4))
    with pytest.raises(InvalidCase, match="volume_fraction: "):
        run(changes={"volume_fraction": 9.5})


def test_history_survives_the_file(tmp_path, finished):
    write_history(tmp_path / "history.csv", finished.history)
    assert read_history(tmp_path / "history.csv") == finished.history
    header = (tmp_path / "history.csv").read_text().splitlines()[0]
    assert header.startswith(
        "iteration,level,compliance_J,ginzburg_landau_J,objective_J,volume_fraction"
    )
    assert header.endswith("kkt_sign,volume_error,seconds")
