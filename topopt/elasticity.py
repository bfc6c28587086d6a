"""The state problem: P1 linear elasticity of the phase field under tractions and gravity.

Symbols: phi phase field, u displacement, eps(u) strain, C(phi) = C_mat [r + (1 - r) phi^3],
w = eps(u) : C_mat : eps(u) energy density (not scaled by phi), K stiffness matrix (springs of
elastic supports included), f nodal forces, u_D imposed displacement, R = K u - f the reaction.

In every load case the compliance is F = f.u - R.u_D, which is minus twice the least potential
energy, min 1/2 u.K u - f.u over all u with u = u_D on the supports. So a better displacement
raises it, an error of u shows in second order only, and its derivative by phi is that at fixed u.
"""

import time
from dataclasses import dataclass, replace

import numpy as np

from topopt import elasticity_kernels as kernels
from topopt.assembly import Assembler
from topopt.geometry import mass_product, morton_order, tet_geometry, unsigned
from topopt.interpolation import stiffness_factor, stiffness_slope
from topopt.linear_solver import make_solver, rigid_body_modes
from topopt.weak_form import WeakFormAssembler

LIFT_TOLERANCE = 1e-6  # any extension is exact; a smooth one is quick to go on from


@dataclass(frozen=True, eq=False)
class State:
    """The solution of the state problem for one phase field.

    Parameters
    ----------
    displacements : (c, n, 3) float array [m]
        Of every load case.
    compliances : tuple of float [J]
        Of every load case: F = int phi rho G.u + int g.u - R.u_D, taken as f.u + r.u with the
        residual r = f - K u, whose error is of second order in r.
    compliance : float [J]
        The compliances times the weights of their cases, summed.
    energy_density : (m,) float array [J/m^3]
        w = eps(u) : C_mat : eps(u) on each tet, not scaled by phi; of several load cases the
        weighted sum.
    iterations : int
        Of the linear solver, all cases together.
    residual : float
        |f - K u| / |f|, computed from the displacement itself; the largest of the cases.
    compliance_error : float [J]
        Estimate of the error r.K^-1 r of the compliance.
    solver : str
        Which linear solver gave the answer.
    assembly_seconds, setup_seconds, solve_seconds : float [s]
        Wall time of the stiffness matrix, of the solver's numeric set-up, and of the solve.
    """

    displacements: np.ndarray
    compliances: tuple[float, ...]
    compliance: float
    energy_density: np.ndarray
    iterations: int
    residual: float
    compliance_error: float
    solver: str
    assembly_seconds: float
    setup_seconds: float
    solve_seconds: float

    @property
    def displacement(self):
        """Displacement (n, 3) [m] of the first load case."""
        return self.displacements[0]


@dataclass(frozen=True, eq=False)
class Response:
    """How a State changes with the phase field, to first order along one direction.

    Parameters
    ----------
    displacements : (c, n, 3) float array [m]
    energy_density : (m,) float array [J/m^3]
        Change of w.
    iterations : int
        Of the linear solver, all load cases together.
    """

    displacements: np.ndarray
    energy_density: np.ndarray
    iterations: int


