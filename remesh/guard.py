"""What every operation is checked against: normals at the corners, angles, edge lengths."""

import math

from remesh.compiled import hot
from remesh.connectivity import CREASE, HINT, ORIGIN, TWIN, following, preceding
from remesh.embedding import least_angle, squared_length, squared_parts


@hot
def squared_edge(rows, halves, h, sigma2):
    """6D length^2 of a half-edge's edge; on a feature curve the larger of its two sides'."""
    length = squared_length(rows, halves[h, ORIGIN], halves[following(h), ORIGIN], sigma2)
    g = halves[h, TWIN]
    if halves[h, CREASE] >= 0 and g >= 0:
        other = squared_length(rows, halves[g, ORIGIN], halves[following(g), ORIGIN], sigma2)
        length = max(length, other)
    return length


@hot
def sized_length(rows, links, a, b, sigma2, sizing, threshold2):
    """6D length^2 of two rows as `sizing` has it, to be compared with threshold2.

    sizing : (factors of the carrier's triangles, squared lengths in 3D below which it is below
        the threshold, and above which it is above); see `sizing.Sizing`.
    """
    scales, shortest2, longest2 = sizing
    square = squared_length(rows, a, b, sigma2)
    if scales.size == 0:
        return square
    position = squared_length(rows, a, b, 0.0)
    scale = 0.5 * (scales[links[a, HINT]] + scales[links[b, HINT]])
    least = threshold2 * (position / longest2)
    square = max(square, least) * (scale * scale)
    if position < shortest2:
        square = min(square, threshold2 * (position / shortest2))
    return max(square, least)


@hot
def sized_edge(rows, links, halves, h, sigma2, sizing, threshold2):
    """`sized_length` of a half-edge's edge; on a feature curve the larger of its two sides'."""
    a, b = halves[h, ORIGIN], halves[following(h), ORIGIN]
    length = sized_length(rows, links, a, b, sigma2, sizing, threshold2)
    g = halves[h, TWIN]
    if halves[h, CREASE] >= 0 and g >= 0:
        b, a = halves[g, ORIGIN], halves[following(g), ORIGIN]
        length = max(length, sized_length(rows, links, a, b, sigma2, sizing, threshold2))
    return length


@hot
def gather_star(halves, rows, fan, count, star):
    """Write what stays the same of a fan's triangles while its centre moves.

    star : (at least count, 14) float array
        Position and normal of both other corners, and the squared distances of these.
    """
    for i in range(count):
        b, c = halves[following(fan[i]), ORIGIN], halves[preceding(fan[i]), ORIGIN]
        for k in range(6):
            star[i, k] = rows[b, k]
            star[i, 6 + k] = rows[c, k]
        star[i, 12], star[i, 13] = squared_parts(rows, b, c)


@hot
def spoke_parts(rows, a, star, i, first):
    """Squared distances of positions and normals from a row to a corner in a star."""
    position, turn = 0.0, 0.0
    for k in range(3):
        d = star[i, first + k] - rows[a, k]
        position += d * d
        d = star[i, first + 3 + k] - rows[a, 3 + k]
        turn += d * d
    return position, turn


@hot
def star_triangle(rows, a, star, i, sigma2):
    """Sine and cosine of the least 6D angle of a triangle of a star, and of the 3D one, each pair
    times some factor; twice its area times its agreement, and twice its area.

    a : row of the centre.
    """
    ux, uy, uz = star[i, 0] - rows[a, 0], star[i, 1] - rows[a, 1], star[i, 2] - rows[a, 2]
    vx, vy, vz = star[i, 6] - rows[a, 0], star[i, 7] - rows[a, 1], star[i, 8] - rows[a, 2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area = math.sqrt(x * x + y * y + z * z)  # twice the triangle's
    at_a = x * rows[a, 3] + y * rows[a, 4] + z * rows[a, 5]
    at_b = x * star[i, 3] + y * star[i, 4] + z * star[i, 5]
    at_c = x * star[i, 9] + y * star[i, 10] + z * star[i, 11]
    normal = min(at_a, min(at_b, at_c))
    first, first_turn = spoke_parts(rows, a, star, i, 0)
    last, last_turn = spoke_parts(rows, a, star, i, 6)
    rim = star[i, 12]
    cosine = first + last + rim - 2.0 * min(rim, min(first, last))
    sine3, cosine3 = (2.0 * area, cosine) if cosine > 0.0 else (0.0, 1.0)
    if sigma2 <= 0.0:
        return sine3, cosine3, sine3, cosine3, normal, area
    sine6, cosine6 = least_angle(
        first + sigma2 * first_turn, last + sigma2 * last_turn, rim + sigma2 * star[i, 13]
    )
    return sine6, cosine6, sine3, cosine3, normal, area


@hot
def star_quality(rows, halves, fan, count, star, sigma2):
    """Tangents of the least 6D and 3D angle, and least agreement with the normals, in a star."""
    sine6, cosine6, sine3, cosine3, normal, area = 1.0, 0.0, 1.0, 0.0, 1.0, 1.0
    for i in range(count):
        s6, c6, s3, c3, n, a = star_triangle(rows, halves[fan[i], ORIGIN], star, i, sigma2)
        if s6 * cosine6 < sine6 * c6:
            sine6, cosine6 = s6, c6
        if s3 * cosine3 < sine3 * c3:
            sine3, cosine3 = s3, c3
        if a <= 0.0:
            n, a = -1.0, 1.0
        if n * area < normal * a:
            normal, area = n, a
    return sine6 / cosine6, sine3 / cosine3, normal / area


@hot
def reaches(quality, limits):
    """Whether angles and agreement reach their limits (see `no_worse`)."""
    return quality[0] >= limits[0] and quality[1] >= limits[1] and quality[2] >= limits[2]


@hot
def no_worse(after, before, limits):
    """Whether angles and agreement after a move reach their limits, or have not fallen.

    `after` and `before` are what `star_quality` returns; `limits` are `as_tangents`.
    """
    worse = False
    for k in range(3):
        worse |= after[k] < limits[k] and after[k] < before[k]
    return not worse
