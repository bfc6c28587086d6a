"""What each vertex of a labelled surface may do: move freely, in a plane, along a curve, or not.

The surface may be the modelled part, open on symmetry planes. It is then treated as the whole part
is: a vertex on such a plane sees the reflected images of its neighbours, and stays in the plane.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix

from isosurface.symmetry import on_symmetry_planes
from meshes import Patch
from meshes.curves import feature_mask
from meshes.edges import EdgeTable, edge_table

# The label of the faces inside the domain; all other labels are pieces of its boundary.
ISOSURFACE = Patch("isosurface")


@dataclass(frozen=True, eq=False)
class Structure:
    """Curves, corners and planes of a surface.

    Parameters
    ----------
    table : EdgeTable
    curve : (e,) bool array
        Edges of kept curves: label boundaries, feature edges, open edges off the symmetry planes.
    on_curve, corner : (n,) bool arrays
        Vertices of curves; those where curves end or meet.
    on_symmetry : (n, s) bool array
        Vertices on each symmetry plane.
    multiplicity : (2 e,) float array
        Number of images of the neighbour that each directed edge's first vertex sees; directed
        edges are the table's edges, and then the same reversed.
    smooth_faces : (m,) bool array
        Faces whose label has no plane.
    within_plane : (n,) bool array
        Vertices inside planar labels, off their curves.
    on_domain : (n,) bool array
        Vertices of smooth labels other than the isosurface, where there is one: curved pieces of
        the domain's boundary, which are given and not to be smoothed.
    normals : (q, 3) float array
        Normals of the planar labels, then of the symmetry planes.
    on_plane : (n, q) bool array
        Vertices of faces with that label, and vertices on that symmetry plane.
    """

    table: EdgeTable
    curve: np.ndarray
    on_curve: np.ndarray
    corner: np.ndarray
    on_symmetry: np.ndarray
    multiplicity: np.ndarray
    smooth_faces: np.ndarray
    within_plane: np.ndarray
    on_domain: np.ndarray
    normals: np.ndarray
    on_plane: np.ndarray

    @cached_property
    def average(self):
        """Sparse (n, n) matrix that takes the mean of a vertex's neighbours, images included.

        On a curve only the neighbours along it count; the rows of corners are empty.
        """
        first, second = directed_edges(self.table)
        along = np.tile(self.curve, 2)
        used = (along | ~self.on_curve[first]) & ~self.corner[first]
        count = len(self.corner)
        rows, columns, weight = first[used], second[used], self.multiplicity[used]
        total = np.bincount(rows, weight, minlength=count)
        return csr_matrix((weight / total[rows], (rows, columns)), shape=(count, count))

    @cached_property
    def constraints(self):
        """What the vertices' planes and corners leave of a displacement."""
        return Constraints(self)


def surface_structure(surface, symmetry=()):
    """Return the Structure of a TriMesh that is open on the symmetry planes given."""
    count = len(surface.points)
    table = edge_table(surface.faces)
    on_symmetry = on_symmetry_planes(surface.points, symmetry)
    open_edges = table.count == 1
    mirrored = open_edges & (on_symmetry[table.edges[:, 0]] & on_symmetry[table.edges[:, 1]]).any(1)
    curve = feature_mask(surface, table) & ~mirrored
    first, second = directed_edges(table)
    beyond = (on_symmetry[first] & ~on_symmetry[second]).sum(axis=1)
    multiplicity = 2.0**beyond
    degree = np.bincount(first, multiplicity * np.tile(curve, 2), minlength=count)
    planar = [k for k, patch in enumerate(surface.labels) if patch.plane is not None]
    on_plane = np.zeros((count, len(planar) + len(symmetry)), dtype=bool)
    for column, label in enumerate(planar):
        on_plane[surface.faces[surface.face_labels == label], column] = True
    on_plane[:, len(planar) :] = on_symmetry
    normals = [surface.labels[k].plane.normal for k in planar]
    normals += [tuple(np.eye(3)[plane.axis]) for plane in symmetry]
    return Structure(
        table=table,
        curve=curve,
        on_curve=degree > 0,
        corner=(degree > 0) & (degree != 2),
        on_symmetry=on_symmetry,
        multiplicity=multiplicity,
        smooth_faces=~np.isin(surface.face_labels, planar),
        within_plane=on_plane[:, : len(planar)].any(axis=1) & (degree == 0),
        on_domain=_on_domain(surface),
        normals=np.array(normals, dtype=float).reshape(-1, 3),
        on_plane=on_plane,
    )


def directed_edges(table):
    """Both directions of every edge: first and second vertices (2 e,)."""
    a, b = table.edges.T
    return np.concatenate([a, b]), np.concatenate([b, a])


def _on_domain(surface):
    """Vertices (n,) bool of smooth labels beside the isosurface."""
    names = [patch.name for patch in surface.labels]
    given = [k for k, patch in enumerate(surface.labels) if patch.plane is None]
    given = [k for k in given if names[k] != ISOSURFACE.name] if ISOSURFACE.name in names else []
    found = np.zeros(len(surface.points), dtype=bool)
    found[surface.faces[np.isin(surface.face_labels, given)]] = True
    return found


class Constraints:
    """Projection of displacements onto what the planes of each vertex allow; corners stay.

    For planes along the axes the projection is exact: vertices do not leave them by rounding.
    """

    def __init__(self, structure):
        self._bound = np.flatnonzero(structure.on_plane.any(axis=1) | structure.corner)
        planes = structure.on_plane[self._bound]
        sets, index = np.unique(planes, axis=0, return_inverse=True)
        projectors = np.array([_projector(structure.normals[chosen]) for chosen in sets])
        self._projectors = projectors.reshape(-1, 3, 3)[index.reshape(-1)]
        self._projectors[structure.corner[self._bound]] = 0.0

    def apply(self, displacement):
        """Project displacements (n, 3) in place, and return them."""
        bound = displacement[self._bound]
        displacement[self._bound] = np.einsum("nij,nj->ni", self._projectors, bound)
        return displacement


def _projector(normals):
    """Projection (3, 3) onto the directions perpendicular to all normals (k, 3)."""
    projector = np.eye(3)
    for normal in normals:
        rest = projector @ normal
        length = np.linalg.norm(rest)
        if length > 1e-6:
            rest = rest / length
            projector = projector - np.outer(rest, rest)
    return projector
