"""The carrier: the triangulation on which vertices are moved, with a normal at every corner.

Evaluating an interpolant costs 80 to 95 per cent of a remesher's time if every trial move asks
for it. So trial moves slide on a triangulation of the surface whose corners carry the surface's
exact normals; positions are settled on the surface itself after whole sweeps (see `fidelity`).
"""

from dataclasses import dataclass

import numpy as np

from remesh.curves import Curves, find_curves
from remesh.layout import Layout, make_layout, row_normals
from remesh.nearest import closest_many, count_cells, describe_triangles, fill_cells

CORNER_ANGLE = 45.0  # [degrees]
CELLS_PER_TRIANGLE = 16
EDGES_PER_CELL = 1.0


@dataclass(frozen=True, eq=False)
class Carrier:
    """A triangulation prepared for closest points by patch and for sliding along curves.

    Parameters
    ----------
    layout : Layout
        The triangulation, with all feature edges, label and open boundaries among its features.
    normals : (m, 3, 3) float array
        Unit normals of the surface at the corners of every face.
    reference : tuple
        Arrays for the kernels of `nearest`.
    curves : Curves
    """

    layout: Layout
    normals: np.ndarray
    reference: tuple
    curves: Curves

    @property
    def mesh(self):
        """The triangulation as TriMesh."""
        return self.layout.mesh

    def locate(self, points, hints):
        """Nearest face of the hinted faces' patches: faces (n,), (v, w, distance^2) (n, 3)."""
        points = np.ascontiguousarray(points, dtype=float)
        faces = np.empty(len(points), np.int64)
        barycentric = np.empty((len(points), 3))
        hints = np.ascontiguousarray(hints, dtype=np.int64)
        closest_many(self.reference, points, hints, faces, barycentric)
        return faces, barycentric


def make_carrier(mesh, normals=None, corner_angle=CORNER_ANGLE):
    """Prepare a mesh as carrier.

    Parameters
    ----------
    mesh : TriMesh
        Points without a face are left out.
    normals : (m, 3, 3) float array, optional
        Unit normals at the faces' corners; angle-weighted ones of the mesh if not given.
    corner_angle : float [degrees]
        Feature curves are cut where they turn by more.

    Raises
    ------
    InvalidMesh
        If the mesh has no faces, NaN points, or is not an oriented manifold.
    """
    layout = make_layout(mesh)
    normals = None if normals is None else normals[layout.order]
    return carrier_on(layout, normals, corner_angle)


def carrier_on(layout, normals=None, corner_angle=CORNER_ANGLE):
    """The Carrier of a Layout; parameters as for `make_carrier`."""
    if normals is None:
        normals = row_normals(layout)[layout.group]
    reference = make_reference(layout, normals)
    return Carrier(layout, normals, reference, curves_of(layout, normals, corner_angle))


def curves_of(layout, normals, corner_angle):
    """The feature curves of a Layout."""
    return find_curves(layout.mesh, normals, layout.twins, layout.crease, corner_angle)


def make_reference(layout, normals):
    """The arrays that the kernels of `nearest` take."""
    mesh, count = layout.mesh, len(layout.mesh.faces)
    corners, boxes = np.empty((count, 12)), np.empty((count, 6))
    sides = np.empty((count, 4), np.int64)
    describe_triangles(
        mesh.points, mesh.faces, mesh.face_labels, layout.twins, layout.crease, corners, sides,
        boxes,
    )  # fmt: skip
    grid = _grid(boxes, corners)
    starts = np.zeros(int(np.prod(grid[4:])) + 1, np.int64)
    count_cells(boxes, grid, starts)
    starts = np.cumsum(starts, dtype=np.int64)
    triangles = np.empty(starts[-1], np.int64)
    cell_boxes = np.empty((starts[-1], 6), np.float32)
    fill_cells(boxes, grid, starts[:-1].copy(), triangles, cell_boxes)
    flat = np.ascontiguousarray(normals.reshape(-1, 9))
    return corners, flat, sides, starts, triangles, cell_boxes, grid


def _grid(boxes, corners):
    """Parameters (7,) of a regular grid over the boxes: low corner, cell size, counts."""
    low, high = boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)
    size = EDGES_PER_CELL * np.sqrt(corners[:, 9]).mean()
    extent = high - low + 2.0 * size
    while np.prod(np.floor(extent / size) + 1.0) > CELLS_PER_TRIANGLE * len(boxes) + 1000:
        size *= 1.25
        extent = high - low + 2.0 * size
    counts = np.floor(extent / size) + 1.0
    return np.concatenate([low - size, [size], counts])
