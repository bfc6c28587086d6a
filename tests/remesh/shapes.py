"""Shapes with planes, creases and open boundaries, made in code."""

import numpy as np

from meshes import Patch, Plane, TriMesh
from meshes.features import find_features
from tests.shapes import icosphere, torus


def revolved(profile, around=32):
    """A closed surface of revolution about z from (radius, z) pairs; both ends on the axis."""
    profile = np.asarray(profile, float)
    turn = 2 * np.pi * np.arange(around) / around
    rings = [
        np.stack([r * np.cos(turn), r * np.sin(turn), np.full(around, z)], axis=1)
        for r, z in profile[1:-1]
    ]
    poles = np.array([[0, 0, profile[0, 1]], [0, 0, profile[-1, 1]]])
    points = np.concatenate([*rings, poles])
    i, n = np.arange(around), len(rings) * around
    j = (i + 1) % around
    faces = [np.stack([np.full(around, n), j, i], axis=1)]
    for k in range(len(rings) - 1):
        a, b, c, d = k * around + i, k * around + j, (k + 1) * around + j, (k + 1) * around + i
        faces += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    top = (len(rings) - 1) * around
    faces.append(np.stack([np.full(around, n + 1), top + i, top + j], axis=1))
    return TriMesh(points, np.concatenate(faces))


def cylinder(height=2.0, around=32, rings=16):
    """A cylinder of radius 1 with two planar caps: labels, planes and rims found by angle."""
    z = np.linspace(0.0, height, rings + 1)
    return find_features(revolved([(0, 0), *((1, h) for h in z), (0, height)], around))


def cut_sphere(level=0.4, around=40, rings=24):
    """The unit sphere below z = level, closed by a planar cap."""
    angle = np.linspace(-np.pi / 2, np.arcsin(level), rings + 1)
    profile = [*np.stack([np.cos(angle), np.sin(angle)], axis=1), (0.0, level)]
    profile[0] = (0.0, -1.0)
    plain = revolved(profile, around)
    on_cap = np.isclose(plain.points[plain.faces][:, :, 2], level).all(axis=1)
    labels = (Patch("sphere"), Patch("cap", Plane((0.0, 0.0, 1.0), level)))
    return TriMesh(plain.points, plain.faces, on_cap.astype(int), labels)


def hemisphere(subdivisions=3):
    """The upper half of a sphere, cut along the equator by moving vertices onto it."""
    sphere = icosphere(subdivisions)
    keep = sphere.points[sphere.faces].mean(axis=1)[:, 2] > 0.0
    return TriMesh(sphere.points, sphere.faces[keep])


def jittered(mesh, amount, seed):
    """The mesh with points moved at random by at most `amount` of the mean edge."""
    edges = mesh.points[mesh.faces[:, 0]] - mesh.points[mesh.faces[:, 1]]
    size = amount * np.linalg.norm(edges, axis=1).mean()
    rng = np.random.default_rng(seed)
    return mesh.with_points(mesh.points + rng.uniform(-size, size, mesh.points.shape))


def rotation(seed):
    """A random rotation matrix (3, 3)."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def closed_shapes():
    """Closed surfaces of genus 0 and 1, with and without features, by name."""
    return {
        "sphere": icosphere(2),
        "torus": torus(n_major=20, n_minor=10),
        "cylinder": cylinder(around=16, rings=6),
        "cut sphere": cut_sphere(around=16, rings=8),
    }


def bump(height=0.1, width=0.08, count=61):
    """The square from -1 to 1 with a bump in its middle, where the grid is fine."""
    s = np.linspace(-1.0, 1.0, count)
    s = 0.15 * s + 0.85 * s**3
    x, y = (grid.ravel() for grid in np.meshgrid(s, s, indexing="ij"))
    points = np.stack([x, y, height * np.exp(-(x**2 + y**2) / width**2)], axis=1)
    i, j = (grid.ravel() for grid in np.meshgrid(*[np.arange(count - 1)] * 2, indexing="ij"))
    a = i * count + j
    b, c, d = a + count, a + count + 1, a + 1
    return TriMesh(points, np.concatenate([np.stack(t, axis=1) for t in ((a, b, c), (a, c, d))]))
