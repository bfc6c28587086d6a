"""P1 geometry of a tetrahedral mesh: volumes, gradients of the hat functions, lumped mass."""

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from scipy.sparse import coo_matrix

from meshes.errors import InvalidMesh
from topopt import geometry_kernels as kernels

_KNOWN = WeakKeyDictionary()  # TetMesh to TetGeometry
INDEX = np.uint32


@dataclass(frozen=True, eq=False)
class TetGeometry:
    """What every P1 integral on a mesh is made of.

    Parameters
    ----------
    volumes : (m,) float array [m^3]
    gradients : (m, 4, 3) float array [1/m]
        gradients[e, a] is the constant gradient of the hat function of corner a on tet e.
    lumped_mass : (n,) float array [m^3]
        int N_i, the diagonal of the row-sum lumped mass matrix; it sums to the domain's volume.
    tets : (m, 4) int array
    """

    volumes: np.ndarray
    gradients: np.ndarray
    lumped_mass: np.ndarray
    tets: np.ndarray

    @cached_property
    def corners(self):
        """The NodeCorners of the mesh."""
        return NodeCorners(self.tets, len(self.lumped_mass))

    @cached_property
    def stiffness(self):
        """A, a_ij = int grad N_i . grad N_j [m], as CSR (n, n) with sorted int32 indices."""
        g = self.gradients
        local = np.einsum("eai,ebi->eab", g, g) * self.volumes[:, None, None]
        rows, columns = np.repeat(self.tets, 4, axis=1), np.tile(self.tets, (1, 4))
        entries = (local.ravel(), (rows.ravel(), columns.ravel()))
        n = len(self.lumped_mass)
        matrix = coo_matrix(entries, shape=(n, n)).tocsr()
        matrix.sort_indices()
        return matrix


class NodeCorners:
    """Which corners of which tets each node is, so that sums over tets are gathered by nodes.

    Threads never meet, and the order of the terms does not depend on them.

    Parameters
    ----------
    tets : (m, 4) int array
    n_points : int

    Attributes
    ----------
    start : (n + 1,) uint32 array
    places : (4 m,) uint32 array
        Node i is the corners 4 e + a in places[start[i]:start[i + 1]], in the order of the tets.
    """

    def __init__(self, tets, n_points):
        self.places = np.argsort(tets, axis=None, kind="stable").astype(INDEX)
        counts = np.bincount(tets.ravel(), minlength=n_points)
        self.start = np.concatenate([[0], np.cumsum(counts)]).astype(INDEX)

    def sums(self, local):
        """Sum (n,) over the tets at each node of the values local (m, 4) of their corners."""
        result = np.empty(len(self.start) - 1)
        kernels.node_sums(self.start, self.places, local.ravel(), result)
        return result


def unsigned(indices):
    """The same indices (none negative) as uint32, as kernels take them; of int32 a view.

    For signed ones a kernel asks at each access whether it is to count from the end, which takes
    as long as the access itself.
    """
    return indices.view(INDEX) if indices.dtype == np.int32 else indices.astype(INDEX)


def tet_geometry(mesh):
    """Volumes, hat-function gradients and lumped mass of a mesh.

    Parameters
    ----------
    mesh : TetMesh
        Every tet positively oriented.

    Returns
    -------
    TetGeometry
        Read-only arrays.

    Raises
    ------
    InvalidMesh
        If a tet is flat, inverted, or has a coordinate that is not finite.

    Notes
    -----
    Kept as long as the mesh is: every stage that asks for it gets the same one.
    """
    if mesh not in _KNOWN:
        _KNOWN[mesh] = _computed(mesh)
    return _KNOWN[mesh]


def _computed(mesh):
    """The TetGeometry itself."""
    origin, a, b, c = (mesh.points[mesh.tets[:, k]] for k in range(4))
    a, b, c = a - origin, b - origin, c - origin
    # The gradient of a corner's hat function is the opposite face's normal, area / (3 volume).
    normals = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    six_volumes = np.einsum("ij,ij->i", normals[:, 0], a)
    _check_orientation(six_volumes)
    gradients = np.empty((len(mesh.tets), 4, 3))
    gradients[:, 1:] = normals / six_volumes[:, None, None]
    gradients[:, 0] = -gradients[:, 1:].sum(axis=1)
    volumes = six_volumes / 6.0
    lumped_mass = np.bincount(
        mesh.tets.ravel(), np.repeat(volumes / 4.0, 4), minlength=len(mesh.points)
    )
    for array in (volumes, gradients, lumped_mass):
        array.flags.writeable = False
    return TetGeometry(volumes, gradients, lumped_mass, mesh.tets)


def _check_orientation(six_volumes):
    """Raise InvalidMesh unless every volume is positive and finite."""
    bad = np.flatnonzero(~(six_volumes > 0) | ~np.isfinite(six_volumes))
    if len(bad):
        raise InvalidMesh(
            f"{len(bad)} of {len(six_volumes)} tets have no positive volume "
            f"(first: tet {bad[0]}); mesh the domain again or swap two corners of inverted tets."
        )


def morton_order(points, bits=16):
    """Order points along a Morton (Z-order) curve, so that neighbours in space lie near in memory.

    Parameters
    ----------
    points : (n, 3) float array [m]
    bits : int
        Cells per axis: 2**bits of the longest side of the bounding box; at most 21.

    Returns
    -------
    (n,) int array
        order[k] is the index of the point that comes k-th.
    """
    extent = np.ptp(points, axis=0).max()
    scale = (2**bits - 1) / extent if extent > 0 else 0.0
    cells = ((points - points.min(axis=0)) * scale).astype(np.int64)
    key = np.zeros(len(points), np.int64)
    for bit in range(bits):
        for axis in range(3):
            key |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(key, kind="stable")


def mass_product(tets, volumes, values):
    """Return int N_i v for a P1 function v: the consistent mass matrix times its nodal values.

    Parameters
    ----------
    tets : (m, 4) int array
    volumes : (m,) float array [m^3]
    values : (n,) float array

    Returns
    -------
    (n,) float array, in the unit of `values` times m^3
    """
    corners = values[tets]
    share = (corners + corners.sum(axis=1, keepdims=True)) * (volumes / 20.0)[:, None]
    return np.bincount(tets.ravel(), share.ravel(), minlength=len(values))
