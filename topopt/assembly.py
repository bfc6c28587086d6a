"""Assembly of the stiffness matrix by gathering: fast, parallel, and the same bits on any threads.

The 3 x 3 block of nodes i and j is a sum over the tets around the edge ij,

    K_ij = sum_e c_e V_e [lambda g_i g_j^T + mu g_j g_i^T + mu (g_i . g_j) I],

with the constant gradients g of the hat functions, so gradients and volumes are all that is
stored; c_e is the only thing that changes from step to step. Which tets surround which edge, and
where its block stands in the matrix, is found once per mesh.
"""

import numpy as np
from scipy.sparse import bsr_array, coo_array

from topopt import assembly_kernels as kernels

CHUNKS = 64  # in which the edges are dealt out to threads
CORNER_PAIRS = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


class Assembler:
    """Assembles the stiffness matrix of one mesh for one stiffness factor after another.

    Parameters
    ----------
    tets : (m, 4) int array
        Quickest where numbers that are near are near in space (see `geometry.morton_order`).
    volumes : (m,) float array [m^3]
    gradients : (m, 4, 3) float array [1/m]
    material : Material
    fixed : (n, 3) bool array
        Rows and columns that are zeroed; the diagonal entry is kept.
    springs : Springs, optional
        Elastic supports, added to every matrix.

    Attributes
    ----------
    indptr, indices : int32 arrays
        The sparsity pattern in blocks: row i holds the nodes of the edges at i, and i, sorted.
    """

    def __init__(self, tets, volumes, gradients, material, fixed, springs=None):
        self._volumes, self._material = volumes, material
        self._gradients = np.ascontiguousarray(gradients)
        self._fixed = np.ascontiguousarray(fixed)
        edges, self._edge_start, self._edge_corners = edges_and_tets(tets, len(fixed))
        self._chunks = np.linspace(0, len(edges), CHUNKS + 1).astype(np.int64)
        self.indptr, self.indices, places = _pattern(edges, len(fixed))
        self._upper, self._lower, self._diagonal = places
        self._springs = springs and self._place(springs)

    def assemble(self, factor, into=None):
        """Return the stiffness matrix for factors c (m,): bsr_array (3 n, 3 n) [N/m].

        It takes the place of `into` in memory, if an earlier matrix is given that is done with.
        """
        blocks = np.empty((len(self.indices), 3, 3)) if into is None else into.data
        kernels.edge_blocks(
            self._chunks,
            self._edge_start,
            self._edge_corners,
            factor * self._volumes,
            self._gradients,
            self._material.lame_lambda,
            self._material.lame_mu,
            self._upper,
            self._lower,
            blocks,
        )
        kernels.diagonal_and_supports(
            self.indptr, self.indices, self._diagonal, self._fixed, blocks
        )
        if self._springs is not None:
            places, springs = self._springs
            blocks[places] += springs
        size = 3 * len(self._fixed)
        return bsr_array((blocks, self.indices, self.indptr), shape=(size, size))

    def _place(self, springs):
        """Where the blocks of springs stand in the matrix, and the blocks (k, 3, 3) there."""
        n = np.int64(len(self._fixed))
        keys = np.repeat(np.arange(n), np.diff(self.indptr)) * n + self.indices
        places = np.searchsorted(keys, springs.rows * n + springs.columns)
        held = self._fixed[springs.rows] | self._fixed[springs.columns]
        held &= (springs.rows != springs.columns)[:, None]
        return places, np.where(held, 0.0, springs.blocks)[:, None, :] * np.eye(3)


def edges_and_tets(tets, n_points):
    """Return the edges of a tet mesh and the tets around each.

    Parameters
    ----------
    tets : (m, 4) int array
    n_points : int

    Returns
    -------
    edges : (k, 2) int array
        Nodes i < j, sorted.
    edge_start : (k + 1,) int32 array
        The tets around edge s stand in edge_corners[edge_start[s]:edge_start[s + 1]].
    edge_corners : (6 m,) int32 array
        16 e + 4 a + b for tet e, whose corner a is node i and whose corner b is node j.
    """
    first, second = tets[:, CORNER_PAIRS[:, 0]], tets[:, CORNER_PAIRS[:, 1]]
    swapped = first > second
    key = np.where(swapped, second, first) * np.int64(n_points) + np.where(swapped, first, second)
    order = np.argsort(key, axis=None, kind="stable")
    key = key.ravel()[order]
    start = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1], [True]]))
    forward = CORNER_PAIRS @ [4, 1]
    backward = CORNER_PAIRS @ [1, 4]
    corners = np.where(swapped, backward, forward) + 16 * np.arange(len(tets))[:, None]
    edges = np.stack(np.divmod(key[start[:-1]], n_points), axis=1)
    return edges, start.astype(np.int32), corners.ravel()[order].astype(np.int32)


def _pattern(edges, n_points):
    """Return indptr, indices, and where upper, lower and diagonal blocks stand in them."""
    low, high = edges.T
    nodes = np.arange(n_points)
    rows, columns = np.concatenate([low, high, nodes]), np.concatenate([high, low, nodes])
    number = np.arange(len(rows))
    pattern = coo_array((number, (rows, columns)), shape=(n_points, n_points)).tocsr()
    pattern.sort_indices()
    place = np.empty(len(rows), np.int32)
    place[pattern.data] = number
    places = np.split(place, [len(low), 2 * len(low)])
    return pattern.indptr.astype(np.int32), pattern.indices.astype(np.int32), places
