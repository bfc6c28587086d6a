"""Faces that cross others, where the surface is folded, drawn apart by local smoothing."""

import numpy as np
from scipy.sparse import coo_matrix

from meshes.edges import components, edge_table
from meshes.self_intersection import self_intersecting_faces

FACTORS = (0.02, 0.1, 0.3) + (0.5,) * 17  # how far vertices move to the mean of their neighbours
PATIENCE = 3  # rounds without fewer faces that cross, after which no more are made
WORTH_IT = 0.02  # part of the faces that cross which may be left of a patch that was smoothed
RINGS = 1  # neighbours that are smoothed with them


def separate(points, faces, crossing, held):
    """Smooth around faces that meet others, as long as these become fewer.

    Parameters
    ----------
    points : (n, 3) float array
    faces : (m, 3) int array
        Manifold.
    crossing : (m,) bool array
        Faces that meet others.
    held : (n,) bool array
        Vertices that must stay.

    Returns
    -------
    points : (n, 3) float array
        The same ones unless faces were separated; patches where this fails have not moved.
    before, after : int
        Faces that meet others.
    """
    before = int(crossing.sum())
    if before == 0:
        return points, 0, 0
    moved = _smoothed(points, faces, crossing, held)
    moved = _undone(points, moved, faces, crossing)
    after = int(self_intersecting_faces(moved, faces).sum())
    return (moved, before, after) if after < before else (points, before, before)


def _smoothed(points, faces, crossing, held):
    """Points after rounds of smoothing around the faces that cross in each."""
    table = edge_table(faces)
    edges, mean = table.edges, _means(table, len(points))
    chosen = np.zeros(len(points), dtype=bool)
    result, counts = points, [int(crossing.sum())]
    for factor in FACTORS:
        chosen[faces[crossing]] = True
        wider = chosen.copy()
        for _ in range(RINGS):
            wider[edges[wider[edges].any(axis=1)]] = True
        wider &= ~held
        target = result.copy()
        target[wider] += factor * (mean[wider] @ result - result[wider])
        result = target
        crossing = self_intersecting_faces(result, faces)
        counts.append(int(crossing.sum()))
        if counts[-1] == 0 or min(counts[-PATIENCE:]) >= min(counts[:-PATIENCE], default=np.inf):
            break
    return result


def _means(table, size):
    """The matrix that takes the means of neighbours; vertices of open edges have only those along
    these, so that open boundaries stay curves of their own."""
    border = np.zeros(size, dtype=bool)
    border[table.edges[table.count == 1]] = True
    ends = np.concatenate([table.edges, table.edges[:, ::-1]])
    ends = ends[np.tile(table.count == 1, 2) | ~border[ends[:, 0]]]
    degree = np.maximum(np.bincount(ends[:, 0], minlength=size), 1)
    return coo_matrix((1.0 / degree[ends[:, 0]], tuple(ends.T)), (size, size)).tocsr()


def _undone(points, moved, faces, crossing):
    """Points moved, but for the patches in which not nearly all faces that crossed are apart.

    crossing : (m,) bool array
        Faces that crossed at first.
    """
    change = (points != moved).any(axis=1)
    touched = change[faces].any(axis=1)
    _, patch = components(faces[touched][:, :2].ravel(), faces[touched][:, 1:].ravel(), len(points))
    for _ in range(10):
        bad = self_intersecting_faces(moved, faces) & touched
        if not bad.any():
            break
        left, before = (
            np.bincount(patch[faces[f, 0]], minlength=len(points)) for f in (bad, crossing)
        )
        back = (left > WORTH_IT * before)[patch]
        if not back.any():
            break
        moved = np.where(back[:, None], points, moved)
        touched &= ~back[faces].any(axis=1)
    return moved
