"""Holes closed by the triangulation of least area.

Barequet & Sharir (1995); longer holes are halved first.
"""

import numpy as np

from meshes.edges import edge_table
from meshes.quality import face_areas
from meshes.topology import boundary_loops

LONGEST = 200  # edges of a hole that is triangulated at once
CRACK_EDGES = 64  # a longer hole is no crack
CRACK_AREA = 1e-4  # of the squared length around: a hole with less is a crack


def close_cracks(soup):
    """Close holes without area, as unequally divided edges leave them.

    Returns
    -------
    Soup
    count : int
    """
    return _fill(soup, lambda loop: len(loop) <= CRACK_EDGES, _is_crack)


def fill_holes(soup, size):
    """Close holes whose bounding box has a diagonal of at most `size`.

    Returns
    -------
    Soup
    count : int
    """

    def small(loop):
        return np.linalg.norm(np.ptp(soup.points[loop], axis=0)) <= size

    return _fill(soup, small, lambda points, faces: True)


def _is_crack(points, faces):
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    rim = unique[count == 1]
    around = np.linalg.norm(points[rim[:, 0]] - points[rim[:, 1]], axis=1).sum()
    return face_areas(points, faces).sum() <= CRACK_AREA * around**2


def _fill(soup, chosen, accepted):
    """Close the loops chosen by `chosen(loop)` if `accepted(points, new faces)`."""
    table = edge_table(soup.faces)
    if np.all(table.count != 1):
        return soup, 0
    rim = np.zeros(len(soup.points), dtype=bool)
    rim[table.edges[table.count == 1]] = True
    taken = {tuple(edge) for edge in table.edges[rim[table.edges].all(axis=1)].tolist()}
    faces, labels = [], []
    for loop in boundary_loops(soup.faces):
        if not chosen(loop):
            continue
        new = _triangulated(soup.points, loop[::-1].astype(np.int64), taken)
        if new is None or not accepted(soup.points, new):
            continue
        if len(loop) == 3 and (np.isin(soup.faces, loop).all(axis=1)).any():
            continue  # a face on its own: it has a rim, but no hole
        taken.update(_edges(new))
        faces.append(new)
        labels.append(np.full(len(new), _label_beside(soup, table, loop)))
    if not faces:
        return soup, 0
    return soup.added(np.concatenate(faces), np.concatenate(labels)), len(faces)


def _edges(faces):
    pairs = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return {tuple(edge) for edge in pairs.tolist()}


def _label_beside(soup, table, loop):
    """The most common label of the faces along a loop."""
    at_loop = np.isin(table.edges, loop).all(axis=1) & (table.count == 1)
    beside = table.half_edges[table.start[:-1][at_loop]] // 3
    return np.bincount(soup.labels[beside]).argmax()


def _triangulated(points, loop, taken):
    """Faces (k - 2, 3) inside a loop (k,) of vertices, or None if every one needs a taken edge."""
    if len(loop) > LONGEST:
        return _halved(points, loop, taken)
    corners = points[loop]
    scale = np.ptp(corners, axis=0).max()
    split = _least_area(corners / (scale if scale > 0 else 1.0), _forbidden(loop, taken))
    if split is None:
        return None
    faces, stack = [], [(0, len(loop) - 1)]
    while stack:
        i, k = stack.pop()
        if k - i < 2:
            continue
        j = split[i, k]
        faces.append((loop[i], loop[j], loop[k]))
        stack += [(i, j), (j, k)]
    return np.array(faces, dtype=np.int64)


def _forbidden(loop, taken):
    """Chords (k, k) bool that are edges of the surface already."""
    place = {vertex: i for i, vertex in enumerate(loop.tolist())}
    result = np.zeros((len(loop), len(loop)), dtype=bool)
    inside = set(place)
    for a, b in taken:
        if a in inside and b in inside:
            i, k = sorted((place[a], place[b]))
            result[i, k] = k - i > 1 and k - i < len(loop) - 1
    return result


def _least_area(corners, forbidden):
    """The middle corner (k, k) of the best triangle on every chord, or None if there is none."""
    count = len(corners)
    cost = np.zeros((count, count))
    split = np.zeros((count, count), dtype=np.int64)
    for gap in range(2, count):
        i = np.arange(count - gap)
        k = i + gap
        j = i[:, None] + np.arange(1, gap)
        first = corners[j] - corners[i][:, None]
        area = 0.5 * np.linalg.norm(np.cross(first, (corners[k] - corners[i])[:, None]), axis=2)
        total = cost[i[:, None], j] + cost[j, k[:, None]] + area
        best = np.argmin(total, axis=1)
        split[i, k] = j[i, best]
        cost[i, k] = np.where(forbidden[i, k], np.inf, total[i, best])
    return split if np.isfinite(cost[0, -1]) else None


def _halved(points, loop, taken):
    """A long loop is cut by its best chord: short for the way around it saves."""
    count = len(loop)
    corners = points[loop]
    step = max(1, count // 400)
    ends = np.arange(0, count, step)
    away = np.linalg.norm(corners[ends][:, None] - corners[ends][None], axis=2)
    between = np.abs(ends[:, None] - ends[None])
    between = np.minimum(between, count - between)
    away[between < count // 4] = np.inf
    for flat in np.argsort(away, axis=None)[:50]:
        i, k = sorted(int(ends[n]) for n in divmod(int(flat), len(ends)))
        chord = tuple(sorted((int(loop[i]), int(loop[k]))))
        if chord in taken:
            continue
        parts = [
            _triangulated(points, part, taken | {chord})
            for part in (loop[i : k + 1], np.concatenate([loop[k:], loop[: i + 1]]))
        ]
        if all(part is not None for part in parts):
            return np.concatenate(parts)
    return None
