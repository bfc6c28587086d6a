"""The slow obvious twin of the clipping: polygons, one vertex at a time."""

from itertools import pairwise

import numpy as np


def clip_polygon(polygon, region):
    """Sutherland and Hodgman: the part of a convex polygon (list of (3,)) inside a Box."""
    for axis in range(3):
        for sign, bound in ((1.0, region.lower[axis]), (-1.0, region.upper[axis])):
            if np.isfinite(bound):
                polygon = _clip_once(polygon, axis, sign, bound)
    return polygon


def _clip_once(polygon, axis, sign, bound):
    kept = []
    for start, end in zip(polygon, polygon[1:] + polygon[:1]):
        a, b = sign * (start[axis] - bound), sign * (end[axis] - bound)
        if a >= 0:
            kept.append(start)
        if a * b < 0:
            kept.append(start + a / (a - b) * (end - start))
    return kept


def polygon_area(polygon):
    """Area of a plane polygon; 0 for fewer than three corners."""
    fan = [np.cross(b - polygon[0], c - polygon[0]) for b, c in pairwise(polygon[1:])]
    return float(np.linalg.norm(np.sum(fan, axis=0))) / 2.0 if fan else 0.0
