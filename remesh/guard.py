"""What every operation is checked against: normals at the corners, angles, edge lengths."""

from remesh.compiled import kernel
from remesh.connectivity import CREASE, ORIGIN, TWIN, following, preceding
from remesh.embedding import agreement, squared_length, triangle_angle


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
    """Least 6D angle, least 3D angle [degrees] and least agreement with the normals in a fan."""
    angle6, angle3, normal = 180.0, 180.0, 1.0
    for i in range(count):
        h = fan[i]
        a, b, c = halves[h, ORIGIN], halves[following(h), ORIGIN], halves[preceding(h), ORIGIN]
        angle3 = min(angle3, triangle_angle(rows, a, b, c, 0.0))
        if sigma2 > 0.0:
            angle6 = min(angle6, triangle_angle(rows, a, b, c, sigma2))
        normal = min(normal, agreement(rows, a, b, c))
    if sigma2 <= 0.0:
        angle6 = angle3
    return angle6, angle3, normal


@kernel
def no_worse(after, before, limits):
    """Whether angles and agreement after a move reach their limits, or have not fallen.

    `after` and `before` are what `fan_quality` returns; `limits` in the same order.
    """
    worse = False
    for k in range(3):
        worse |= after[k] < limits[k] and after[k] < before[k]
    return not worse
