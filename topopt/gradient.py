"""Derivatives of the objective J = F(u(phi), phi) + gamma E(phi) by the phase field.

The compliance is self-adjoint, so its derivative needs the displacement alone:
dJ(h) = 2 int h rho G.u + gamma dE(h) - int 3 phi^2 (1 - r) w h   (2.7; the 2 is on gravity only).
It holds with imposed displacements u_D and springs too, because F = f.u - R.u_D is minus twice the
least potential energy (see `topopt.elasticity`), whose derivative is that at fixed u. Of several
load cases u and w are the weighted sums.
"""

import numpy as np

from topopt.interpolation import mean_cube_bend, mean_cube_pullback


def compliance_gradient(model, phi, state):
    """Nodal derivatives j (n,) [J] of the compliance F at phi.

    Parameters
    ----------
    model : ElasticModel
        The state problem: its mesh, volumes, material and gravity.
    phi : (n,) float array
    state : State
        The model's solution for phi.

    Notes
    -----
    j_i = - sum_e (1 - r) d mean(phi^3)_e / d phi_i |e| w_e + 2 int N_i rho G.u.
    """
    weights = -(1.0 - model.material.void_ratio) * model.volumes * state.energy_density
    gradient = mean_cube_pullback(phi, model.mesh.tets, weights, model.geometry.corners)
    if np.any(model.gravity):
        gradient += 2.0 * model.body_force_work(model.weighted_displacement(state))
    return gradient


def curvature_along(model, phi, state, direction, response):
    """Second derivative F''(phi) d (n,) [J] of the compliance along a direction d (n,).

    Parameters
    ----------
    model, phi, state
        As in `compliance_gradient`.
    direction : (n,) float array
    response : Response
        The model's, for the state and the direction.
    """
    weights = -(1.0 - model.material.void_ratio) * model.volumes
    still, moving = weights * state.energy_density, weights * response.energy_density
    corners = model.geometry.corners
    result = mean_cube_bend(phi, direction, model.mesh.tets, still, moving, corners)
    if np.any(model.gravity):
        result += 2.0 * model.body_force_work(model.weighted_displacement(response))
    return result


def concavity(model, phi, state):
    """Row sums (n,) [J] of the second derivative of int (1 - r) phi^3 w at fixed displacement.

    For smooth phi and w that is 6 phi w times the lumped mass. The compliance itself never curves
    upward by more than twice this.
    """
    tets = model.mesh.tets
    weights = (1.0 - model.material.void_ratio) * model.volumes * state.energy_density
    ones, none = np.ones(len(phi)), np.zeros(len(tets))
    return mean_cube_bend(phi, ones, tets, weights, none, model.geometry.corners)
