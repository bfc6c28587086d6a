"""Coincident vertices of open edges made one, and faces that are there more than once."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from meshes.edges import components, edge_table
from meshes.soup import naming_a_vertex_twice
from meshes.topology import count_repeated

NEAR = 1e-6  # of the bounding-box diagonal: vertices of open edges nearer than this are one
NEAR_EDGE = 0.2  # of the shortest open edge at either vertex: but no nearer than this


def weld_equal(soup):
    """Make one vertex of those of open edges that have the very same coordinates.

    Vertices inside the surface are left as they are: two sheets may touch.

    Returns
    -------
    Soup
    count : int
        Vertices that were given up.
    """
    open_vertices = _open_vertices(soup.faces)
    points = soup.points[open_vertices] + 0.0  # no negative zero
    order = np.lexsort(points.T)
    same = (points[order[1:]] == points[order[:-1]]).all(axis=1)
    return _merged(soup, open_vertices[order[1:]][same], open_vertices[order[:-1]][same])


def weld_near(soup):
    """Make one vertex of those of open edges nearly at the same place, where that closes gaps.

    Returns
    -------
    Soup
        The same one unless fewer edges are open then, and no more have three faces or more.
    count : int
    """
    table = edge_table(_distinct(soup.faces))
    edges = table.edges[table.count == 1]
    if len(edges) == 0:
        return soup, 0
    vertices = np.unique(edges)
    lengths = np.linalg.norm(soup.points[edges[:, 0]] - soup.points[edges[:, 1]], axis=1)
    shortest = np.full(len(soup.points), np.inf)
    for end in (0, 1):
        np.minimum.at(shortest, edges[:, end], np.where(lengths > 0, lengths, np.inf))
    used = soup.points[np.unique(soup.faces)]
    reach = NEAR * np.linalg.norm(np.ptp(used, axis=0))
    if not 0 < reach < np.inf:
        return soup, 0
    pairs = cKDTree(soup.points[vertices] / reach).query_pairs(1.0, output_type="ndarray")
    first, second = vertices[pairs[:, 0]], vertices[pairs[:, 1]]
    distance = np.linalg.norm(soup.points[first] - soup.points[second], axis=1)
    chosen = distance < NEAR_EDGE * np.minimum(shortest[first], shortest[second])
    welded, count = _merged(soup, first[chosen], second[chosen])
    if count == 0 or not _better(table.count, edge_table(_distinct(welded.faces)).count):
        return soup, 0
    return welded, count


def _better(before, after):
    fewer_open = np.count_nonzero(after == 1) < np.count_nonzero(before == 1)
    return fewer_open and np.count_nonzero(after > 2) <= np.count_nonzero(before > 2)


def _open_vertices(faces):
    """Vertices (k,) of the edges with one face."""
    table = edge_table(_distinct(faces))
    return np.unique(table.edges[table.count == 1])


def _by_vertices(faces):
    """Faces (m, 3) with sorted corners, and group (m,): equal where all three vertices are."""
    ordered = np.sort(faces, axis=1)
    _, group = np.unique(ordered, axis=0, return_inverse=True)
    return ordered, group.ravel()


def _distinct(faces):
    """Every face once: a copy would hide that an edge is open."""
    return faces if count_repeated(faces) == 0 else np.unique(np.sort(faces, axis=1), axis=0)


def _merged(soup, first, second):
    """Every set of vertices linked by pairs becomes the first of them."""
    if len(first) == 0:
        return soup, 0
    size = len(soup.points)
    count, group = components(first, second, size)
    representative = np.full(count, size)
    np.minimum.at(representative, group, np.arange(size))
    kept = representative[group]
    soup = replace(soup, faces=kept[soup.faces], origin=soup.origin[kept])
    return soup.keep(~naming_a_vertex_twice(soup.faces)), size - count


def drop_repeated(soup):
    """Drop faces that repeat the three vertices of another one.

    Of copies with the same orientation one is left. Two that lie back to back are both dropped if
    that leaves fewer edges without exactly two faces (a wall inside), else one of them is.

    Returns
    -------
    Soup
    count : int
        Faces dropped.
    """
    if count_repeated(soup.faces) == 0:
        return soup, 0
    ordered, group = _by_vertices(soup.faces)
    size = np.bincount(group)
    sign = np.where((soup.faces == ordered).sum(axis=1) == 1, -1, 1)  # an odd permutation
    balance = np.bincount(group, sign)
    unlike = sign != np.where(balance < 0, -1, 1)[group]
    order = np.lexsort((unlike, group))
    kept = np.zeros(len(ordered), dtype=bool)
    kept[order[np.searchsorted(group[order], np.arange(len(size)))]] = True
    walls = kept & (balance[group] == 0) & (size[group] > 1)
    kept[_useless(soup.faces, kept, walls)] = False
    return soup.keep(kept), int(np.count_nonzero(~kept))


def drop_pillows(soup):
    """Drop pairs of faces of a manifold surface that have all three vertices in common.

    Returns
    -------
    Soup
    count : int
        Faces dropped.
    """
    if count_repeated(soup.faces) == 0:
        return soup, 0
    _, group = _by_vertices(soup.faces)
    kept = np.bincount(group)[group] == 1
    return soup.keep(kept), int(np.count_nonzero(~kept))


def _useless(faces, kept, walls):
    """Walls (k,) without which fewer edges have a number of faces other than two."""
    numbers = np.flatnonzero(walls)
    table = edge_table(faces[kept])
    total = table.count
    row = np.cumsum(kept) - 1
    wall_edges = table.face_edges[row[numbers]]
    inside = np.bincount(wall_edges.ravel(), minlength=len(total))
    pieces, piece = _edge_connected(wall_edges, len(total))
    edges = np.unique(wall_edges)
    owner = np.zeros(len(total), dtype=np.int64)
    owner[wall_edges] = piece[:, None]
    left = total[edges] - inside[edges]
    gain = (total[edges] != 2).astype(int) - ((left != 0) & (left != 2))
    return numbers[np.bincount(owner[edges], gain, minlength=pieces)[piece] > 0]


def _edge_connected(face_edges, n_edges):
    """Pieces of faces (k, 3), given by their edges, that share edges: count, piece (k,)."""
    count = len(face_edges)
    rows = np.repeat(np.arange(count), 3)
    columns = count + face_edges.ravel()
    _, label = components(rows, columns, count + n_edges)
    names, piece = np.unique(label[:count], return_inverse=True)
    return len(names), piece.ravel()
