"""The stages that make the design: the tetrahedral mesh and the optimisation on it.

Every stage has `run` (make the product and write its files; returns what to tell) and `load`
(read them again for --from).
"""

import hashlib
import json
import logging
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from cases.history import HistoryFile
from cases.json_file import write_json
from cases.levels import adapt_mesh, load_meshes, make_meshes
from cases.resolved import resolved_case
from cases.run_folder import topopt_sections
from cases.series import FieldSeries, snapshot_steps
from cases.stage_files import load_design, save_design
from topopt.boundary import boundary_conditions, check_rigid_motions, rigid_supports
from topopt.certificate import certify
from topopt.checkpoint import Checkpoints
from topopt.domain import mesh_hash
from topopt.elasticity import ElasticModel, von_mises
from topopt.geometry import tet_geometry
from topopt.interpolation import stiffness_factor
from topopt.levels import Levels, coarse_settings
from topopt.optimize import OptimizationSettings, optimize, prepare
from topopt.parameters import mean_edge_length, measured_interface, too_coarse

LOG = logging.getLogger("phasemesh")
LARGEST_DERIVATIVE_ERROR = 1e-3


class MeshStage:
    """The design domain in tetrahedra, with its load and support sets."""

    def run(self, run):
        make_meshes(run)
        return self._tell(run)

    def load(self, run):
        load_meshes(run)
        self._tell(run)

    def _tell(self, run):
        run.figures["mesh"] = _mesh_figures(run)
        tets = [len(mesh.tets) for mesh in (*run.coarse_meshes, run.mesh)]
        coarser = ", ".join(f"{count:,}" for count in tets[:-1])
        if run.case.mesh.adapted:
            return f"{coarser} tetrahedra, to be adapted"
        after = f", after {coarser}" if coarser else ""
        return f"{tets[-1]:,} tetrahedra, {len(run.mesh.points):,} nodes{after}"


def _mesh_figures(run):
    figures = {
        "hash": mesh_hash(run.mesh),
        "nodes": len(run.mesh.points),
        "tets": len(run.mesh.tets),
        "kind": run.case.mesh.kind,
    }
    if run.coarse_meshes:
        figures["coarse_tets"] = [len(mesh.tets) for mesh in run.coarse_meshes]
    return figures


class TopoptStage:
    """The optimised phase field."""

    def run(self, run):
        settings = _settings(run.case.topopt)
        start = Checkpoints(run.folder, _identity(run)).read() if run.resume else None
        earlier = start.history if start else ()
        with HistoryFile(run.folder / "history.csv", earlier[1:]) as history:
            levels, interrupted = _levels(run), False
            start = start or levels.first()
            while start.level < levels.count and not interrupted:
                result, _, _ = self._optimize(run, start, coarse_settings(settings), history)
                interrupted = result.outcome == "interrupted"
                start = self._next_start(run, levels, result)
            if interrupted:
                settings = replace(settings, steps=0)
            result, model, series = self._optimize(
                run, start, settings, None if interrupted else history
            )
        if interrupted:
            result = replace(result, outcome="interrupted")
        self._keep(run, result, model, series)
        self._certify(run, result, model, settings)
        if result.outcome == "interrupted":
            raise KeyboardInterrupt
        row = result.history[-1]
        return (
            f"J = {row.objective_J:.4g} J after {row.iteration} steps ({result.outcome}), "
            f"KKT residual {row.kkt_residual:.2g}"
        )

    def _optimize(self, run, start, settings, history):
        """Run one level: its OptimizationResult, ElasticModel and FieldSeries.

        Without a history (HistoryFile or None) no trace of it is kept.
        """
        mesh = _mesh_of(run, start.level)
        conditions = boundary_conditions(mesh, run.problem, log=LOG.warning)
        check_rigid_motions(mesh, run.problem, conditions.fixed, conditions.springs)
        model = ElasticModel(mesh, run.problem, conditions, settings.solver)
        last = start.history[-1].iteration if start.history else -1
        series = FieldSeries(run.folder / "fields", mesh, last)
        with _Watch(run, mesh, series, history) as watch:
            callback = watch if history else None
            return optimize(mesh, run.problem, settings, start, callback, model), model, series

    def _next_start(self, run, levels, result):
        """The start of the next level; after an interruption of the last, on what mesh there is."""
        level, interrupted = result.loop.level + 1, result.outcome == "interrupted"
        if interrupted:
            level = levels.count
        elif run.case.mesh.adapted and level == levels.count:
            adapt_mesh(run, result.phase_field)
            run.figures["mesh"] = _mesh_figures(run)
            LOG.info("mesh: adapted, %s tetrahedra", f"{len(run.mesh.tets):,}")
        return levels.next(result.phase_field.mesh, result.loop, _mesh_of(run, level), level)

    def _keep(self, run, result, model, series):
        """Take over the result, and write it."""
        phi, state, conditions = result.phase_field.values, result.state, model.conditions
        stress = np.stack([von_mises(model, state, phi, k) for k in range(len(conditions.cases))])
        run.design = result.phase_field
        run.fields = {
            "displacement": state.displacements,
            "energy_density": state.energy_density,
            "von_mises": stress,
        }
        run.figures["topopt"] = _design_figures(run, result, model, conditions, stress)
        save_design(run.folder / "phase_field.npz", run.design, run.fields, run.figures["topopt"])
        fields = _series_fields(run, run.mesh, phi, state, stress)
        series.write(result.history[-1].iteration, *fields)

    def _certify(self, run, result, model, settings):
        """Write kkt.json, and warn where the derivatives disagree with differences of J."""
        settings = replace(settings, check_resolution=False)  # it has been said
        flow = prepare(run.mesh, run.problem, settings, result.loop, model)
        proof = certify(flow, result.loop, np.random.default_rng(run.case.seed))
        write_json(run.folder / "kkt.json", {"outcome": result.outcome, **proof.as_dict()})
        worst = max(check.relative_error for check in proof.derivatives)
        if worst > LARGEST_DERIVATIVE_ERROR:
            LOG.warning("the gradient differs from finite differences of J by %.1e.", worst)

    def load(self, run):
        run.design, run.fields, run.figures["topopt"] = load_design(
            run.folder / "phase_field.npz", run.mesh
        )
        if run.figures["topopt"]["outcome"] == "interrupted":
            LOG.warning(
                "the optimisation was interrupted after %d steps; its last design is used",
                run.figures["topopt"]["steps"],
            )


