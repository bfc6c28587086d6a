"""Surfaces cut where more than two faces meet at an edge, or separate fans at a vertex.

The faces at such an edge are joined two by two and the edge doubled: cutting and stitching
(Gueziec, Taubin, Lazarus & Horn 1998). Each pair bounds one sector of material, so that two bodies
that touch along an edge become two bodies.
"""

from dataclasses import replace

import numpy as np

from meshes.edges import components, corner_groups, edge_table, face_components
from meshes.quality import face_areas
from meshes.soup import opposite_ends

DANGLING = (0.01, 0.05)  # of all faces, of the area: smaller open pieces set free are dropped


def cut(soup):
    """Cut a surface until it is manifold.

    Returns
    -------
    Soup
    edges : int
        Edges that had more than two faces.
    vertices : int
        Other vertices at which separate fans of faces met.
    dangling : int
        Faces dropped: small open pieces that hung on such edges.
    """
    table = edge_table(soup.faces)
    crowded = table.count > 2
    if not crowded.any() and corner_groups(soup.faces, table=table)[1] == len(
        np.unique(soup.faces)
    ):
        return soup, 0, 0, 0
    pairs, lonely = _pairs(soup, table)
    result = _stitched(soup, table, pairs)
    copies = np.bincount(_source(soup, result), minlength=len(soup.points))
    copies[table.edges[crowded]] = 0
    result = _halved(result)
    kept = _without_dangling(result, lonely)
    dropped = len(kept) - np.count_nonzero(kept)
    return result.keep(kept), int(crowded.sum()), int(np.count_nonzero(copies > 1)), int(dropped)


def _source(soup, result):
    """The vertex of `soup` each vertex of `result` was copied from."""
    source = np.empty(len(result.points), dtype=np.int64)
    source[result.faces.ravel()] = soup.faces.ravel()
    return source


