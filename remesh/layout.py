"""What hangs together on a surface: opposite half-edges, creases, and the rows of its vertices.

Found once for every mesh that becomes a carrier, in the order in which the carrier keeps it.
"""

from dataclasses import dataclass

import numpy as np

from meshes import InvalidMesh, TriMesh
from meshes.topology import topology
from remesh.layout_kernels import (
    list_by_lower_end,
    mark_creases,
    morton_keys,
    number_rows,
    pair_half_edges,
    pinched_vertices,
)
from remesh.shape_kernels import average_normals, gather_normals

MORTON_CELLS = 1024  # along each axis


@dataclass(frozen=True, eq=False)
class Layout:
    """A mesh along a Morton curve, and how its half-edges and corners hang together.

    Parameters
    ----------
    mesh : TriMesh
        Without unused points, with label and open boundaries among its feature edges.
    order : (m,) int array
        Which face of the mesh it was made from each face is.
    twins : (3 m,) int64 array
        Opposite half-edges, -1 on an open boundary.
    crease : (3 m,) bool array
        Whether the half-edge is on a feature.
    group : (m, 3) int64 array
        Row at every face corner: a vertex has one row per sector between its feature edges, and
        the first row of vertex v is v.
    rows_of : (k,) int64 array
        Vertex of every row.
    """

    mesh: TriMesh
    order: np.ndarray
    twins: np.ndarray
    crease: np.ndarray
    group: np.ndarray
    rows_of: np.ndarray

    @property
    def closed(self):
        """Whether there is no open boundary."""
        return bool((self.twins >= 0).all())

    def edge_lengths(self):
        """Length of every edge, once."""
        halves = np.flatnonzero(self.twins < np.arange(self.twins.size))
        flat = self.mesh.faces.ravel()
        ends = flat[halves], flat[halves + np.where(halves % 3 == 2, -2, 1)]
        return np.linalg.norm(self.mesh.points[ends[0]] - self.mesh.points[ends[1]], axis=1)


def make_layout(mesh):
    """The Layout of an oriented manifold.

    Raises
    ------
    InvalidMesh
        If the mesh has no faces, NaN points, or is not an oriented manifold.
    """
    require_finite(mesh)
    mesh, order = spatially_ordered(compacted(mesh))
    faces, count = mesh.faces, len(mesh.points)
    starts, listed = np.zeros(count + 1, np.int64), np.empty(faces.size, np.int64)
    list_by_lower_end(faces, starts, listed)
    twins = np.full(faces.size, -1, np.int64)
    if pair_half_edges(faces, starts, listed, twins) > 0:
        refuse(mesh)
    out, degree = np.full(count, -1, np.int64), np.zeros(count, np.int64)
    if pinched_vertices(faces, twins, out, degree) > 0:
        refuse(mesh)
    crease = np.zeros(faces.size, bool)
    mark_creases(faces, twins, mesh.face_labels, mesh.feature_edges, starts, listed, crease)
    group = np.full(faces.size, -1, np.int64)
    rows_of = np.full(faces.size, -1, np.int64)
    rows = number_rows(faces, twins, crease, group, rows_of, count)
    mesh = with_feature_edges(mesh, twins, crease)
    return Layout(mesh, order, twins, crease, group.reshape(-1, 3), rows_of[:rows].copy())


def require_finite(mesh):
    """Raise InvalidMesh if a mesh has no faces, or faces at points that are no finite numbers."""
    if len(mesh.faces) == 0:
        raise InvalidMesh("the surface has no faces: there is nothing to remesh")
    if np.isfinite(mesh.points).all():
        return
    bad = int((~np.isfinite(mesh.points[mesh.faces]).all(axis=(1, 2))).sum())
    if bad:
        raise InvalidMesh(f"{bad} faces have points that are not finite numbers: repair them first")


def refuse(mesh):
    """Raise InvalidMesh that counts what is wrong with a mesh that is no oriented manifold."""
    found = topology(mesh.faces, len(mesh.points))
    raise InvalidMesh(
        f"the surface is not an oriented manifold: {found.nonmanifold_edges} edges with more "
        f"than two faces, {found.nonmanifold_vertices} pinched vertices, "
        f"{found.collapsed_faces} faces that name a vertex twice"
        f"{'' if found.oriented else ', faces oriented differently'}: repair it first"
    )


def row_normals(layout):
    """Unit normal of every row (k, 3), weighted by angles; on planar labels that of the plane."""
    mesh = layout.mesh
    normals = np.zeros((len(layout.rows_of), 3))
    gather_normals(mesh.points, mesh.faces, layout.group, normals)
    for label, patch in enumerate(mesh.labels):
        if patch.plane is not None:
            normals[layout.group[mesh.face_labels == label]] = patch.plane.normal
    return normals


def averaged(group, normals, rounds):
    """Unit normals (k, 3) of rows, averaged over the triangles (m, 3) around each."""
    for _ in range(rounds):
        total = np.zeros_like(normals)
        average_normals(group, normals, total)
        normals = total
    return normals


def compacted(mesh):
    """The mesh without points that belong to no face."""
    used = np.zeros(len(mesh.points), bool)
    used[mesh.faces.ravel()] = True
    if used.all():
        return mesh
    new = np.cumsum(used) - 1
    edges = mesh.feature_edges[used[mesh.feature_edges].all(axis=1)]
    return TriMesh(mesh.points[used], new[mesh.faces], mesh.face_labels, mesh.labels, new[edges])


def spatially_ordered(mesh):
    """The mesh with points and faces along a Morton curve, and the order (m,) of its faces.

    Neighbours in space then are neighbours in memory, which halves the time of closest points.
    """
    points = mesh.points
    low = points.min(axis=0)
    extent = (points.max(axis=0) - low).max()
    keys = np.empty(len(points), np.int64)
    morton_keys(points, low, MORTON_CELLS / (extent if extent > 0.0 else 1.0), MORTON_CELLS, keys)
    by_point = np.argsort(keys, kind="stable")
    rank = np.empty(len(points), np.int32)
    rank[by_point] = np.arange(len(points), dtype=np.int32)
    faces = rank[mesh.faces]
    first = np.minimum(np.minimum(faces[:, 0], faces[:, 1]), faces[:, 2])
    order = np.argsort(first, kind="stable")
    labels = mesh.face_labels[order]
    edges = rank[mesh.feature_edges]
    return TriMesh(points[by_point], faces[order], labels, mesh.labels, edges), order


def with_feature_edges(mesh, twins, crease):
    """The mesh with the edges of all crease half-edges as its feature edges, sorted."""
    halves = np.flatnonzero(crease)
    halves = halves[(twins[halves] < 0) | (twins[halves] > halves)]
    flat = mesh.faces.ravel()
    ends = np.stack([flat[halves], flat[halves + np.where(halves % 3 == 2, -2, 1)]], axis=1)
    edges = np.sort(ends, axis=1)
    edges = edges[np.lexsort((edges[:, 1], edges[:, 0]))]
    return TriMesh(mesh.points, mesh.faces, mesh.face_labels, mesh.labels, edges)
