"""Gaps of single triangles to the carrier, both ways.

`targets` is what the kernels measure against, a tuple of arrays:

points : (k, 3) float64
    Points of the carrier.
starts, listed : int64
    Those nearest to triangle t are listed[starts[t] : starts[t + 1]].
lattice : (s, 3) float64
    Barycentric coordinates of points on a triangle: its corners and midpoints first.
reference : tuple
    The carrier (see `nearest`).
"""

import math

from remesh.compiled import kernel
from remesh.connectivity import HINT, ORIGIN, following, preceding
from remesh.nearest import closest, walk

COARSE = 6  # the lattice's first points, after which a triangle may be found near enough
TRUSTED = 0.5  # of the aim: where a walk ends farther off, the closest point of all is taken


@kernel
def lattice_gap(links, rows, a, b, c, targets, aim, enough):
    """Largest distance from a triangle's lattice points to the carrier.

    Ends after the first few points where these are within `enough`.
    """
    _, _, _, lattice, reference = targets
    trusted = (TRUSTED * aim) ** 2
    hint, worst = links[a, HINT], 0.0
    for s in range(lattice.shape[0]):
        u, v, w = lattice[s, 0], lattice[s, 1], lattice[s, 2]
        x = u * rows[a, 0] + v * rows[b, 0] + w * rows[c, 0]
        y = u * rows[a, 1] + v * rows[b, 1] + w * rows[c, 1]
        z = u * rows[a, 2] + v * rows[b, 2] + w * rows[c, 2]
        hint, _, _, square = walk(reference, x, y, z, hint)
        if square > trusted and square > worst:
            hint, _, _, square = closest(reference, x, y, z, hint)
        worst = max(worst, square)
        if s == COARSE - 1 and worst <= enough * enough:
            break
    return math.sqrt(worst)


@kernel
def squared_to_rows(rows, a, b, c, point):
    """Squared distance from a point (3,) to the triangle of three rows."""
    uu, uv, vv, pu, pv, pp = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        p, u, v = point[k] - rows[a, k], rows[b, k] - rows[a, k], rows[c, k] - rows[a, k]
        uu, uv, vv = uu + u * u, uv + u * v, vv + v * v
        pu, pv, pp = pu + p * u, pv + p * v, pp + p * p
    determinant = uu * vv - uv * uv
    s, t = vv * pu - uv * pv, uu * pv - uv * pu
    if determinant > 0.0 and s >= 0.0 and t >= 0.0 and s + t <= determinant:
        return max(pp - (s * pu + t * pv) / determinant, 0.0)
    s = min(max(pu / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    least = s * (s * uu - 2.0 * pu)
    s = min(max(pv / vv, 0.0), 1.0) if vv > 0.0 else 0.0
    least = min(least, s * (s * vv - 2.0 * pv))
    across = uu - 2.0 * uv + vv
    s = min(max((uu - uv - pu + pv) / across, 0.0), 1.0) if across > 0.0 else 0.0
    last = (1.0 - s) * ((1.0 - s) * uu + 2.0 * s * uv - 2.0 * pu) + s * (s * vv - 2.0 * pv)
    return max(pp + min(least, last), 0.0)


@kernel
def excess(distance, aim):
    """How much a gap counts: nothing below the aim."""
    over = distance / aim - 1.0
    return over * over if over > 0.0 else 0.0


@kernel
def measure_gaps(halves, links, rows, targets, aim, gaps):
    """Largest distance from each triangle's lattice points to the carrier; coarse where small."""
    for t in range(gaps.size):
        a, b, c = halves[3 * t, ORIGIN], halves[3 * t + 1, ORIGIN], halves[3 * t + 2, ORIGIN]
        if a >= 0:
            gaps[t] = lattice_gap(links, rows, a, b, c, targets, aim, TRUSTED * aim)


@kernel
def star_gap(halves, links, rows, fan, count, targets, aim, bound):
    """Cost of the gaps of a fan's triangles, both ways; stops above `bound`."""
    points, starts, listed, _, _ = targets
    cost = 0.0
    for i in range(count):
        for e in range(starts[fan[i] // 3], starts[fan[i] // 3 + 1]):
            least = math.inf
            for j in range(count):
                h = fan[(i + j) % count]
                square = squared_to_rows(
                    rows, halves[h, ORIGIN], halves[following(h), ORIGIN],
                    halves[preceding(h), ORIGIN], points[listed[e]],
                )  # fmt: skip
                least = min(least, square)
                if least <= aim * aim:
                    break
            cost += excess(math.sqrt(least), aim)
        if cost >= bound:
            return cost
    for i in range(count):
        h = fan[i]
        a, b, c = halves[h, ORIGIN], halves[following(h), ORIGIN], halves[preceding(h), ORIGIN]
        cost += excess(lattice_gap(links, rows, a, b, c, targets, aim, 0.0), aim)
        if cost >= bound:
            return cost
    return cost


@kernel
def pair_gap(links, rows, first, second, h, g, targets, aim):
    """Cost of the gaps of two triangles of rows, with the points of the triangles of h and g."""
    points, starts, listed, _, _ = targets
    a, b, c = first
    d, e, f = second
    cost = excess(lattice_gap(links, rows, a, b, c, targets, aim, 0.0), aim)
    cost += excess(lattice_gap(links, rows, d, e, f, targets, aim, 0.0), aim)
    for which in range(2):
        t = h // 3 if which == 0 else g // 3
        for i in range(starts[t], starts[t + 1]):
            point = points[listed[i]]
            square = squared_to_rows(rows, a, b, c, point)
            square = min(square, squared_to_rows(rows, d, e, f, point))
            cost += excess(math.sqrt(square), aim)
    return cost
