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


class WeakFormAssembler:
    """Assembles the stiffness matrix with scikit-fem; the slow twin of `assembly.Assembler`.

    Parameters
    ----------
    mesh : TetMesh
    material : Material
    fixed : (n, 3) bool array
        Rows and columns that are zeroed; the diagonal entry is kept.
    springs : Springs, optional
        Elastic supports, added to every matrix.
    """

    def __init__(self, mesh, material, fixed, springs=None):
        self._basis = vector_basis(mesh)
        self._constants = self._basis.with_element(ElementTetP0())
        self._form = elasticity_form(material)
        self._held = np.asarray(fixed).ravel()
        self._springs = _entries(springs)
        self._node_major = np.empty(self._basis.N, np.int64)
        self._node_major[self._basis.nodal_dofs.T.ravel()] = np.arange(self._basis.N)

    def assemble(self, factor, into=None):
        """Return the stiffness matrix for factors c (m,): bsr_array (3 n, 3 n) [N/m].

        `into` is there for `assembly.Assembler`; here a matrix is always a new one.
        """
        field = self._constants.interpolate(factor)
        matrix = self._form.assemble(self._basis, factor=field).tocoo()
        rows, columns, data = self._springs
        rows = np.concatenate([self._node_major[matrix.row], rows])
        columns = np.concatenate([self._node_major[matrix.col], columns])
        keep = (rows == columns) | ~(self._held[rows] | self._held[columns])
        data = np.where(keep, np.concatenate([matrix.data, data]), 0.0)
        return bsr_array((data, (rows, columns)), shape=matrix.shape, blocksize=(3, 3))


def _entries(springs):
    """Rows, columns and values of the springs' matrix, entry by entry."""
    if springs is None:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    axes = np.arange(3)
    rows, columns = (3 * nodes[:, None] + axes for nodes in (springs.rows, springs.columns))
    return rows.ravel(), columns.ravel(), springs.blocks.ravel()
