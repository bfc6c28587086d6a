"""What every operation is checked against: normals at the corners, angles, edge lengths."""

from remesh.compiled import hot
from remesh.connectivity import CREASE, HINT, ORIGIN, TWIN, following
from remesh.embedding import squared_length


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
