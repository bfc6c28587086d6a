"""The state problem: P1 linear elasticity of the phase field under tractions and gravity.

Symbols: phi phase field, u displacement, eps(u) strain, C(phi) = C_mat [r + (1 - r) phi^3],
w = eps(u) : C_mat : eps(u) energy density (not scaled by phi), K stiffness matrix, f nodal forces.
"""

import time
from dataclasses import dataclass

import numpy as np

from topopt import elasticity_kernels as kernels
from topopt.assembly import Assembler
from topopt.geometry import mass_product, morton_order, tet_geometry
from topopt.interpolation import stiffness_factor
from topopt.linear_solver import make_solver, rigid_body_modes
from topopt.weak_form import WeakFormAssembler


@dataclass(frozen=True, eq=False)
class State:
    """The solution of the state problem for one phase field.

    Parameters
    ----------
    displacement : (n, 3) float array [m]
    compliance : float [J]
        F = int phi rho G.u + int g.u, taken as f.u + r.u with the residual r = f - K u, whose
        error is of second order in r.
    energy_density : (m,) float array [J/m^3]
        w = eps(u) : C_mat : eps(u) on each tet, not scaled by phi.
    iterations : int
        Of the linear solver.
    residual : float
        |f - K u| / |f|, computed from the displacement itself.
    compliance_error : float [J]
        Estimate r.B r of the error r.K^-1 r of the compliance (B: the preconditioner).
    solver : str
        Which linear solver gave the answer.
    assembly_seconds, setup_seconds, solve_seconds : float [s]
        Wall time of the stiffness matrix, of the solver's numeric set-up, and of the solve.
    """

    displacement: np.ndarray
    compliance: float
    energy_density: np.ndarray
    iterations: int
    residual: float
    compliance_error: float
    solver: str
    assembly_seconds: float
    setup_seconds: float
    solve_seconds: float


class ElasticModel:
    """Elasticity on one mesh, solved for one phase field after another.

    Parameters
    ----------
    mesh : TetMesh
    problem : Problem
        Its material and gravity are used.
    conditions : BoundaryConditions
    solver : {"auto", "multigrid", "pyamg", "direct"}
        See `linear_solver.make_solver`. With "direct" the matrix too comes from the reference,
        scikit-fem.

    Attributes
    ----------
    geometry : TetGeometry
    volumes : (m,) float array [m^3]
    """

    def __init__(self, mesh, problem, conditions, solver="auto"):
        self.mesh = mesh
        self.material = problem.material
        self.gravity = np.asarray(problem.gravity, dtype=float)
        self.conditions = conditions
        self.geometry = tet_geometry(mesh)
        if solver == "direct":
            self._order, self._tet_order = np.arange(len(mesh.points)), np.arange(len(mesh.tets))
            self._assembler = WeakFormAssembler(mesh, self.material, conditions.fixed)
        else:
            self._set_up_gathering()
        reference = self._assembler.assemble(np.ones(len(mesh.tets)))
        points, fixed = mesh.points[self._order], conditions.fixed[self._order]
        self._solver = make_solver(solver, reference, rigid_body_modes(points, fixed))

    @property
    def volumes(self):
        return self.geometry.volumes

    def _set_up_gathering(self):
        """Number the nodes along a Morton curve, sort the tets by them, and prepare to gather.

        The solver's k-th node is the mesh's order[k]-th, its k-th tet the mesh's tet_order[k]-th.
        """
        self._order = morton_order(self.mesh.points)
        place = np.empty_like(self._order)
        place[self._order] = np.arange(len(place))
        tets = place[self.mesh.tets]
        self._tet_order = np.argsort(tets.min(axis=1), kind="stable")
        self._assembler = Assembler(
            tets[self._tet_order],
            self.geometry.volumes[self._tet_order],
            self.geometry.gradients[self._tet_order],
            self.material,
            self.conditions.fixed[self._order],
        )

    def body_force(self, phi):
        """Nodal forces (n, 3) [N] of the weight of the material: int phi rho G N_i."""
        mass = mass_product(self.mesh.tets, self.volumes, phi)
        return self.material.density * mass[:, None] * self.gravity

    def body_force_work(self, displacement):
        """Return int N_i rho G.u (n,) [J]: how the weight's work changes with phi at node i."""
        work = self.material.density * (displacement @ self.gravity)
        return mass_product(self.mesh.tets, self.volumes, work)

    def forces(self, phi):
        """All nodal forces (n, 3) [N] at the free degrees of freedom; 0 at the fixed ones."""
        forces = self.conditions.forces + self.body_force(phi)
        return np.where(self.conditions.fixed, 0.0, forces)

    def solve(self, phi, start=None, tolerance=1e-6):
        """Displacement, compliance and energy density for nodal values phi (n,).

        Parameters
        ----------
        phi : (n,) float array
        start : (n, 3) float array [m], optional
            Where the iteration starts: the last displacement.
        tolerance : float
            Relative residual asked for.

        Returns
        -------
        State

        Raises
        ------
        NotConverged
            If no solver reaches the tolerance.
        """
        began = time.perf_counter()
        forces = self.forces(phi)
        factor = stiffness_factor(phi, self.mesh.tets, self.material.void_ratio)
        matrix = self._assembler.assemble(factor[self._tet_order])
        assembled = time.perf_counter()
        self._solver.update(matrix)
        prepared = time.perf_counter()
        solution = self._solver.solve(
            forces[self._order], None if start is None else start[self._order], tolerance
        )
        seconds = (assembled - began, prepared - assembled, time.perf_counter() - prepared)
        displacement = np.empty_like(forces)
        displacement[self._order] = solution.displacement
        second_order = float(np.vdot(solution.residual_vector, solution.displacement))
        return State(
            displacement,
            float(np.vdot(forces, displacement)) + second_order,
            self.energy_density(displacement),
            solution.iterations,
            solution.history[-1],
            solution.error_energy,
            solution.solver,
            *seconds,
        )

    def energy_density(self, displacement):
        """Return w = eps(u) : C_mat : eps(u) (m,) [J/m^3] on each tet, for u (n, 3) [m]."""
        result = np.empty(len(self.mesh.tets))
        kernels.energy_density(
            displacement,
            self.mesh.tets,
            self.geometry.gradients,
            self.material.lame_lambda,
            self.material.lame_mu,
            result,
        )
        return result


def von_mises(model, state, phi):
    """Von Mises stress (m,) [Pa] on each tet, of the stress C(phi) eps(u).

    Parameters
    ----------
    model : ElasticModel
    state : State
    phi : (n,) float array
    """
    result = np.empty(len(model.mesh.tets))
    factor = stiffness_factor(phi, model.mesh.tets, model.material.void_ratio)
    kernels.von_mises(
        state.displacement,
        model.mesh.tets,
        model.geometry.gradients,
        model.material.lame_mu * factor,
        result,
    )
    return result
