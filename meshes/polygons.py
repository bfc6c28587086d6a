"""Polygons with any number of corners, cut into triangles."""

import numpy as np


def triangulate(points, sizes, corners):
    """Cut polygons into triangles (m, 3), in the order of the polygons.

    Parameters
    ----------
    points : (n, 3) float array
    sizes : (p,) int array
        Number of corners of each polygon; those with fewer than three are left out.
    corners : (sum of sizes,) int array
        The vertices of all polygons one after the other.

    Notes
    -----
    A convex polygon becomes a fan about its first corner, any other is cut ear by ear.
    """
    sizes, corners = np.asarray(sizes), np.asarray(corners)
    start = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    triangles, owner = [], []
    for size in np.unique(sizes[sizes >= 3]):
        which = np.flatnonzero(sizes == size)
        loops = corners[start[which, None] + np.arange(size)]
        fans = np.stack([_fan(loops, k) for k in range(size - 2)], axis=1)
        if size > 3:
            for index in np.flatnonzero(~_fan_is_right(points, loops, fans)):
                fans[index] = _cut_ears(points, loops[index])
        triangles.append(fans.reshape(-1, 3))
        owner.append(np.repeat(which, size - 2))
    if not triangles:
        return np.zeros((0, 3), dtype=np.int32)
    order = np.argsort(np.concatenate(owner), kind="stable")
    chosen = np.concatenate(triangles)[order]
    return np.clip(chosen, -1, np.iinfo(np.int32).max).astype(np.int32)  # no index wraps around


def _fan(loops, k):
    """Triangle k (p, 3) of the fan about the first corner."""
    return loops[:, [0, k + 1, k + 2]]


def _newell(points):
    """Normal (..., 3) of polygons (..., k, 3) with the length of twice their area (Newell)."""
    centred = points - points.mean(axis=-2, keepdims=True)
    return np.cross(centred, np.roll(centred, -1, axis=-2)).sum(axis=-2)


def _fan_is_right(points, loops, fans):
    """Polygons (p,) bool whose fan triangles all look the same way as the polygon."""
    inside = np.all((loops >= 0) & (loops < len(points)), axis=1)
    good = inside.copy()
    normal = _newell(points[loops[inside]])
    a, b, c = (points[fans[inside][..., k]] for k in range(3))
    facing = np.einsum("pkj,pj->pk", np.cross(b - a, c - a), normal)
    good[inside] = np.all(facing > 0, axis=1)
    return good | ~inside


def _cut_ears(points, loop):
    """Triangles (k - 2, 3) of one simple polygon (k,), cut ear by ear."""
    normal = _newell(points[loop])
    left, triangles = list(loop), []
    while len(left) > 3:
        ear = next((i for i in range(len(left)) if _is_ear(points, left, i, normal)), 0)
        before, after = left[ear - 1], left[(ear + 1) % len(left)]
        triangles.append((before, left[ear], after))
        del left[ear]
    triangles.append(tuple(left))
    return np.array(triangles)


def _is_ear(points, loop, i, normal):
    """Whether corner i is convex and no other corner of the loop lies in its triangle."""
    names = loop[i - 1], loop[i], loop[(i + 1) % len(loop)]
    a, b, c = (points[v] for v in names)

    def side(p, q, r):
        return np.cross(q - p, r - p) @ normal

    if side(a, b, c) <= 0:
        return False
    others = [points[v] for v in loop if v not in names]
    return not any(min(side(a, b, p), side(b, c, p), side(c, a, p)) >= 0 for p in others)
