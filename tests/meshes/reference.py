"""Slow, obvious twins of the kernels in meshes/."""

from fractions import Fraction

import numpy as np


def exact(points):
    """Points as tuples of fractions."""
    return [tuple(Fraction(float(x)) for x in p) for p in points]


def minus(a, b):
    return tuple(x - y for x, y in zip(a, b))


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def clip(polygon, normal, origin):
    """The part of a convex polygon (list of exact points) where normal . (x - origin) >= 0."""
    height = [dot(normal, minus(p, origin)) for p in polygon]
    result = []
    for k, (p, h) in enumerate(zip(polygon, height)):
        q, g = polygon[k - 1], height[k - 1]
        if h * g < 0:
            share = g / (g - h)
            result.append(tuple(x + share * (y - x) for x, y in zip(q, p)))
        if h >= 0:
            result.append(p)
    return result


def common_part(s, t):
    """Corners of the intersection of triangles s and t (exact points), empty if there is none."""
    normal = cross(minus(t[1], t[0]), minus(t[2], t[0]))
    part = clip(clip(s, normal, t[0]), tuple(-x for x in normal), t[0])
    for k in range(3):
        inward = cross(normal, minus(t[(k + 1) % 3], t[k]))
        part = clip(part, inward, t[k])
    return part


def on_segment(p, a, b):
    """Whether p lies on the closed segment ab."""
    along, to = minus(b, a), minus(p, a)
    return cross(along, to) == (0, 0, 0) and 0 <= dot(along, to) <= dot(along, along)


def faces_meet(points, f, g):
    """Whether two faces have more in common than the vertices and edges they share by number."""
    part = common_part([points[v] for v in f], [points[v] for v in g])
    shared = [points[v] for v in f if v in g]
    if len(shared) == 0:
        return len(part) > 0
    if len(shared) == 1:
        return any(p != shared[0] for p in part)
    if len(shared) == 2:
        return any(not on_segment(p, *shared) for p in part)
    return True


def self_intersecting_faces(points, faces):
    """Twin of meshes.self_intersection: all pairs, in fractions."""
    points = exact(points)
    marked = np.zeros(len(faces), dtype=bool)
    faces = [tuple(int(v) for v in f) for f in faces]
    solid = [
        any(cross(minus(points[b], points[a]), minus(points[c], points[a]))) for a, b, c in faces
    ]
    for i, f in enumerate(faces):
        for j in range(i):
            if solid[i] and solid[j] and faces_meet(points, f, faces[j]):
                marked[i] = marked[j] = True
    return marked


def plane_side(a, b, c, d):
    """Sign of det(a - d, b - d, c - d) in fractions."""
    a, b, c, d = exact((a, b, c, d))
    value = dot(minus(a, d), cross(minus(b, d), minus(c, d)))
    return (value > 0) - (value < 0)


def line_side(a, b, c):
    """Sign of det(a - c, b - c) in the plane, in fractions."""
    a, b, c = exact((a, b, c))
    (ux, uy), (vx, vy) = minus(a, c), minus(b, c)
    value = ux * vy - uy * vx
    return (value > 0) - (value < 0)


def distance_to_triangles(point, corners):
    """Distances (m,) of a point from triangles (m, 3, 3): foot in the plane, else three edges."""
    pairs = [(corners[:, k], corners[:, (k + 1) % 3]) for k in range(3)]
    best = np.min([distance_to_segment(point, *ends) for ends in pairs], axis=0)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    unit = normal / np.where(length > 0, length, 1.0)[:, None]
    height = np.einsum("ij,ij->i", unit, point - corners[:, 0])
    foot = point - height[:, None] * unit
    inside = length > 0
    for a, b in pairs:
        inside &= np.einsum("ij,ij->i", normal, np.cross(b - a, foot - a)) >= 0
    return np.where(inside, np.minimum(best, np.abs(height)), best)


def distance_to_segment(point, a, b):
    """Distances of a point from the segments ab (..., 3)."""
    along = b - a
    length = (along**2).sum(axis=-1)
    share = ((point - a) * along).sum(axis=-1) / np.where(length > 0, length, 1.0)
    foot = a + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(point - foot, axis=-1)


def closest_distance(points, corners):
    """Distances (n,) of points from the nearest of triangles (m, 3, 3), all tried."""
    return np.array([distance_to_triangles(p, corners).min() for p in points])


def edge_faces(faces):
    """Map every edge (low, high) to the list of faces that run through it."""
    found = {}
    for number, face in enumerate(np.asarray(faces).tolist()):
        for k in range(3):
            found.setdefault(tuple(sorted((face[k], face[(k + 1) % 3]))), []).append(number)
    return found


def components(pairs, size):
    """Component of every node (size,), numbered by first nodes: spread the least number."""
    label = list(range(size))
    changed = True
    while changed:
        changed = False
        for a, b in pairs:
            least = min(label[a], label[b])
            changed |= label[a] != least or label[b] != least
            label[a] = label[b] = least
    names = {least: number for number, least in enumerate(sorted(set(label)))}
    return [names[least] for least in label]
