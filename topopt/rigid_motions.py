"""The rigid motions that a set of held degrees of freedom leaves free, and their names.

A rigid motion is u(x) = t + w x (x - centre): six numbers (t, w). It is free if it vanishes in
every held direction. A free motion makes the stiffness matrix singular, so it is named here, in
words, before anything is solved.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

RELATIVE_RANK = 1e-8  # singular values below this share of the largest count as zero
AXES = "xyz"


def mesh_components(mesh):
    """Connected components of a mesh's tets, by shared nodes.

    Returns
    -------
    count : int
    component : (n,) int array
        Component of each node.
    """
    n = len(mesh.points)
    rows = np.repeat(mesh.tets[:, 0], 3)
    graph = coo_array((np.ones(len(rows), np.int8), (rows, mesh.tets[:, 1:].ravel())), shape=(n, n))
    return connected_components(graph, directed=False)


def free_motions(points, fixed):
    """The rigid motions that vanish at every held degree of freedom.

    Parameters
    ----------
    points : (n, 3) float array [m]
    fixed : (n, 3) bool array

    Returns
    -------
    translations : (a, 3) float array
        Directions of the free translations.
    rotations : list of (direction (3,), centre (3,) [m], pitch [m])
        Free rotations w x (x - centre), each with an advance of `pitch` along the unit direction
        w per radian. The centre is the axis' point nearest to the middle of the points.
    """
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    size = np.linalg.norm(np.ptp(points, axis=0)) / 2.0 or 1.0
    null = _null_space(_held_rows((points - middle) / size, fixed))
    rotating = _echelon(null[:, [3, 4, 5, 0, 1, 2]])[:, [3, 4, 5, 0, 1, 2]]
    turns = np.linalg.norm(rotating[:, 3:], axis=1) > 1e-6
    translations = _echelon(rotating[~turns, :3])
    rotations = []
    for motion in rotating[turns]:
        shift, turn = motion[:3], motion[3:]
        length = np.linalg.norm(turn)
        direction, shift = turn / length, shift / length
        centre = middle + size * np.cross(direction, shift)
        rotations.append((direction, centre, size * float(shift @ direction)))
    return translations, rotations


def describe_motions(points, translations, rotations):
    """Free motions in words: a list of str."""
    words = [f"translation along {_direction_name(direction)}" for direction in translations]
    size = np.linalg.norm(np.ptp(points, axis=0))
    for direction, centre, pitch in rotations:
        kind = "screw motion" if abs(pitch) > 1e-6 * size else "rotation"
        centre = np.where(np.abs(centre) > 1e-9 * size, centre, 0.0)
        through = ", ".join(f"{value:.4g}" for value in centre)
        words.append(f"{kind} about the {_axis_name(direction)} through ({through}) m")
    return words


def _held_rows(points, fixed):
    """The six motions (t, w), each in the held directions only: (k, 6)."""
    node, axis = np.nonzero(fixed)
    rows = np.zeros((len(node), 6))
    rows[np.arange(len(node)), axis] = 1.0
    x = points[node]
    row = np.arange(len(node))
    rows[row, 3 + (axis + 1) % 3] = x[row, (axis + 2) % 3]  # (w x x)_i = w_j x_k - w_k x_j
    rows[row, 3 + (axis + 2) % 3] = -x[row, (axis + 1) % 3]
    return rows


def _null_space(rows):
    """Orthonormal basis (k, 6) of the vectors that `rows` (m, 6) maps to zero."""
    if not len(rows):
        return np.eye(6)
    triangle = np.linalg.qr(rows, mode="r")
    _, values, right = np.linalg.svd(triangle, full_matrices=True)
    rank = int((values > RELATIVE_RANK * values[0]).sum())
    return right[rank:]


def _echelon(rows):
    """Reduced row echelon form: of all bases the one with the plainest directions."""
    rows = np.array(rows, dtype=float)
    for k, column in _pivots(rows):
        rows[k] /= rows[k, column]
        others = np.arange(len(rows)) != k
        rows[others] -= np.outer(rows[others, column], rows[k])
    rows[np.abs(rows) < 1e-9] = 0.0
    return rows


def _pivots(rows):
    """Yield (row, column), leftmost columns first, with the largest entry swapped into place."""
    k = 0
    for column in range(rows.shape[1]):
        if k == len(rows):
            return
        best = k + int(np.abs(rows[k:, column]).argmax())
        if abs(rows[best, column]) > 1e-8:
            rows[[k, best]] = rows[[best, k]]
            yield k, column
            k += 1


def _direction_name(direction):
    """`x`, `y`, `z`, or the vector's components."""
    unit = direction / np.linalg.norm(direction)
    axis = int(np.abs(unit).argmax())
    if abs(unit[axis]) > 1.0 - 1e-6:
        return AXES[axis]
    return "({:.3g}, {:.3g}, {:.3g})".format(*unit)


def _axis_name(direction):
    return f"axis parallel to {_direction_name(direction)}"