def _settings(section):
    """The case's `topopt` section as OptimizationSettings."""
    return OptimizationSettings(
        steps=section.steps,
        method=section.method,
        step=section.step,
        tau=None if section.tau == "auto" else section.tau,
        tolerance=section.tolerance,
        stagnation=section.stagnation,
        solver=section.solver,
        state_tolerance=section.state_tolerance,
    )


def _levels(run):
    return Levels(run.problem, _mesh_of(run, 1), run.case.mesh.levels)


def _mesh_of(run, level):
    return (*run.coarse_meshes, run.mesh)[level - 1]


def _identity(run):
    """What a checkpoint must agree in: its level's mesh, and whatever of the case shapes a step."""
    sections = topopt_sections(resolved_case(run.loaded))
    text = json.dumps(sections, sort_keys=True)
    meshes = tuple(mesh_hash(mesh) for mesh in (*run.coarse_meshes, run.mesh))
    return {"mesh": meshes, "case": hashlib.sha256(text.encode()).hexdigest()}


class _Watch:
    """The optimiser's callback: history, checkpoints, snapshots and progress.

    A checkpoint is written while the next step is computed, and is there before the next one's
    turn and when the watch ends.
    """

    def __init__(self, run, mesh, series, history):
        self._run, self._mesh, self._series, self._history = run, mesh, series, history
        self._checkpoints = Checkpoints(run.folder, _identity(run))
        self._steps = run.case.topopt.steps
        self._snapshots = snapshot_steps(run.case.output.snapshots, self._steps)
        self._writer, self._written = ThreadPoolExecutor(1), None

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._writer.shutdown(wait=True)
        if self._written is not None and error[0] is None:
            self._written.result()  # raises what went wrong

    def __call__(self, row, loop):
        level = f"level {row.level}, " if self._run.coarse_meshes else ""
        self._run.reporter.update(
            f"{level}J = {row.objective_J:.5g} J, KKT {row.kkt_residual:.2g}, tau {row.tau:.2g}",
            len(loop.rows) - 1,
            self._steps,
        )
        if row.iteration > 0:
            self._history.append(row)
        LOG.info(
            "%sstep %d: J %.6g, F %.6g (error about %.1e), tau %.3g, rejected %d, KKT %.3g, "
            "state iterations %d",
            *(level, row.iteration, row.objective_J, row.compliance_J),
            *(loop.state.compliance_error, row.tau),
            *(row.rejected, row.kkt_residual, row.state_iterations),
        )
        if row.iteration in self._snapshots:
            fields = _series_fields(self._run, self._mesh, loop.phi, loop.state)
            self._series.write(row.iteration, *fields)
        if self._written is not None:
            self._written.result()
        self._written = self._writer.submit(self._checkpoints.write, loop)


