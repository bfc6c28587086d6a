"""Linear elasticity in scikit-fem's words: the reference assembly of the state problem.

Slower than `topopt.assembly` and written to be read: the weak form below is the definition of
the state problem. scikit-fem's arrays are (dim, n); that transpose lives here.
"""

import numpy as np
from scipy.sparse import bsr_array
from skfem import Basis, BilinearForm, ElementTetP0, ElementTetP1, ElementVector, MeshTet
from skfem.helpers import ddot, eye, sym_grad, trace


def vector_basis(mesh):
    """Return scikit-fem's basis of P1 displacements on a TetMesh."""
    points, tets = np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.tets.T)
    return Basis(MeshTet(points, tets), ElementVector(ElementTetP1()), intorder=1)


def elasticity_form(material):
    """Return the bilinear form int c eps(v) : C_mat : eps(u), c being a P0 field `w.factor`."""

    def stress(strain):
        pressure = material.lame_lambda * trace(strain)
        return 2.0 * material.lame_mu * strain + eye(pressure, strain.shape[0])

    @BilinearForm
    def form(u, v, w):
        return w.factor * ddot(stress(sym_grad(u)), sym_grad(v))

    return form


def assemble_stiffness(mesh, material, factor, fixed):
    """Stiffness matrix with the fixed degrees of freedom taken out.

    Parameters
    ----------
    mesh : TetMesh
    material : Material
    factor : (m,) float array
        r + (1 - r) mean(phi^3) on each tet.
    fixed : (n, 3) bool array
        Their rows and columns are zeroed; the diagonal entry is kept.

    Returns
    -------
    scipy.sparse.bsr_array, (3 n, 3 n) in 3 x 3 blocks [N/m]
    """
    basis = vector_basis(mesh)
    field = basis.with_element(ElementTetP0()).interpolate(factor)
    matrix = elasticity_form(material).assemble(basis, factor=field).tocoo()
    node_major = np.empty(basis.N, np.int64)
    node_major[basis.nodal_dofs.T.ravel()] = np.arange(basis.N)
    rows, columns = node_major[matrix.row], node_major[matrix.col]
    held = fixed.ravel()
    keep = (rows == columns) | ~(held[rows] | held[columns])
    data = np.where(keep, matrix.data, 0.0)
    return bsr_array(
        bsr_array((data, (rows, columns)), shape=matrix.shape, blocksize=(3, 3)), dtype=float
    )
