"""What every operation is checked against: normals at the corners, angles, edge lengths."""

import math

from remesh.compiled import kernel
from remesh.connectivity import CREASE, ORIGIN, TWIN, following, preceding
from remesh.embedding import agreement, least_tangent, squared_length, squared_parts


@kernel
def squared_edge(rows, halves, h, sigma2):
    """6D length^2 of a half-edge's edge; on a feature curve the larger of its two sides'."""
    length = squared_length(rows, halves[h, ORIGIN], halves[following(h), ORIGIN], sigma2)
    g = halves[h, TWIN]
    if halves[h, CREASE] >= 0 and g >= 0:
        other = squared_length(rows, halves[g, ORIGIN], halves[following(g), ORIGIN], sigma2)
        length = max(length, other)
    return length


@kernel
def fan_quality(rows, halves, fan, count, sigma2):
    """Tangents of the least 6D and 3D angle, and least agreement with the normals, in a fan."""
    tangent6, tangent3, normal = math.inf, math.inf, 1.0
    last_centre, last_rim = -1, -1
    position, turn = 0.0, 0.0
    for i in range(count):
        h = fan[i]
        a, b, c = halves[h, ORIGIN], halves[following(h), ORIGIN], halves[preceding(h), ORIGIN]
        if a != last_centre or b != last_rim:
            position, turn = squared_parts(rows, a, b)
        rim_position, rim_turn = squared_parts(rows, b, c)
        next_position, next_turn = squared_parts(rows, c, a)
        tangent3 = min(tangent3, least_tangent(position, rim_position, next_position))
        if sigma2 > 0.0:
            tangent = least_tangent(
                position + sigma2 * turn,
                rim_position + sigma2 * rim_turn,
                next_position + sigma2 * next_turn,
            )
            tangent6 = min(tangent6, tangent)
        normal = min(normal, agreement(rows, a, b, c))
        last_centre, last_rim = a, c
        position, turn = next_position, next_turn
    if sigma2 <= 0.0:
        tangent6 = tangent3
    return tangent6, tangent3, normal


@kernel
def no_worse(after, before, limits):
    """Whether angles and agreement after a move reach their limits, or have not fallen.

    `after` and `before` are what `fan_quality` returns; `limits` are `as_tangents`.
    """
    worse = False
    for k in range(3):
        worse |= after[k] < limits[k] and after[k] < before[k]
    return not worse