def _pairs(soup, table):
    """Half-edges joined at every edge (p, 2), and faces that found no partner at a crowded one."""
    whole = np.flatnonzero(table.count == 2)
    start = table.start[whole]
    pairs = [np.stack([table.half_edges[start], table.half_edges[start + 1]], axis=1)]
    lonely = []
    for edge in np.flatnonzero(table.count > 2):
        half = table.half_edges[table.start[edge] : table.start[edge + 1]]
        joined = _sectors(soup, table.edges[edge], half)
        pairs.append(half[joined])
        lonely.extend(np.delete(half, joined.ravel()) // 3)
    return np.concatenate(pairs), np.array(lonely, dtype=np.int64)


def _sectors(soup, edge, half):
    """Which of an edge's half-edges (k,) belong together: indices (p, 2)."""
    low, high = soup.points[edge]
    ends, _ = opposite_ends(soup.faces, half)
    forward = ends == edge[0]
    flat = soup.faces.ravel()
    before = half + np.where(half % 3 == 0, 2, -1)
    angle = _angles_about(low, high, soup.points[flat[before]])
    order = np.argsort(angle, kind="stable")
    if 2 * np.count_nonzero(forward) == len(half):
        return order[_brackets(forward[order])]
    if len(half) % 2 == 0:
        return order[_thinner(angle[order])]
    return _straightest(angle, forward)


def _angles_about(low, high, points):
    """Angles (k,) of points about the axis from low to high."""
    axis = (high - low) / max(np.linalg.norm(high - low), 1e-300)
    away = points - low
    away = away - np.outer(away @ axis, axis)
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    return np.arctan2(away @ np.cross(axis, across), away @ across)


def _brackets(closing):
    """Pairs (p, 2) of matching brackets on a circle.

    Material lies behind a face that runs forward along the edge (seen with growing angle), and
    before one that runs backward: the latter opens a sector, the former closes it.
    """
    depth = np.cumsum(np.where(closing, -1, 1))
    begin = int(np.argmin(depth)) + 1
    pairs, open_ones = [], []
    for index in np.roll(np.arange(len(closing)), -begin):
        if closing[index]:
            pairs.append((open_ones.pop(), index))
        else:
            open_ones.append(index)
    return np.array(pairs)


def _thinner(angles):
    """Neighbours (p, 2) on the circle, in the one of two ways that has the narrower sectors."""
    count = len(angles)
    gaps = np.append(np.diff(angles), angles[0] + 2.0 * np.pi - angles[-1])
    begin = 0 if gaps[::2].sum() <= gaps[1::2].sum() else 1
    first = np.arange(begin, count, 2)
    return np.stack([first, (first + 1) % count], axis=1)


def _straightest(angles, forward):
    """The one pair (1, 2) that goes on most nearly straight, if possible oriented alike."""
    i, j = np.triu_indices(len(angles), 1)
    turn = np.abs(np.pi - np.abs(angles[i] - angles[j])) + 10.0 * (forward[i] == forward[j])
    best = int(np.argmin(turn))
    return np.array([[i[best], j[best]]])


def _stitched(soup, table, pairs):
    """One vertex for every set of corners linked across joined half-edges."""
    faces = soup.faces
    rows, columns = [], []
    half_end = np.arange(faces.size) + np.where(np.arange(faces.size) % 3 == 2, -2, 1)
    flat = faces.ravel()
    first, second = pairs.T
    alike = flat[first] == flat[second]
    for here, there in (
        (first, np.where(alike, second, half_end[second])),
        (half_end[first], np.where(alike, half_end[second], second)),
    ):
        rows.append(here)
        columns.append(there)
    count, group = components(np.concatenate(rows), np.concatenate(columns), faces.size)
    vertex = np.empty(count, dtype=np.int64)
    vertex[group] = flat
    order = np.argsort(vertex, kind="stable")  # copies stay in the order of their originals
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    source = vertex[order]
    return replace(
        soup,
        points=soup.points[source],
        origin=soup.origin[source],
        faces=rank[group].reshape(-1, 3),
    )


def _halved(soup):
    """Crowded edges that cannot be doubled, as their ends hang together elsewhere, get middles.

    Every pair of faces gets a vertex of its own in the middle of the edge.
    """
    for _ in range(100):
        table = edge_table(soup.faces)
        crowded = np.flatnonzero(table.count > 2)
        if len(crowded) == 0:
            break
        soup = _with_middles(soup, table, crowded)
    return soup


def _with_middles(soup, table, crowded):
    """Split the faces at crowded edges, each face at one of them."""
    points, origin, faces = [soup.points], [soup.origin], soup.faces.copy()
    more, parents, taken, count = [], [], set(), len(soup.points)
    for edge in crowded:
        half = table.half_edges[table.start[edge] : table.start[edge + 1]]
        if taken.intersection((half // 3).tolist()):
            continue
        taken.update((half // 3).tolist())
        joined = half[_sectors(soup, table.edges[edge], half)]
        alone = np.setdiff1d(half, joined.ravel())
        for members in [*joined, *alone[:, None]]:
            points.append(soup.points[table.edges[edge]].mean(axis=0)[None])
            origin.append([-1 - count])
            for one in members:
                face, corner = divmod(int(one), 3)
                second = faces[face].copy()
                second[corner] = count
                faces[face, (corner + 1) % 3] = count
                more.append(second)
                parents.append(face)
            count += 1
    soup = replace(soup, points=np.concatenate(points), origin=np.concatenate(origin), faces=faces)
    turned = np.concatenate([soup.turned, soup.turned[parents]])
    return replace(soup.added(np.array(more), soup.labels[parents]), turned=turned)


def _without_dangling(soup, lonely):
    """Faces (m,) bool without the small open pieces that the cut set free."""
    kept = np.ones(len(soup.faces), dtype=bool)
    if len(lonely) == 0:
        return kept
    pieces, piece = face_components(soup.faces)
    area = face_areas(soup.points, soup.faces)
    few = np.bincount(piece) <= DANGLING[0] * len(piece)
    small = np.bincount(piece, area) <= DANGLING[1] * area.sum()
    free = np.zeros(pieces, dtype=bool)
    free[piece[lonely]] = True
    kept[(few & small & free)[piece]] = False
    return kept
