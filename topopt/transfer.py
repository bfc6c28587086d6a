"""A phase field carried over from one tetrahedral mesh to another of the same domain.

The new field is the L2 projection of the old one: among all P1 functions of the new mesh the one
nearest to it. It keeps the volume, because constants are among them; where the new mesh contains
the old one it is the old field. What it overshoots at kinks, and what rounding and quadrature miss
of the volume, the projection onto box and volume takes off (`topopt.projection`).
"""

import numpy as np
from scipy.sparse import coo_matrix

from meshes.box_tree import build_tree, in_chunks
from meshes.closest_point import ClosestPoint
from topopt.geometry import tet_geometry
from topopt.transfer_kernels import locate

NEAR, FAR = 0.5854101966249685, 0.1381966011250105  # (5 + 3 sqrt 5) / 20 and (5 - sqrt 5) / 20
QUADRATURE = np.full((4, 4), FAR) + (NEAR - FAR) * np.eye(4)  # exact for degree 2
SLICE = 2**17  # tets taken at a time
TOLERANCE = 1e-12
MOST_ITERATIONS = 200


class TetLocator:
    """Finds the tets around points, in a mesh of whatever shape.

    Parameters
    ----------
    mesh : TetMesh
    geometry : TetGeometry, optional
        That of the mesh, if it is at hand.
    """

    def __init__(self, mesh, geometry=None):
        geometry = tet_geometry(mesh) if geometry is None else geometry
        tree = build_tree(mesh.points, mesh.tets)
        self._mesh, self._order = mesh, tree.order
        self._tree = (tree.boxes, tree.begin, tree.end, tree.leaves)
        origin = mesh.points[mesh.tets[tree.order, 0]]
        rows = geometry.gradients[tree.order, 1:].reshape(-1, 9)
        self._frames = np.concatenate([origin, rows], axis=1)
        self._boundary = None

    def weights(self, points):
        """Nodes and weights that interpolate at points.

        Points outside all tets (of the next mesh of a curved boundary) take the nearest point of
        the boundary.

        Parameters
        ----------
        points : (k, 3) float array [m]

        Returns
        -------
        nodes : (k, 4) int32 array
        weights : (k, 4) float array
            Not negative; each row sums to 1.
        """
        points = np.ascontiguousarray(points, dtype=float)
        found, weights = np.empty(len(points), np.int64), np.empty((len(points), 4))
        frames, tree = self._frames, self._tree
        in_chunks(
            lambda first, last: locate(points, tree, frames, first, last, found, weights),
            len(points),
        )
        nodes = self._mesh.tets[self._order[found]]
        weights = np.maximum(weights, 0.0)
        outside = np.flatnonzero(found < 0)
        if len(outside):
            nodes[outside], weights[outside] = self._on_boundary(points[outside])
        return nodes, weights / weights.sum(axis=1, keepdims=True)

    def _on_boundary(self, points):
        """Nodes and weights (k, 4) at the nearest points of the boundary; the last weight is 0."""
        mesh = self._mesh
        if self._boundary is None:
            self._boundary = ClosestPoint(mesh.points, mesh.facets)
        facet, weights, _ = self._boundary.query(points)
        corners = mesh.facets[facet]
        nodes = np.concatenate([corners, corners[:, :1]], axis=1)
        return nodes, np.pad(np.maximum(weights, 0.0), ((0, 0), (0, 1)))


def transferred(field, mesh, geometry=None):
    """The L2 projection of a phase field onto the P1 functions of another mesh.

    Parameters
    ----------
    field : PhaseField
    mesh : TetMesh
        Of the same domain.
    geometry : TetGeometry, optional
        That of `mesh`, if it is at hand.

    Returns
    -------
    (n,) float array
        Nodal values on `mesh`; near kinks of the field they may lie a little outside [0, 1].
    """
    geometry = tet_geometry(mesh) if geometry is None else geometry
    locator, right = TetLocator(field.mesh), np.zeros(len(mesh.points))
    for begin in range(0, len(mesh.tets), SLICE):
        tets, share = (
            mesh.tets[begin : begin + SLICE],
            0.25 * geometry.volumes[begin : begin + SLICE],
        )
        places = (QUADRATURE @ mesh.points[tets]).reshape(-1, 3)  # a tet's four one after another
        nodes, weights = locator.weights(places)
        values = np.einsum("ka,ka->k", weights, field.values[nodes]).reshape(-1, 4)
        parts = (share[:, None] * values) @ QUADRATURE
        right += np.bincount(tets.ravel(), parts.ravel(), minlength=len(right))
    return solve_mass(mesh, geometry, right)


def mass_matrix(mesh, geometry):
    """The consistent mass matrix int N_i N_j [m^3] as CSR (n, n)."""
    rows, columns = np.repeat(mesh.tets, 4, axis=1), np.tile(mesh.tets, (1, 4))
    local = (np.ones((4, 4)) + np.eye(4)).ravel() / 20.0
    values = geometry.volumes[:, None] * local
    size = len(mesh.points)
    return coo_matrix((values.ravel(), (rows.ravel(), columns.ravel())), (size, size)).tocsr()


def solve_mass(mesh, geometry, right):
    """Solve M x = b (n,) by conjugate gradients, started from and preconditioned by the lumped M.

    The spectrum of lumped^-1 M lies within [1/5, 1] on every mesh, so some 30 iterations do.
    """
    matrix, lumped = mass_matrix(mesh, geometry), geometry.lumped_mass
    x = right / lumped
    residual = right - matrix @ x
    z = residual / lumped
    direction, rho = z, residual @ z
    enough = TOLERANCE**2 * float(right @ (right / lumped))
    for _ in range(MOST_ITERATIONS):
        if not rho > enough:
            break
        product = matrix @ direction
        alpha = rho / (direction @ product)
        x, residual = x + alpha * direction, residual - alpha * product
        z = residual / lumped
        rho, before = residual @ z, rho
        direction = z + rho / before * direction
    return x
