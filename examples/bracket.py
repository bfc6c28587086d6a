"""Make bracket.stl, the design domain of bracket.yaml: an L with an eye, extruded along y.

python examples/bracket.py [FOLDER]     writes FOLDER/bracket.stl, in millimetres
"""

import sys
from pathlib import Path

import numpy as np

from meshes import TriMesh
from meshes.io import write_surface

OUTLINE = [(0, 0), (80, 0), (80, 32), (37, 32), (33.5, 33.5), (32, 37), (32, 80), (0, 80)]
EYE, RADIUS, CORNERS = (66.0, 16.0), 6.0, 32
DEPTH = 10.0  # half of the part: y = 0 is a plane of symmetry


def bracket():
    """The closed surface of half the bracket, as a TriMesh in millimetres."""
    outline = np.array(OUTLINE, float)
    angle = -2.0 * np.pi * np.arange(CORNERS) / CORNERS  # clockwise: a hole
    eye = np.array(EYE) + RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    profile = np.concatenate([outline, eye])
    n = len(profile)
    loops = [np.arange(len(outline)), len(outline) + np.arange(CORNERS)]
    flat = triangulated(profile, bridged(profile, *loops))
    x, z = profile.T
    points = np.concatenate([np.stack([x, np.full(n, y), z], axis=1) for y in (0.0, DEPTH)])
    walls = []
    for loop in loops:
        a, b = loop, np.roll(loop, -1)
        walls += [np.stack([a, a + n, b], axis=1), np.stack([b, a + n, b + n], axis=1)]
    return TriMesh(points, np.concatenate([flat, flat[:, ::-1] + n, *walls]))


def bridged(points, outline, hole):
    """One loop of indices around an outline and a hole, joined by their shortest bridge."""
    gap = np.linalg.norm(points[outline][:, None] - points[hole][None], axis=2)
    i, j = np.unravel_index(gap.argmin(), gap.shape)
    around = np.roll(hole, -j)
    start = np.roll(outline, -i)
    return [start[0], *around, around[0], *start[[0]], *start[1:]]


def triangulated(points, loop):
    """Triangles (k, 3) of a counter-clockwise polygon, by cutting off ears."""
    loop, triangles = list(loop), []
    while len(loop) > 3:
        k = max(ears(points, loop), key=lambda k: least_angle(points, loop, k))
        triangles.append([loop[k - 1], loop[k], loop[(k + 1) % len(loop)]])
        del loop[k]
    return np.array([*triangles, loop])


def ears(points, loop):
    """Positions in the loop at which the triangle with both neighbours lies inside and is free."""
    for k in range(len(loop)):
        a, b, c = (points[loop[i % len(loop)]] for i in (k - 1, k, k + 1))
        if turn(a, b, c) <= 1e-9:
            continue
        others = [points[i] for i in loop if not any((points[i] == p).all() for p in (a, b, c))]
        if not any(min(turn(a, b, p), turn(b, c, p), turn(c, a, p)) >= 0.0 for p in others):
            yield k


def least_angle(points, loop, k):
    """Least sine of the corners of the ear at position k: the rounder, the better."""
    p = [points[loop[i % len(loop)]] for i in (k - 1, k, k + 1)]
    lengths = [np.linalg.norm(p[i] - p[i - 1]) for i in range(3)]
    return turn(*p) * min(lengths) / np.prod(lengths)


def turn(a, b, c):
    """Twice the signed area of the triangle a, b, c."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    write_surface(folder / "bracket.stl", bracket())
    print(f"{folder / 'bracket.stl'}: {len(bracket().faces)} triangles")