def _elastic_energy(run, mesh, phi, state):
    """Elastic energy density C(phi) eps(u) : eps(u) (m,) [J/m^3] on each tet; weighted sum of the
    load cases."""
    factor = stiffness_factor(phi, mesh.tets, run.problem.material.void_ratio)
    return factor * state.energy_density


def _series_fields(run, mesh, phi, state, stress=None):
    """What ParaView is to see: point data and cell data by name; of several load cases each."""
    names = [case.name for case in run.problem.cases]
    tails = [f"_{name}" for name in names] if len(names) > 1 else [""]
    points = {"phi": phi}
    points |= {f"displacement_m{tail}": u for tail, u in zip(tails, state.displacements)}
    cells = {"energy_density_J_per_m3": _elastic_energy(run, mesh, phi, state)}
    if stress is not None:
        cells |= {f"von_mises_Pa{tail}": values for tail, values in zip(tails, stress)}
    return points, cells


def _design_figures(run, result, model, conditions, stress):
    """The numbers of a design that summary and manifest tell."""
    phi, mesh = result.phase_field.values, run.mesh
    geometry = tet_geometry(mesh)
    width, elements = measured_interface(mesh, geometry, phi)
    domain = float(geometry.volumes.sum())
    solid = phi[mesh.tets].mean(axis=1) >= 0.5
    row, start = result.history[-1], result.history[0]
    return {
        "outcome": result.outcome,
        "steps": row.iteration,
        "coarse_steps": row.iteration - (len(result.loop.rows) - 1),
        "gamma": result.gamma,
        "eps_m": result.eps,
        "solver": result.state.solver,
        "objective_start_J": start.objective_J,
        "objective_J": row.objective_J,
        "compliance_J": row.compliance_J,
        "ginzburg_landau_J": row.ginzburg_landau_J,
        "volume_fraction": row.volume_fraction,
        "kkt": result.kkt.as_dict(),
        "domain_volume_m3": domain,
        "material_volume_m3": float(geometry.lumped_mass @ phi),
        "load_cases": [
            _case_figures(run, result.state, model, conditions, phi, k, stress[k][solid])
            for k in range(len(conditions.cases))
        ],
        "largest_displacement_m": _longest(result.state.displacements),
        "largest_von_mises_Pa": float(stress[:, solid].max(initial=0.0)),
        "interface_m": width,
        "elements_across_interface": elements,
        "too_coarse": None
        if run.case.mesh.adapted
        else too_coarse(mean_edge_length(mesh), result.eps, len(mesh.tets)),
    }


def _case_figures(run, state, model, conditions, phi, k, stress):
    """The numbers of load case k; `stress` is that of the solid."""
    case, problem_case = conditions.cases[k], run.problem.cases[k]
    acting = {name: conditions.load_forces[name] for name in problem_case.loads}
    reactions = model.reactions(phi, state, k)
    return {
        "name": case.name,
        "weight": case.weight,
        "compliance_J": state.compliances[k],
        "load_displacement_m": load_displacements(acting, state.displacements[k]),
        "largest_displacement_m": _longest(state.displacements[k]),
        "largest_von_mises_Pa": float(stress.max(initial=0.0)),
        "support_force_N": {
            support.name: _force(reactions, run.mesh.node_sets, support)
            for support in rigid_supports(run.problem)
        },
    }


def _force(reactions, node_sets, support):
    """Force [N] of a rigid support in the directions that it holds; 0 in the others."""
    force = reactions[node_sets[f"support:{support.name}"]].sum(axis=0)
    return [float(force[axis]) if axis in support.fixed else 0.0 for axis in range(3)]


def _longest(displacement):
    return float(np.linalg.norm(displacement, axis=-1).max())


def load_displacements(load_forces, displacement):
    """For every load the displacement [m] in its own direction, weighted by its force."""
    found = {}
    for name, force in load_forces.items():
        total = float(np.linalg.norm(force.sum(axis=0)))
        found[name] = float(np.vdot(force, displacement)) / total if total > 0 else 0.0
    return found