class ElasticModel:
    """Elasticity on one mesh, solved for one phase field after another.

    All load cases share the stiffness matrix and the solver's hierarchy.

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
            self._assembler = WeakFormAssembler(
                mesh, self.material, conditions.fixed, conditions.springs
            )
        else:
            self._set_up_gathering()
        reference = self._assembler.assemble(np.ones(len(mesh.tets)))
        points, fixed = mesh.points[self._order], conditions.fixed[self._order]
        self._solver = make_solver(solver, reference, rigid_body_modes(points, fixed))
        self._lifts = self._imposed_displacements(reference)
        self._matrix, self._ready_for, self._stresses = reference, None, None

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
            _reordered(self.conditions.springs, place),
        )

    def _imposed_displacements(self, reference):
        """For every load case an extension (n, 3) of its imposed displacement, or None.

        That of the uniform material: smooth, so that what is left to solve for is small.
        """
        lifts, ready = [], False
        for case in self.conditions.cases:
            lift = case.displacement
            if lift is not None:
                if not ready:
                    self._solver.update(reference)
                    ready = True
                pull = -self.internal_forces(lift, np.ones(len(self.mesh.tets)))
                lift = lift + self._solve(pull, None, LIFT_TOLERANCE)[0]
            lifts.append(lift)
        return lifts

    def body_force(self, phi):
        """Nodal forces (n, 3) [N] of the weight of the material: int phi rho G N_i."""
        mass = mass_product(self.mesh.tets, self.volumes, phi)
        return self.material.density * mass[:, None] * self.gravity

    def body_force_work(self, displacement):
        """Return int N_i rho G.u (n,) [J]: how the weight's work changes with phi at node i."""
        work = self.material.density * (displacement @ self.gravity)
        return mass_product(self.mesh.tets, self.volumes, work)

    def weighted_displacement(self, state):
        """Sum (n, 3) [m] over the load cases with gravity of weight times displacement."""
        shares = [case.weight * case.gravity for case in self.conditions.cases]
        return np.tensordot(shares, state.displacements, axes=1)

    def forces(self, phi, case=None):
        """All nodal forces (n, 3) [N] of a load case (the first): tractions and weight."""
        case = self.conditions.cases[0] if case is None else case
        if not (case.gravity and np.any(self.gravity)):
            return case.forces
        return case.forces + self.body_force(phi)

    def internal_forces(self, displacement, factor):
        """Forces K u (n, 3) [N] that hold a displacement u (n, 3) [m], springs included.

        Parameters
        ----------
        displacement : (n, 3) float array [m]
        factor : (m,) float array
            Of the stiffness on each tet.
        """
        result = self._stress_forces(self._stress(displacement), factor)
        springs = self.conditions.springs
        return result if springs is None else result + springs.forces(displacement)

    def _stress(self, displacement):
        """Stress (m, 6) [Pa] of a displacement (n, 3) at full stiffness: xx, yy, zz, xy, yz, zx."""
        stress = np.empty((len(self.mesh.tets), 6))
        kernels.stresses(
            np.ascontiguousarray(displacement),
            unsigned(self.mesh.tets),
            self.geometry.gradients,
            self.material.lame_lambda,
            self.material.lame_mu,
            stress,
        )
        return stress

    def _stress_forces(self, stress, factor):
        """Forces (n, 3) [N] of stresses (m, 6) at full stiffness, the factor as above."""
        corners, result = self.geometry.corners, np.empty(self.mesh.points.shape)
        weights, gradients = factor * self.volumes, self.geometry.gradients
        kernels.stress_forces(corners.start, corners.places, gradients, weights, stress, result)
        return result

    def _stresses_of(self, state):
        """Stresses (m, 6) of every load case of a State, kept while the same one is asked for."""
        if self._stresses is None or self._stresses[0] is not state:
            self._stresses = state, [self._stress(u) for u in state.displacements]
        return self._stresses[1]

    def reactions(self, phi, state, k=0):
        """Forces R = K u - f (n, 3) [N] that rigid supports exert in load case k; 0 elsewhere."""
        factor = stiffness_factor(phi, self.mesh.tets, self.material.void_ratio)
        forces = self.forces(phi, self.conditions.cases[k])
        reactions = self.internal_forces(state.displacements[k], factor) - forces
        return np.where(self.conditions.fixed, reactions, 0.0)

    def solve(self, phi, start=None, tolerance=1e-6, near=False):
        """Displacement, compliance and energy density for nodal values phi (n,).

        Parameters
        ----------
        phi : (n,) float array
        start : (c, n, 3) float array [m], optional
            Where the iterations start: the last displacements; (n, 3) will do for one load case.
        tolerance : float
            Relative residual asked for.
        near : bool
            Whether phi is so near that of the last solve that its hierarchy will do.

        Returns
        -------
        State

        Raises
        ------
        NotConverged
            If no solver reaches the tolerance.
        """
        began = time.perf_counter()
        assembled = self._prepare(phi, near)
        prepared = time.perf_counter()
        cases, shape = self.conditions.cases, self.mesh.points.shape
        starts = [None] * len(cases) if start is None else np.reshape(start, (-1, *shape))
        found = [
            self._solve_case(self.forces(phi, case), lift, first, phi, tolerance)
            for case, lift, first in zip(cases, self._lifts, starts, strict=True)
        ]
        seconds = (assembled - began, prepared - assembled, time.perf_counter() - prepared)
        weights = [case.weight for case in cases]
        displacements, compliances, solutions = zip(*found)
        densities = (weight * self.energy_density(u) for weight, u in zip(weights, displacements))
        return State(
            np.stack(displacements),
            compliances,
            sum(weight * value for weight, value in zip(weights, compliances)),
            sum(densities),
            sum(solution.iterations for solution in solutions),
            max(solution.history[-1] for solution in solutions),
            sum(weight * s.error_energy for weight, s in zip(weights, solutions)),
            solutions[-1].solver,
            *seconds,
        )

    def _prepare(self, phi, near=False):
        """Make matrix and solver those of phi (n,); returns when the matrix was assembled."""
        if self._ready_for is not None and np.array_equal(phi, self._ready_for):
            return time.perf_counter()
        self._ready_for = None
        factor = stiffness_factor(phi, self.mesh.tets, self.material.void_ratio)
        self._matrix = self._assembler.assemble(factor[self._tet_order], self._matrix)
        assembled = time.perf_counter()
        self._solver.update(self._matrix, near)
        self._ready_for = None if near else np.array(phi)
        return assembled

    def response(self, phi, state, direction, tolerance=1e-2, start=None):
        """How displacements and energy density change where phi moves along a direction.

        Parameters
        ----------
        phi : (n,) float array
        state : State
            The solution for phi.
        direction : (n,) float array
        tolerance : float
            Relative residual.
        start : (c, n, 3) float array [m], optional
            A guess of the change of the displacements.

        Returns
        -------
        Response

        Notes
        -----
        K u' = f' - K' u, with K' the stiffness matrix for the change of C(phi), and f' the weight
        of the material that comes in; u' = 0 on the supports.
        """
        self._prepare(phi)
        slope = stiffness_slope(phi, direction, self.mesh.tets, self.material.void_ratio)
        displacements, iterations, density = [], 0, np.zeros(len(slope))
        cases = self.conditions.cases
        starts = [None] * len(cases) if start is None else start
        for case, stress, first in zip(cases, self._stresses_of(state), starts, strict=True):
            forces = self._stress_forces(stress, -slope)
            if case.gravity and np.any(self.gravity):
                forces += self.body_force(direction)
            change, _, solution = self._solve(forces, first, tolerance)
            density += 2.0 * case.weight * self._stress_work(stress, change)  # w is quadratic
            displacements.append(change)
            iterations += solution.iterations
        return Response(np.stack(displacements), density, iterations)

    def _solve_case(self, forces, lift, start, phi, tolerance):
        """Displacement (n, 3), compliance and Solution of one load case.

        With u = U + v, U the lift, K v = f - K U and F = f.u + (f - K u).u = 2 f.U - U.K U
        + (f - K U).v + r.v.
        """
        if lift is None:
            displacement, second_order, solution = self._solve(forces, start, tolerance)
            work = np.where(self.conditions.fixed, 0.0, forces)
            return displacement, float(np.vdot(work, displacement)) + second_order, solution
        factor = stiffness_factor(phi, self.mesh.tets, self.material.void_ratio)
        held = self.internal_forces(lift, factor)
        rest = forces - held
        start = None if start is None else start - lift
        change, second_order, solution = self._solve(rest, start, tolerance)
        compliance = float(np.vdot(forces, lift) + np.vdot(rest, lift) + np.vdot(rest, change))
        return lift + change, compliance + second_order, solution

    def _solve(self, forces, start, tolerance):
        """Solve K v = f on the free degrees of freedom: v (n, 3), r.v, and the Solution."""
        forces = np.where(self.conditions.fixed, 0.0, forces)[self._order]
        start = None if start is None else start[self._order]
        solution = self._solver.solve(forces, start, tolerance)
        displacement = np.empty_like(forces)
        displacement[self._order] = solution.displacement
        second_order = float(np.vdot(solution.residual_vector, solution.displacement))
        return displacement, second_order, solution

    def energy_density(self, displacement):
        """Return w = eps(u) : C_mat : eps(u) (m,) [J/m^3] on each tet, for u (n, 3) [m]."""
        result = np.empty(len(self.mesh.tets))
        lame = (self.material.lame_lambda, self.material.lame_mu)
        tets, gradients = unsigned(self.mesh.tets), self.geometry.gradients
        kernels.energy_density(displacement, tets, gradients, *lame, result)
        return result

    def _stress_work(self, stress, displacement):
        """Stresses (m, 6) [Pa] times the strains of a displacement (n, 3): (m,) [J/m^3]."""
        result = np.empty(len(stress))
        tets, gradients = unsigned(self.mesh.tets), self.geometry.gradients
        kernels.stress_work(stress, displacement, tets, gradients, result)
        return result


def _reordered(springs, place):
    """The same springs where node i has the number place[i]."""
    return springs and replace(springs, rows=place[springs.rows], columns=place[springs.columns])


def von_mises(model, state, phi, k=0):
    """Von Mises stress (m,) [Pa] on each tet, of the stress C(phi) eps(u).

    Parameters
    ----------
    model : ElasticModel
    state : State
    phi : (n,) float array
    k : int
        The load case.
    """
    result = np.empty(len(model.mesh.tets))
    factor = stiffness_factor(phi, model.mesh.tets, model.material.void_ratio)
    kernels.von_mises(
        state.displacements[k],
        unsigned(model.mesh.tets),
        model.geometry.gradients,
        model.material.lame_mu * factor,
        result,
    )
    return result
