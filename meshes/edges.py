"""The edges of a triangulation, and what hangs together across them.

Half-edge 3 f + k of face f runs from its corner k to its corner k + 1 (modulo 3).
"""

from dataclasses import dataclass

import numpy as np

from meshes.errors import InvalidMesh
from meshes.topology_kernels import counting_sort, number_components, number_edges


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """The edges of a triangulation and the half-edges on each.

    Parameters
    ----------
    edges : (e, 2) int32 array
        The two vertices of every edge, the smaller number first; sorted.
    face_edges : (m, 3) int32 array
        The edge of each half-edge.
    half_edges : (3 m,) int64 array
        All half-edges, ordered by edge.
    start : (e + 1,) int64 array
        The half-edges of edge i are half_edges[start[i]:start[i + 1]].
    """

    edges: np.ndarray
    face_edges: np.ndarray
    half_edges: np.ndarray
    start: np.ndarray

    @property
    def count(self):
        """Number of faces at every edge (e,)."""
        return np.diff(self.start)

    def face_pairs(self):
        """Edges with exactly two faces (p,), and their faces (p, 2)."""
        inner = np.flatnonzero(self.count == 2)
        first = self.half_edges[self.start[inner]]
        second = self.half_edges[self.start[inner] + 1]
        return inner, np.stack([first // 3, second // 3], axis=1)


def check_indices(faces, n_points):
    """Raise InvalidMesh if faces (m, 3) refer to points outside 0 ... n_points - 1."""
    bad = np.count_nonzero((faces < 0) | (faces >= n_points))
    if bad:
        raise InvalidMesh(
            f"{bad} face corners refer to points that do not exist (there are {n_points} points)"
        )


def edge_table(faces):
    """Return the EdgeTable of faces (m, 3)."""
    faces = np.asarray(faces, dtype=np.int32).reshape(-1, 3)
    after = faces[:, [1, 2, 0]]
    low, high = np.minimum(faces, after).ravel(), np.maximum(faces, after).ravel()
    room = int(faces.max(initial=-1)) + 2
    order, other = np.arange(low.size), np.empty(low.size, dtype=np.int64)
    counting_sort(high, order, np.zeros(room, dtype=np.int64), other)
    counting_sort(low, other, np.zeros(room, dtype=np.int64), order)
    edge_of, first = np.empty(low.size, dtype=np.int32), other
    count = number_edges(low, high, order, edge_of, first)
    start = np.append(first[:count], low.size)
    pick = order[start[:-1]]
    edges = np.stack([low[pick], high[pick]], axis=1)
    return EdgeTable(edges, edge_of.reshape(-1, 3), order, start)


def _corner_ends(faces, half_edges):
    """Corners (h,) of half-edges at the lower- and at the higher-numbered end of their edge."""
    corner = half_edges
    after = half_edges + np.where(half_edges % 3 == 2, -2, 1)
    flat = faces.ravel()
    forward = flat[corner] <= flat[after]
    return np.where(forward, corner, after), np.where(forward, after, corner)


def corner_groups(faces, joined=None, table=None):
    """Number the corners so that those joined across edges around one vertex share a number.

    Parameters
    ----------
    faces : (m, 3) int array
    joined : (e,) bool array, optional
        Edges across which corners are joined; all if not given.
    table : EdgeTable, optional

    Returns
    -------
    group : (m, 3) int array
        Without `joined` there is one group per vertex and fan of faces.
    count : int
    """
    faces = np.asarray(faces)
    table = edge_table(faces) if table is None else table
    half = table.half_edges
    edge = table.face_edges.ravel()[half]
    same = edge[1:] == edge[:-1]
    if joined is not None:
        same &= joined[edge[1:]]
    low, high = _corner_ends(faces, half)
    rows = np.concatenate([low[:-1][same], high[:-1][same]])
    columns = np.concatenate([low[1:][same], high[1:][same]])
    count, group = components(rows, columns, faces.size)
    return group.reshape(-1, 3), count


def components(rows, columns, size):
    """Connected components of the graph with edges (rows, columns) on `size` nodes.

    Returns
    -------
    count : int
    label : (size,) int32 array
        Components are numbered by their first nodes.
    """
    parent = np.arange(size, dtype=np.int32)
    label = np.empty(size, dtype=np.int32)
    rows, columns = (np.ascontiguousarray(side, dtype=np.int32) for side in (rows, columns))
    return number_components(rows, columns, parent, label), label


def face_components(faces):
    """Number the connected pieces (faces that share a vertex): count, label of each face (m,)."""
    faces = np.asarray(faces, dtype=np.int64)
    size = int(faces.max(initial=-1)) + 1
    rows, columns = faces[:, :2].ravel(), faces[:, 1:].ravel()
    _, label = components(rows, columns, size)
    of_face = label[faces[:, 0]]
    used = np.zeros(size, dtype=bool)
    used[of_face] = True
    return int(used.sum()), (np.cumsum(used) - 1)[of_face]
