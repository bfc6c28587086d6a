"""Slow, obvious twins of the kernels in remesh/, and checks of a work mesh's bookkeeping."""

import itertools

import numpy as np

from meshes.topology import topology
from remesh.connectivity import BASE, CREASE, EDGES, ORIGIN, OTHER, OUT, TRIANGLES, TWIN
from remesh.embedding import embedded_area


def squared_length(a, b, sigma):
    """|Psi(a) - Psi(b)|^2 of two lines (position, normal)."""
    return np.sum((a[:3] - b[:3]) ** 2) + sigma**2 * np.sum((a[3:6] - b[3:6]) ** 2)


def smallest_angle(a, b, c):
    """Smallest angle [degrees] of a triangle with corners in any dimension, by the cosine."""
    angles = []
    for p, q, r in ((a, b, c), (b, c, a), (c, a, b)):
        u, v = q - p, r - p
        cosine = u @ v / np.sqrt((u @ u) * (v @ v))
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return min(angles)


def agreement(lines):
    """Least cosine between a triangle's normal and the normals at its corners (3, 6)."""
    normal = np.cross(lines[1, :3] - lines[0, :3], lines[2, :3] - lines[0, :3])
    return min(normal @ line[3:6] for line in lines) / np.linalg.norm(normal)


def closest_on_triangle(point, corners):
    """Closest point of a triangle by trying its inside, its edges and its corners."""
    a, b, c = corners
    candidates = [a, b, c]
    for p, q in ((a, b), (b, c), (c, a)):
        s = (point - p) @ (q - p) / ((q - p) @ (q - p))
        if 0.0 <= s <= 1.0:
            candidates.append(p + s * (q - p))
    basis = np.stack([b - a, c - a], axis=1)
    v, w = np.linalg.lstsq(basis, point - a, rcond=None)[0]
    if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
        candidates.append(a + v * (b - a) + w * (c - a))
    return min(candidates, key=lambda x: np.sum((x - point) ** 2))


def closest_distance(point, mesh, label=None):
    """Distance from a point to all triangles of a mesh, or to those of one label."""
    chosen = mesh.faces if label is None else mesh.faces[mesh.face_labels == label]
    return min(np.linalg.norm(point - closest_on_triangle(point, mesh.points[f])) for f in chosen)


def point_on_polyline(points, parameter):
    """The point of a polyline at an arc length."""
    for p, q in itertools.pairwise(points):
        step = np.linalg.norm(q - p)
        if parameter <= step:
            return p + parameter / step * (q - p)
        parameter -= step
    return points[-1]


def fit_steps(rows, corners, samples, weights, normals, gaps, free, damping, tangential, ridge):
    """Displacements of `adjust.solve_fit` by a dense least-squares solve."""
    n = len(rows)
    lines, right = [], []
    diagonal = np.zeros(n)
    for t, triangle in enumerate(corners):
        for s, sample in enumerate(samples):
            line = np.zeros((n, 3))
            for k in range(3):
                line[triangle[k]] += weights[t] * sample[k] * normals[t * len(samples) + s]
                diagonal[triangle[k]] += (weights[t] * sample[k]) ** 2
            lines.append(line.ravel())
            right.append(weights[t] * gaps[t * len(samples) + s])
    for v in range(n):
        normal = rows[v, 3:6]
        for k in range(3):
            line = np.zeros((n, 3))
            line[v, k] = np.sqrt(damping * diagonal[v])
            lines.append(line.ravel())
            line = np.zeros((n, 3))
            line[v] = np.sqrt(tangential * diagonal[v]) * (np.eye(3)[k] - normal[k] * normal)
            lines.append(line.ravel())
            right += [0.0, 0.0]
    for triangle in corners:
        for k in range(3):
            i, j = triangle[k], triangle[(k + 1) % 3]
            weight = np.sqrt(0.125 * ridge * (diagonal[i] + diagonal[j]))
            line = np.zeros((n, 3))
            line[i], line[j] = weight * rows[i, 3:6], -weight * rows[j, 3:6]
            lines.append(line.ravel())
            right.append(-weight * (rows[i, 6] - rows[j, 6]))
    matrix = np.array(lines).reshape(-1, n, 3)[:, free].reshape(len(lines), -1)
    result = np.zeros((n, 3))
    result[free] = np.linalg.lstsq(matrix, np.array(right), rcond=None)[0].reshape(-1, 3)
    return result


