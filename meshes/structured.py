"""A body-centred cubic tetrahedral mesh of a box: instant, exact, and well shaped."""

import numpy as np

from meshes.patch import Patch, Plane
from meshes.tet_mesh import TetMesh, boundary_facets, tet_volumes


def box_patches(lower, upper):
    """The six planar patches of a box [m]: "x-", "x+", "y-", "y+", "z-", "z+"."""
    patches = []
    for axis in range(3):
        for sign, offset in ((-1.0, -lower[axis]), (1.0, upper[axis])):
            normal = [0.0, 0.0, 0.0]
            normal[axis] = sign
            name = "xyz"[axis] + ("+" if sign > 0 else "-")
            patches.append(Patch(name, Plane(tuple(normal), float(offset))))
    return tuple(patches)


def bcc_box(lower, upper, cells):
    """Mesh the box [lower, upper] [m] with a body-centred cubic lattice of cells (nx, ny, nz).

    Every cell has a node in its centre; the four tetrahedra around a face join the centres of
    its two cells (on the boundary: the centre and the face's own midpoint) with its edges.
    """
    lower, upper = np.asarray(lower, float), np.asarray(upper, float)
    cells = np.asarray(cells, int)
    corner_shape = tuple(cells + 1)
    corner_id = np.arange(np.prod(corner_shape)).reshape(corner_shape)
    centre_id = corner_id.size + np.arange(np.prod(cells)).reshape(tuple(cells))
    lattice = [np.indices(corner_shape).reshape(3, -1).T.astype(float)]
    lattice.append(np.indices(tuple(cells)).reshape(3, -1).T + 0.5)
    next_id = corner_id.size + centre_id.size
    tets = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        moved = np.moveaxis(corner_id, (axis, first, second), (0, 1, 2))
        quads = np.stack(
            [moved[:, :-1, :-1], moved[:, 1:, :-1], moved[:, 1:, 1:], moved[:, :-1, 1:]], axis=-1
        )
        centres = np.moveaxis(centre_id, (axis, first, second), (0, 1, 2))
        layer = centres.shape[1:]
        below = np.full((cells[axis] + 1, *layer), -1)
        above = np.full((cells[axis] + 1, *layer), -1)
        below[1:], above[:-1] = centres, centres
        for side, index in ((below, 0), (above, -1)):
            ids = next_id + np.arange(np.prod(layer)).reshape(layer)
            next_id += ids.size
            side[index] = ids
            grid = np.indices(layer).reshape(2, -1).T + 0.5
            midpoints = np.empty((ids.size, 3))
            midpoints[:, axis] = 0.0 if index == 0 else cells[axis]
            midpoints[:, first], midpoints[:, second] = grid.T
            lattice.append(midpoints)
        for k in range(4):
            a, b = quads[..., k], quads[..., (k + 1) % 4]
            tets.append(np.stack([below, a, b, above], axis=-1).reshape(-1, 4))
    points = np.concatenate(lattice)
    points = lower + points * ((upper - lower) / cells)
    for axis in range(3):  # the far planes exactly, whatever the rounding
        points[np.concatenate(lattice)[:, axis] == cells[axis], axis] = upper[axis]
    tets = np.concatenate(tets).astype(np.int32)
    flipped = tet_volumes(points, tets) < 0
    tets[flipped] = tets[flipped][:, [0, 2, 1, 3]]
    facets = boundary_facets(tets)
    patches = box_patches(lower, upper)
    distance = np.stack(
        [np.abs(p.plane.signed_distance(points[facets])).max(axis=1) for p in patches], axis=1
    )
    return TetMesh(points, tets, facets, distance.argmin(axis=1), patches)
