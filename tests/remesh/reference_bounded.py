"""Slow, obvious twins of the kernels of the error bound, and checks of its bookkeeping."""

import itertools

import numpy as np

from meshes.topology import topology
from tests.remesh.reference import closest_on_triangle


def closest_on_segment(point, a, b):
    """Closest point of a segment, which may be a point."""
    square = (b - a) @ (b - a)
    s = np.clip((point - a) @ (b - a) / square, 0.0, 1.0) if square > 0.0 else 0.0
    return a + s * (b - a)


def closest_on_thin_triangle(point, corners):
    """As `closest_on_triangle`, also for triangles without area."""
    a, b, c = corners
    candidates = [closest_on_segment(point, p, q) for p, q in ((a, b), (b, c), (c, a))]
    if np.linalg.norm(np.cross(b - a, c - a)) > 1e-9 * np.ptp(corners) ** 2:
        candidates.append(closest_on_triangle(point, corners))
    return min(candidates, key=lambda x: np.sum((x - point) ** 2))


def height_over_edge(corners):
    """Smallest height over longest edge of a triangle, and its longest edge squared."""
    lengths = [np.linalg.norm(corners[k] - corners[k - 1]) for k in range(3)]
    area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) / 2.0
    return 2.0 * area / max(lengths) / max(lengths), max(lengths) ** 2


def on_boundary(faces, v):
    """Whether an edge at v has one face."""
    around = [set(face) for face in faces if v in face]
    others = [w for face in around for w in face - {v}]
    return any(others.count(w) == 1 for w in others)


def is_lean(faces, v):
    """Whether a vertex has at most three faces around it, or one on a boundary."""
    count = sum(v in face for face in faces)
    return count <= (1 if on_boundary(faces, v) else 3)


def neighbours(faces, v):
    """Vertices that share a face with v."""
    return {int(w) for face in faces if v in face for w in face} - {int(v)}


def joined(faces, u, v):
    """Whether an edge joins u and v."""
    return int(v) in neighbours(faces, u)


def link_allows(faces, u, v):
    """Whether u and v have no common neighbours but those across their edge's faces."""
    tops = {int(w) for f in faces if u in f and v in f for w in f} - {int(u), int(v)}
    return neighbours(faces, u) & neighbours(faces, v) == tops


def listed(head, after, face):
    """Samples of a face."""
    found, s = [], head[face]
    while s >= 0:
        found.append(int(s))
        s = after[s]
    return found


def star_corners(work, x, fan):
    """Corners (k, 3, 3) of a fan's triangles with their vertex at x."""
    return [np.array([x, work.state[6][row[1]], work.state[6][row[2]]]) for row in fan]


def curves_of_fan(work, x, fan):
    """The feature edges (triangle of the fan, end, end) of a fan's triangles."""
    for i, (row, (a, b, c)) in enumerate(zip(fan, star_corners(work, x, fan), strict=True)):
        for marked, ends in zip(row[3:6], ((a, b), (b, c), (c, a)), strict=True):
            if marked:
                yield i, *ends


def nearest_curve(work, v, fan, point):
    """Squared distance of a point from the feature edges of a fan; None if there are none."""
    hub = work.state[6][v]
    squares = [
        np.sum((point - closest_on_segment(point, a, b)) ** 2)
        for _, a, b in curves_of_fan(work, hub, fan)
    ]
    return min(squares, default=None)


def measure(work, v, fan, samples, limit2):
    """Sum of (squared distance / allowed)^2, None if one is too far; {triangle: square} of each."""
    _, _, place, on_curve, _, share, _ = work.samples
    hub, total, nearest = work.state[6][v], 0.0, {}
    for s in samples:
        if on_curve[s]:
            found = {}
            for i, a, b in curves_of_fan(work, hub, fan):
                square = np.sum((place[s] - closest_on_segment(place[s], a, b)) ** 2)
                found[i] = min(found.get(i, np.inf), square)
        else:
            found = {
                i: np.sum((place[s] - closest_on_thin_triangle(place[s], corners)) ** 2)
                for i, corners in enumerate(star_corners(work, hub, fan))
            }
        if not found or min(found.values()) > limit2 * share[s]:
            return None, nearest
        nearest[s] = found
        total += (min(found.values()) / (limit2 * share[s])) ** 2
    return total, nearest


def nearest_places(source, point):
    """Squared distance of a mesh from a point, and [(face, point of it)] of all that are as near.

    All faces are tried whose corners less their edges are no farther than the nearest corner.
    """
    corners = source.points[source.faces]
    reach = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    away = np.linalg.norm(corners - point, axis=2).min(axis=1)
    near = np.flatnonzero(away - reach <= away.min())
    found = [(f, closest_on_thin_triangle(point, corners[f])) for f in near]
    squares = np.array([np.sum((x - point) ** 2) for _, x in found])
    equal = np.flatnonzero(squares <= squares.min() * (1 + 1e-9) + 1e-20)
    return squares.min(), [found[k] for k in equal]


def distance(source, point):
    """Distance of a mesh from a point."""
    return np.sqrt(nearest_places(source, point)[0])


