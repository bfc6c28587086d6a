"""Surfaces and fields made in code, for the tests."""

import numpy as np

from meshes import TriMesh

_ICOSAHEDRON_FACES = [
    (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11),
    (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8),
    (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9),
    (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1),
]  # fmt: skip


def icosphere(subdivisions=3, radius=1.0, centre=(0.0, 0.0, 0.0)):
    """A sphere of 10 * 4**subdivisions + 2 vertices, outward oriented."""
    t = (1 + 5**0.5) / 2
    points = np.array(
        [(-1, t, 0), (1, t, 0), (-1, -t, 0), (1, -t, 0), (0, -1, t), (0, 1, t),
         (0, -1, -t), (0, 1, -t), (t, 0, -1), (t, 0, 1), (-t, 0, -1), (-t, 0, 1)]
    )  # fmt: skip
    faces = np.array(_ICOSAHEDRON_FACES)
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middle = len(points) + index.reshape(-1, 3)
        points = np.concatenate([points, points[unique].mean(axis=1)])
        (a, b, c), (ab, bc, ca) = faces.T, middle.T
        faces = np.concatenate(
            [np.stack(f, 1) for f in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    points = points / np.linalg.norm(points, axis=1)[:, None]
    return TriMesh(radius * points + np.asarray(centre), faces)


def torus(major=1.0, minor=0.3, n_major=48, n_minor=20):
    """A torus about the z axis with n_major * n_minor vertices, outward oriented."""
    u, v = np.meshgrid(np.arange(n_major), np.arange(n_minor), indexing="ij")
    a, b = 2 * np.pi * u.ravel() / n_major, 2 * np.pi * v.ravel() / n_minor
    ring = major + minor * np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), minor * np.sin(b)], axis=1)

    def index(i, j):
        return (i % n_major * n_minor + j % n_minor).ravel()

    p, q, r, s = index(u, v), index(u + 1, v), index(u + 1, v + 1), index(u, v + 1)
    return TriMesh(points, np.concatenate([np.stack([p, q, r], 1), np.stack([p, r, s], 1)]))


def figure_eight(n_major=60, n_minor=12):
    """A closed tube along a figure eight, which crosses itself in the middle."""
    t, w = 2 * np.pi * np.arange(n_major) / n_major, 2 * np.pi * np.arange(n_minor) / n_minor
    curve = np.stack([np.sin(t), np.sin(2 * t) / 2, 0.03 * np.cos(t)], axis=1)
    along = np.stack([np.cos(t), np.cos(2 * t), -0.03 * np.sin(t)], axis=1)
    side = np.cross(along, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1)[:, None]
    up = np.cross(side, along) / np.linalg.norm(along, axis=1)[:, None]
    ring = np.cos(w)[None, :, None] * side[:, None] + np.sin(w)[None, :, None] * up[:, None]
    points = (curve[:, None] + 0.1 * ring).reshape(-1, 3)
    return TriMesh(points, torus(n_major=n_major, n_minor=n_minor).faces)


def cube(side=1.0):
    """The cube [0, side]^3 with 12 triangles, outward oriented."""
    points = side * np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    return TriMesh(points, np.array(faces))


class SphereSurface:
    """An analytic ImplicitSurface: S = |x - centre| - radius."""

    def __init__(self, radius=1.0, centre=(0.0, 0.0, 0.0)):
        self.radius, self.centre = radius, np.asarray(centre, float)

    def value(self, points):
        return np.linalg.norm(points - self.centre, axis=1) - self.radius

    def gradient(self, points):
        d = points - self.centre
        return d / np.linalg.norm(d, axis=1)[:, None]

    def value_and_gradient(self, points):
        return self.value(points), self.gradient(points)

    def project(self, points):
        normals = self.gradient(points)
        return self.centre + self.radius * normals, normals


class TorusSurface:
    """An analytic ImplicitSurface: the distance to a torus about the z axis."""

    def __init__(self, major=1.0, minor=0.3):
        self.major, self.minor = major, minor

    def value_and_gradient(self, points):
        ring = np.hypot(points[:, 0], points[:, 1])
        circle = points.copy()
        circle[:, :2] *= (self.major / ring)[:, None]
        circle[:, 2] = 0.0
        d = points - circle
        distance = np.linalg.norm(d, axis=1)
        return distance - self.minor, d / distance[:, None]

    def value(self, points):
        return self.value_and_gradient(points)[0]

    def gradient(self, points):
        return self.value_and_gradient(points)[1]

    def project(self, points):
        value, normal = self.value_and_gradient(points)
        return points - value[:, None] * normal, normal