def broken_links(work):
    """Everything that is inconsistent in a work mesh's arrays, in words (an empty list if fine)."""
    halves, links = work.halves, work.links
    wrong = []
    after = lambda h: h - 2 if h % 3 == 2 else h + 1  # noqa: E731
    vertex = lambda h: links[halves[h, ORIGIN], BASE]  # noqa: E731
    for h in range(3 * work.counts[1]):
        if halves[h, ORIGIN] < 0:
            continue
        g = halves[h, TWIN]
        if vertex(h) < 0:
            wrong.append(f"half-edge {h} leaves a dead row")
        if g < 0:
            if links[vertex(h), OUT] != h:
                wrong.append(f"boundary half-edge {h} is not the OUT of its vertex")
            continue
        if halves[g, TWIN] != h or vertex(h) != vertex(after(g)) or vertex(g) != vertex(after(h)):
            wrong.append(f"half-edges {h} and {g} are no twins")
        code, other = halves[h, CREASE], halves[g, CREASE]
        if (code < 0) != (other < 0) or (code >= 0 and other != code ^ 1):
            wrong.append(f"crease codes of {h} and {g} do not mirror")
        same = halves[h, ORIGIN] == halves[after(g), ORIGIN]
        if code < 0 and not same:
            wrong.append(f"two rows at the start of smooth edge {h}")
    mesh, bases = work.to_mesh()
    found = topology(mesh.faces, len(mesh.points))
    if not found.manifold or not found.oriented or found.vertices != work.vertices:
        wrong.append(f"not an oriented manifold of {work.vertices} vertices: {found}")
    ends = np.unique(np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    if not np.array_equal(links[bases, EDGES], np.bincount(ends.ravel(), minlength=len(bases))):
        wrong.append("edge counts")
    for r in bases:
        h = links[r, OUT]
        if halves[h, ORIGIN] < 0 or vertex(h) != r:
            wrong.append(f"OUT of vertex {r}")
        row = links[r, OTHER]
        while row != r:
            if links[row, BASE] != r or not np.array_equal(work.rows[row, :3], work.rows[r, :3]):
                wrong.append(f"row {row} of vertex {r}")
                break
            row = links[row, OTHER]
    return wrong


def boxes_touching(boxes, corners):
    """Triangles (m, 3, 3) whose own box has a point in common with one of the boxes (k, 6)."""
    found = []
    for triangle in corners:
        low, high = triangle.min(axis=0), triangle.max(axis=0)
        found.append(any((box[:3] <= high).all() and (low <= box[3:]).all() for box in boxes))
    return np.array(found)


def triangles_around(work, vertex):
    """Lines (m, 3, 6) of the rows at the corners of a vertex's triangles, the vertex's first."""
    corners = work.halves[: 3 * int(work.counts[TRIANGLES]), ORIGIN].reshape(-1, 3)
    found = []
    for rows in corners[corners[:, 0] >= 0]:
        at = np.flatnonzero(work.links[rows, BASE] == vertex)
        if len(at):
            found.append(work.rows[np.roll(rows, -at[0]), :6])
    return np.array(found)


def embedded(lines, sigma):
    """Psi of lines (position, normal)."""
    return np.concatenate([lines[..., :3], sigma * lines[..., 3:]], axis=-1)


def star_quality(work, vertex, sigma):
    """Least 6D and 3D angle [degrees] and least agreement of the triangles at a vertex."""
    lines = triangles_around(work, vertex)
    angle6 = min(smallest_angle(*embedded(t, sigma)) for t in lines)
    angle3 = min(smallest_angle(*t[:, :3]) for t in lines)
    return angle6, angle3, min(agreement(t) for t in lines)


def star_cost(work, vertex, sigma, power, below3, below):
    """Cost of a star in the search; below3 = (angle3, weight), below = (agreement, barrier)."""
    cost = 0.0
    for t in triangles_around(work, vertex):
        cost += ((60.0 - smallest_angle(*embedded(t, sigma))) / 30.0) ** power
        cost += below3[1] * max(below3[0] - smallest_angle(*t[:, :3]), 0.0) ** 2
        cost += below[1] * max(below[0] - agreement(t), 0.0)
    return cost


def step_to_centroids(work, vertex, sigma):
    """From a vertex to the mean, weighted by 6D area, of its triangles' other corners' means."""
    lines = triangles_around(work, vertex)
    area = np.array([embedded_area(embedded(t, sigma)[None]) for t in lines])
    steps = lines[:, 1:, :3].mean(axis=1) - lines[:, 0, :3]
    return area @ steps / area.sum()