def inverted(source, normals, corners, least=0.05):
    """Whether a triangle lies against the original at its centroid: a set of answers.

    Where several faces are equally near each has its own.
    """
    own = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    own = own / np.linalg.norm(own)
    answers = set()
    for f, x in nearest_places(source, corners.mean(axis=0))[1]:
        a, b, c = source.points[source.faces[f]]
        weights = np.linalg.lstsq(
            np.stack([np.append(p, 1.0) for p in (a, b, c)], axis=1), np.append(x, 1.0), rcond=None
        )[0]
        smooth = weights @ normals[f]
        answers.add(
            bool(
                own @ np.cross(b - a, c - a) < 0.0 or own @ smooth < least * np.linalg.norm(smooth)
            )
        )
    return answers


def farthest(source, corners):
    """Largest distance of a triangle's corners, centroid and middles of edges from a mesh."""
    middles = [0.5 * (corners[k] + corners[k - 1]) for k in range(3)]
    return max(distance(source, p) for p in (*corners, *middles, corners.mean(axis=0)))


def farthest_inside(source, corners):
    """Largest distance of the first corner, of points along the first edge, and of the centroid."""
    spoke = [corners[0] + s * (corners[1] - corners[0]) for s in (0.0, 0.3, 0.7)]
    return max(distance(source, p) for p in (*spoke, corners.mean(axis=0)))


def best_move(work, corners, samples, found, limit2, base=0.05, damping=0.05):
    """Move of the first corners that fits the samples' planes best, by least squares."""
    _, _, place, _, _, share, _ = work.samples
    matrix, right = np.zeros((3, 3)), np.zeros(3)
    for s in samples:
        a, b, c = corners[found[s]]
        x = closest_on_thin_triangle(place[s], corners[found[s]])
        weight_of_a = np.linalg.lstsq(
            np.stack([np.append(p, 1.0) for p in (a, b, c)], axis=1), np.append(x, 1.0), rcond=None
        )[0][0]
        if weight_of_a <= 1e-12:
            continue
        normal = np.cross(b - a, c - a)
        normal = normal / np.linalg.norm(normal)
        weight = base + np.sum((place[s] - x) ** 2) / (limit2 * share[s])
        matrix += weight * weight_of_a**2 * np.outer(normal, normal)
        right += weight * weight_of_a * ((place[s] - x) @ normal) * normal
    return np.linalg.solve(matrix + damping * np.trace(matrix) * np.eye(3), right)


def broken_bounded(work):
    """Everything that is inconsistent in a bounded mesh's arrays, in words (empty if fine)."""
    corner, twin, crease, _, first, _, _, _, _ = work.state
    wrong, after = [], lambda h: h - 2 if h % 3 == 2 else h + 1
    alive = [h for h in range(3 * work.counts[1]) if corner[h] >= 0]
    for h in alive:
        g = twin[h]
        if first[corner[h]] < 0:
            wrong.append(f"half-edge {h} leaves a dead vertex")
        if g < 0:
            continue
        if twin[g] != h or corner[h] != corner[after(g)] or corner[g] != corner[after(h)]:
            wrong.append(f"half-edges {h} and {g} are no twins")
        if crease[h] != crease[g]:
            wrong.append(f"half-edges {h} and {g} do not agree on being a feature")
    for v in np.flatnonzero(first[: work.counts[0]] >= 0):
        if corner[first[v]] != v:
            wrong.append(f"the first half-edge of vertex {v} leaves another one")
    seen = [listed(work.samples[0], work.samples[1], f) for f in sorted({h // 3 for h in alive})]
    seen = sorted(itertools.chain.from_iterable(seen))
    if seen != list(range(len(work.samples[2]))):
        wrong.append(f"{len(seen)} samples are listed, {len(set(seen))} of them once")
    mesh, _ = work.to_mesh()
    found = topology(mesh.faces, len(mesh.points))
    if not (found.manifold and found.oriented):
        wrong.append(f"not an oriented manifold: {found}")
    return wrong


def slow_shape(points, normals, sigma2, floor, floor3):
    """`bounded_shape_kernels.triangle_cost` of corners (3, 3) with unit normals, inside of patches.

    Angles by the cosine theorem, in degrees.
    """

    def least(weight):
        edge = np.zeros((3, 3))
        for i in range(3):
            for j in range(3):
                step, turn = points[i] - points[j], normals[i] - normals[j]
                edge[i, j] = np.sqrt(step @ step + weight * (turn @ turn))
        angles = []
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            cosine = (edge[i, j] ** 2 + edge[i, k] ** 2 - edge[j, k] ** 2) / (
                2.0 * edge[i, j] * edge[i, k]
            )
            angles.append(np.degrees(np.arccos(cosine)))
        return min(angles)

    angle = least(sigma2)
    slack = angle / floor
    if sigma2 > 0.0:
        slack = min(slack, least(0.0) / floor3)
    return ((60.0 - angle) / 30.0) ** 2 + 20.0 * max(1.0 - slack, 0.0) ** 2, slack
