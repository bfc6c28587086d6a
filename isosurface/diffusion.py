"""One implicit step of diffusion that smooths a phase field itself, before its surface is taken."""

import numpy as np
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import LinearOperator, cg

from meshes import InvalidCase, NotConverged, PhaseField
from meshes.tet_mesh import tet_volumes


def diffused(field, length):
    """The field after one implicit step: (M + length^2 K) phi_new = M phi.

    Waves longer than some ten lengths stay; the integral of phi stays exactly, and no flux leaves
    the domain or crosses symmetry planes.

    Parameters
    ----------
    field : PhaseField
    length : float [m]

    Returns
    -------
    PhaseField

    Raises
    ------
    InvalidCase
        If the length is negative or not finite.
    NotConverged
        If conjugate gradients do not reach a residual of 1e-10.
    """
    if not 0.0 <= length < np.inf:
        raise InvalidCase(f"the diffusion length must be at least 0 and finite, got {length}")
    mesh = field.mesh
    volumes = tet_volumes(mesh.points, mesh.tets)
    mass = np.bincount(mesh.tets.ravel(), np.repeat(volumes / 4.0, 4), minlength=len(mesh.points))
    mass = np.where(mass > 0.0, mass, volumes.mean())  # nodes of no tet stay
    matrix = diags(mass) + length**2 * _stiffness(mesh, volumes)
    inverse_diagonal = 1.0 / matrix.diagonal()
    jacobi = LinearOperator(matrix.shape, lambda x: inverse_diagonal * x)
    values, failed = cg(matrix, mass * field.values, field.values, rtol=1e-10, M=jacobi)
    if failed:
        raise NotConverged(f"diffusion over {length:g} m did not converge: take a shorter length")
    return PhaseField(mesh, np.clip(values, 0.0, 1.0))


def _stiffness(mesh, volumes):
    """Matrix (n, n) of int grad u . grad v on linear tetrahedra."""
    corners = mesh.points[mesh.tets]
    edges = corners[:, 1:] - corners[:, :1]
    gradients = np.empty((len(mesh.tets), 4, 3))
    gradients[:, 1:] = np.linalg.inv(edges).transpose(0, 2, 1)
    gradients[:, 0] = -gradients[:, 1:].sum(axis=1)
    entries = np.einsum("tia,tja,t->tij", gradients, gradients, volumes)
    rows, columns = np.repeat(mesh.tets, 4, axis=1), np.tile(mesh.tets, (1, 4))
    shape = (len(mesh.points), len(mesh.points))
    return csr_matrix((entries.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
