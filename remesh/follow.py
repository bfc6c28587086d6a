"""Feature curves followed closely: vertices where the curve turns, and more of them where needed.

A feature edge cuts off the nodes of its curve that lie between its ends. `split_far_edges` puts
vertices where an edge of a crease stays too far off; `fit_curves` moves vertices along their
curve to the nodes that leave the least squared distance.
"""

import math

import numpy as np

from remesh.compiled import allocating, kernel
from remesh.connectivity import (
    BASE,
    CREASE,
    CURVE,
    KIND,
    MAX_RING,
    ORIGIN,
    PARAMETER,
    ROWS,
    TRIANGLES,
    TWIN,
    free_vertex,
    ring,
    room,
    split_edge,
)
from remesh.curves import curve_length, curve_point, span
from remesh.embedding import as_tangents
from remesh.guard import no_worse
from remesh.moves import curve_neighbours, restore_vertex, save_vertex, slide
from remesh.split import split_agreement, vertex_on_curve
from remesh.star import STAR_SHAPE, gather_star, star_quality

MARGIN = 0.2  # of a span: nodes nearer to its ends are not taken
LEAST_GAIN = 0.9


def split_far_edges(work, farthest, least_agreement):
    """Split edges of creases that nodes of their curve are farther from; return how many.

    Open boundaries, which are often jagged, are left alone.

    Parameters
    ----------
    work : WorkMesh
    farthest : float [unit of the points]
    least_agreement : float
        Least cosine between the new triangles' normals and the surface's.
    """
    total, full = 0, True
    while full:
        work.reserve(max(64, work.vertices // 8))
        done, full = sweep_far_splits(
            work.halves, work.links, work.rows, work.labels, work.counts, farthest**2,
            least_agreement, work.curves,
        )  # fmt: skip
        total += done
    return total


def fit_curves(work, limits, farthest, passes=4):
    """Move vertices along their curves to the nodes that leave least; return the last pass's moves.

    Parameters
    ----------
    work : WorkMesh
    limits : (angle6, angle3, agreement)
        No triangle may come out below these and below what it was; angles in 3D.
    farthest : float [unit of the points]
        No edge of a crease may come to be farther from its curve than this and than before.
    passes : int
    """
    moved = 0
    for _ in range(passes):
        moved = sweep_curve_fit(
            work.halves, work.links, work.rows, work.counts, as_tangents(limits), farthest**2,
            work.curves,
        )  # fmt: skip
        if moved == 0:
            break
    return moved


@kernel
def curve_of(halves, fan, count):
    """The curve that the centre of a fan lies on; -1 for none."""
    curve = -1
    for i in range(count):
        if halves[fan[i], CREASE] >= 0:
            curve = halves[fan[i], CREASE] >> 1
    return curve


@kernel
def squared_distance_to_chord(p, a, b):
    """Squared distance from p (3,) to the segment between the first three entries of a and b."""
    length2, along = 0.0, 0.0
    for k in range(3):
        length2 += (b[k] - a[k]) ** 2
        along += (b[k] - a[k]) * (p[k] - a[k])
    t = min(max(along / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    square = 0.0
    for k in range(3):
        square += (p[k] - a[k] - t * (b[k] - a[k])) ** 2
    return square


@kernel
def chord_gap(curves, curve, low, high, ends):
    """Gap between a curve and its chord from parameter low to high.

    Returns the integral of the squared distance of the nodes between, the largest squared
    distance, and the parameter of that node. ends : (2, 9) scratch.
    """
    starts, nodes, _, closed, _ = curves
    first, last = starts[curve], starts[curve + 1] - 1
    length = curve_length(curves, curve)
    curve_point(curves, curve, low, ends[0])
    curve_point(curves, curve, high, ends[1])
    shift = math.floor(low / length) * length if closed[curve] == 1 else 0.0
    n, above = first, last
    while above - n > 1:  # the last node at or before `low`
        middle = (n + above) // 2
        if nodes[middle, 3] + shift <= low:
            n = middle
        else:
            above = middle
    total, worst, at = 0.0, 0.0, 0.5 * (low + high)
    while True:
        n += 1
        if n > last:
            if closed[curve] == 0:
                break
            n, shift = first + 1, shift + length
        s = nodes[n, 3] + shift
        if s >= high:
            break
        if s <= low:
            continue
        square = squared_distance_to_chord(nodes[n], ends[0], ends[1])
        total += square * (nodes[n, 3] - nodes[n - 1, 3])
        if square > worst:
            worst, at = square, s
    return total, worst, at


@allocating
def sweep_far_splits(halves, links, rows, labels, counts, farthest2, least_agreement, curves):
    """One pass over the crease edges; returns the number of splits, and whether room ran out."""
    point, ends = np.empty(9), np.empty((2, 9))
    done = 0
    for h in range(3 * counts[TRIANGLES]):
        g = halves[h, TWIN]
        if halves[h, ORIGIN] < 0 or halves[h, CREASE] < 0 or g < h:
            continue
        s_a, s_b = span(halves, links, rows, curves, h)
        low, high = min(s_a, s_b), max(s_a, s_b)
        _, worst, at = chord_gap(curves, halves[h, CREASE] >> 1, low, high, ends)
        if worst <= farthest2:
            continue
        if not room(halves, links, counts, 2, 2):
            return done, True
        margin = MARGIN * (high - low)
        at = min(max(at, low + margin), high - margin)
        left, right = vertex_on_curve(halves, links, rows, counts, h, at, curves, point)
        if split_agreement(halves, rows, h, left, right) < least_agreement:
            free_vertex(links, counts, left)
            continue
        split_edge(halves, links, counts, labels, h, left, right)
        done += 1
    return done, False


@kernel
def gaps_beside(curves, curve, low, here, high, ends):
    """Integrals of the squared gaps of the chords on both sides, and the largest squared gap."""
    left, left_worst, _ = chord_gap(curves, curve, low, here, ends)
    right, right_worst, _ = chord_gap(curves, curve, here, high, ends)
    return left + right, max(left_worst, right_worst)


@kernel
def chord_bound(curves, curve, low, here, high, farthest2, ends):
    """Largest squared gap that a move of a vertex may leave; open boundaries have no bound."""
    first = curves[0][curve]
    if curves[2][first, 0] < 0 or curves[2][first, 1] < 0:
        return math.inf
    return max(farthest2, gaps_beside(curves, curve, low, here, high, ends)[1])


@kernel
def best_node(curves, curve, low, here, high, farthest2, ends):
    """Parameter between low and high that leaves the least squared gap: a node, or `here`."""
    best_gap, _ = gaps_beside(curves, curve, low, here, high, ends)
    best_gap *= LEAST_GAIN
    bound = chord_bound(curves, curve, low, here, high, farthest2, ends)
    best = here
    starts, nodes, _, closed, _ = curves
    length = curve_length(curves, curve)
    margin = MARGIN * (high - low)
    for turn in range(-1, 2):
        if turn != 0 and closed[curve] == 0:
            continue
        for n in range(starts[curve], starts[curve + 1]):
            s = nodes[n, 3] + turn * length
            if s <= low + margin or s >= high - margin:
                continue
            gap, worst = gaps_beside(curves, curve, low, s, high, ends)
            if gap < best_gap and worst <= bound:
                best_gap, best = gap, s
    return best


@allocating
def sweep_curve_fit(halves, links, rows, counts, limits, farthest2, curves):
    """One pass over the vertices on curves; returns how many moved."""
    fan, star = np.empty(MAX_RING, np.int64), np.zeros(STAR_SHAPE)
    point, four, ends = np.empty(9), np.empty(4), np.empty((2, 9))
    saved, saved_hints = np.empty((2, 8)), np.empty(2, np.int64)
    moved = 0
    for v in range(counts[ROWS]):
        if links[v, BASE] != v or links[v, KIND] != CURVE:
            continue
        count, closed = ring(halves, links, v, fan)
        if count == 0 or not curve_neighbours(
            halves, links, rows, v, fan, count, closed, 0.0, curves, four
        ):
            continue
        curve = curve_of(halves, fan, count)
        if curve < 0 or curves[4][curve] == 1:
            continue
        here = rows[v, PARAMETER]
        low, high = here + min(four[0], four[2]), here + max(four[0], four[2])
        parameter = best_node(curves, curve, low, here, high, farthest2, ends)
        if parameter == here:
            continue
        gather_star(halves, rows, fan, count, star)
        before = star_quality(rows, halves, fan, count, star, 0.0)
        save_vertex(rows, links, v, saved, saved_hints)
        slide(halves, links, rows, v, fan, count, parameter, curves, point)
        if no_worse(star_quality(rows, halves, fan, count, star, 0.0), before, limits):
            moved += 1
        else:
            restore_vertex(rows, links, v, saved, saved_hints)
    return moved
