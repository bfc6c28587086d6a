"""Slow, obvious twins of what isosurface does with tables and arrays."""

from itertools import combinations

import numpy as np


def cut_point(field, a, b, level, clearance):
    """The crossing on the edge of nodes a, b, the smaller number first."""
    a, b = min(a, b), max(a, b)
    t = (level - field.values[a]) / (field.values[b] - field.values[a])
    t = min(max(t, clearance), 1.0 - clearance)
    return field.mesh.points[a] + t * (field.mesh.points[b] - field.mesh.points[a])


def marching_polygons(field, level=0.5, clearance=0.01):
    """Polygons (lists of points) of the isosurface, each turned so that it faces away from phi.

    The crossings of a tetrahedron are put in order by their angle about their middle.
    """
    polygons = []
    for tet in field.mesh.tets.tolist():
        inside = [n for n in tet if field.values[n] >= level]
        outside = [n for n in tet if n not in inside]
        if not inside or not outside:
            continue
        points = np.array(
            [cut_point(field, a, b, level, clearance) for a in inside for b in outside]
        )
        middle = points.mean(axis=0)
        away = field.mesh.points[outside].mean(axis=0) - field.mesh.points[inside].mean(axis=0)
        if len(points) == 4:
            points = points[[0, 1, 3, 2]]  # around: neighbours share a node
        area = sum(
            np.cross(p - middle, q - middle) for p, q in zip(points, np.roll(points, -1, axis=0))
        )
        polygons.append(points if area @ away > 0 else points[::-1])
    return polygons


def solid_corners(points, values, level, clearance=1e-12):
    """Inside corners and crossings of one tetrahedron: its solid part is their convex hull."""
    corners = [p for p, v in zip(points, values) if v >= level]
    for i, j in combinations(range(4), 2):
        if (values[i] >= level) != (values[j] >= level):
            t = np.clip((level - values[i]) / (values[j] - values[i]), clearance, 1 - clearance)
            corners.append(points[i] + t * (points[j] - points[i]))
    return np.array(corners)


def merged(faces, gone, kept):
    """Faces after vertex `gone` has become `kept`: those with both are left out."""
    renamed = [[kept if v == gone else v for v in face] for face in faces]
    return [face for face in renamed if len(set(face)) == 3]


def laplacian_step(points, faces, factor):
    """One step of the thesis's smoothing: a loop over vertices and their neighbours."""
    neighbours = [set() for _ in points]
    for face in faces:
        for a in face:
            neighbours[a] |= {b for b in face if b != a}
    return np.array(
        [
            p + factor * sum(points[j] - p for j in around) / len(around)
            for p, around in zip(points, neighbours)
        ]
    )


def rotated(face):
    """The face as a tuple that starts at its smallest vertex."""
    k = int(np.argmin(face))
    return tuple(int(v) for v in (*face[k:], *face[:k]))
