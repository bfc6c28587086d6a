"""The carrier: the triangulation on which vertices are moved, with a normal at every corner.

Evaluating an interpolant costs 80 to 95 per cent of a remesher's time if every trial move asks
for it. So trial moves slide on a triangulation of the surface whose corners carry the surface's
exact normals; positions are settled on the surface itself after whole sweeps (see `fidelity`).
"""

from dataclasses import dataclass

import numpy as np

from meshes import TriMesh
from meshes.quality import corner_normals
from meshes.topology import edge_table, feature_mask
from remesh.curves import Curves, find_curves
from remesh.nearest import closest_many, count_cells, fill_cells

CELLS_PER_TRIANGLE = 16
EDGES_PER_CELL = 1.0
MORTON_CELLS = 1024  # along each axis


@dataclass(frozen=True, eq=False)
class Carrier:
    """A triangulation prepared for closest points by patch and for sliding along curves.

    Parameters
    ----------
    mesh : TriMesh
        With all feature edges, label and open boundaries included; no unused points.
    normals : (m, 3, 3) float array
        Unit normals of the surface at the corners of every face.
    twins, crease : (3 m,) arrays
        Opposite half-edge (-1 on a boundary); whether the half-edge is on a feature.
    reference : tuple
        Arrays for the kernels of `nearest`.
    curves : Curves
    order : (m,) int array
        Which face of the mesh it was made from each face is.
    """

    mesh: TriMesh
    normals: np.ndarray
    twins: np.ndarray
    crease: np.ndarray
    reference: tuple
    curves: Curves
    order: np.ndarray

    def locate(self, points, hints):
        """Nearest face of the hinted faces' patches: faces (n,), (v, w, distance^2) (n, 3)."""
        points = np.ascontiguousarray(points, dtype=float)
        faces = np.empty(len(points), np.int64)
        barycentric = np.empty((len(points), 3))
        hints = np.ascontiguousarray(hints, dtype=np.int64)
        closest_many(self.reference, points, hints, faces, barycentric)
        return faces, barycentric


def make_carrier(mesh, normals=None, corner_angle=45.0):
    """Prepare a mesh as carrier.

    Parameters
    ----------
    mesh : TriMesh
        Manifold and oriented. Points without a face are left out.
    normals : (m, 3, 3) float array, optional
        Unit normals at the faces' corners; angle-weighted ones of the mesh if not given.
    corner_angle : float [degrees]
        Feature curves are cut where they turn by more.
    """
    normals = corner_normals(mesh) if normals is None else normals
    mesh, order = spatially_ordered(with_all_features(compacted(mesh)))
    normals = normals[order]
    twins, crease = half_edge_tables(mesh)
    reference = make_reference(mesh, normals, twins, crease)
    curves = find_curves(mesh, normals, twins, crease, corner_angle)
    return Carrier(mesh, normals, twins, crease, reference, curves, order)


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
    extent = np.ptp(points, axis=0).max()
    scaled = (points - points.min(axis=0)) * (MORTON_CELLS / (extent if extent > 0.0 else 1.0))
    cells = np.minimum(scaled.astype(np.int64), MORTON_CELLS - 1)
    key = np.zeros(len(points), np.int64)
    for bit in range(MORTON_CELLS.bit_length() - 1):
        for axis in range(3):
            key |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    by_point = np.argsort(key, kind="stable")
    rank = np.empty(len(points), np.int64)
    rank[by_point] = np.arange(len(points))
    faces = rank[mesh.faces]
    order = np.argsort(faces.min(axis=1), kind="stable")
    edges = rank[mesh.feature_edges]
    labels = mesh.face_labels[order]
    return TriMesh(points[by_point], faces[order], labels, mesh.labels, edges), order


def with_all_features(mesh):
    """The mesh with label boundaries and open boundaries among its feature edges."""
    table = edge_table(mesh.faces)
    edges = table.edges[feature_mask(mesh, table)]
    return TriMesh(mesh.points, mesh.faces, mesh.face_labels, mesh.labels, edges)


def half_edge_tables(mesh):
    """Opposite half-edge (3 m,) int32 and feature flag (3 m,) bool of a manifold mesh."""
    table = edge_table(mesh.faces)
    twins = np.full(mesh.faces.size, -1, np.int64)
    inner = table.start[:-1][table.count == 2]
    first, second = table.half_edges[inner], table.half_edges[inner + 1]
    twins[first], twins[second] = second, first
    return twins, feature_mask(mesh, table)[table.face_edges].ravel()


def make_reference(mesh, normals, twins, crease):
    """The arrays that the kernels of `nearest` take."""
    a, b, c = np.moveaxis(mesh.points[mesh.faces], 1, 0)
    u, v = b - a, c - a
    products = [np.einsum("ij,ij->i", p, q) for p, q in ((u, u), (u, v), (v, v))]
    corners = np.ascontiguousarray(np.column_stack([a, u, v, *products]))
    neighbours = np.where(crease | (twins < 0), -1, twins // 3).reshape(-1, 3)
    sides = np.column_stack([neighbours, mesh.face_labels]).astype(np.int64)
    stacked = np.stack([a, b, c])
    boxes = np.concatenate([stacked.min(axis=0), stacked.max(axis=0)], axis=1)
    starts, triangles, grid = _cells(boxes, u)
    flat = np.ascontiguousarray(normals.reshape(-1, 9))
    return (
        corners,
        flat,
        sides,
        starts,
        triangles,
        _outward(boxes - np.tile(grid[:3], 2))[triangles],
        grid,
    )


def _outward(boxes):
    """Boxes (m, 6) as float32, rounded so that they contain what they did."""
    rounded = boxes.astype(np.float32)
    rounded[:, :3] = np.nextafter(rounded[:, :3], np.float32(-np.inf))
    rounded[:, 3:] = np.nextafter(rounded[:, 3:], np.float32(np.inf))
    return rounded


def _cells(boxes, edges):
    """A regular grid over the boxes: starts, triangles, and its parameters."""
    low, high = boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)
    size = EDGES_PER_CELL * np.linalg.norm(edges, axis=1).mean()
    extent = high - low + 2.0 * size
    while np.prod(np.floor(extent / size) + 1.0) > CELLS_PER_TRIANGLE * len(boxes) + 1000:
        size *= 1.25
        extent = high - low + 2.0 * size
    counts = np.floor(extent / size) + 1.0
    grid = np.concatenate([low - size, [size], counts])
    starts = np.zeros(int(np.prod(counts)) + 1, np.int64)
    boxes = np.ascontiguousarray(boxes)
    count_cells(boxes, grid, starts)
    starts = np.cumsum(starts, dtype=np.int64)
    triangles = np.empty(starts[-1], np.int64)
    fill_cells(boxes, grid, starts[:-1].copy(), triangles)
    return starts, triangles, grid
