"""Edge collapses: of short edges in index order, to the endpoint that leaves better triangles."""

import numpy as np

from remesh.compiled import allocating, kernel
from remesh.connectivity import (
    BASE,
    CREASE,
    CURVE,
    EDGES,
    INTERIOR,
    KIND,
    MAX_RING,
    ORIGIN,
    TRIANGLES,
    TWIN,
    collapse_edge,
    following,
    preceding,
    ring,
)
from remesh.embedding import agreement, as_tangents, triangle_tangent
from remesh.guard import sized_edge, sized_length
from remesh.sizing import NO_SIZING

MOST_NEIGHBOURS = 60


def collapse_short_edges(work, shortest, longest, sigma, limits, at_most=None, chosen=None):
    """Collapse edges shorter than `shortest`; return how many were collapsed.

    Parameters
    ----------
    work : WorkMesh
    shortest : float [unit of the points]
        6D length, by the sizing of the work mesh, below which an edge goes. Vertices with three
        edges go whatever the length.
    longest : float
        No edge may come out longer (twice that for edges under half of `shortest`).
    sigma : float [unit of the points]
    limits : (angle6, angle3, agreement)
        Every changed triangle must reach the last two.
    at_most : int, optional
        Stop after so many.
    chosen : (m,) bool array, optional
        Only edges of these triangles, by their number in the work mesh.
    """
    at_most = np.iinfo(np.int64).max if at_most is None else at_most
    mark = np.zeros(len(work.links), np.int64)
    if chosen is None:
        chosen = np.ones(int(work.counts[TRIANGLES]), np.bool_)
    short_sizing, long_sizing = NO_SIZING, NO_SIZING
    if work.sizing is not None:
        short_sizing, long_sizing = work.sizing.for_collapses(), work.sizing.for_splits()
    return sweep_collapses(
        work.halves, work.links, work.rows, work.counts, sigma**2, shortest**2, longest**2,
        as_tangents(limits), at_most, chosen, mark, short_sizing, long_sizing,
    )  # fmt: skip


@kernel
def common_neighbours(halves, links, fan, count, closed, other, other_count, other_closed, mark):
    """Number of vertices adjacent to both centres of two fans; `mark` (0) is left 0."""
    common = 0
    for sweep in range(3):  # mark, count, clear
        n = other_count if sweep == 1 else count
        open_fan = (not other_closed) if sweep == 1 else (not closed)
        for i in range(n + 1):
            if i == n and not open_fan:
                continue
            h = fan[min(i, n - 1)] if sweep != 1 else other[min(i, n - 1)]
            row = halves[following(h), ORIGIN] if i < n else halves[preceding(h), ORIGIN]
            vertex = links[row, BASE]
            if sweep == 0:
                mark[vertex] = 1
            elif sweep == 1:
                common += mark[vertex]
            else:
                mark[vertex] = 0
    return common


@kernel
def outcome(
    rows, halves, fan, count, gone, left, right, kept, links, sigma2, longest2, limits, sizing
):
    """Tangent of the least 6D angle of a fan whose centre moved to a vertex; -1 if not allowed.

    gone, left, right : the centre's row, and the rows that replace it and its other row.
    """
    least = 1e300
    for i in range(count):
        h = fan[i]
        r = left if halves[h, ORIGIN] == gone else right
        p, q = halves[following(h), ORIGIN], halves[preceding(h), ORIGIN]
        p_kept, q_kept = links[p, BASE] == kept, links[q, BASE] == kept
        if not p_kept and sized_length(rows, links, p, r, sigma2, sizing, longest2) > longest2:
            return -1.0
        if not q_kept and sized_length(rows, links, q, r, sigma2, sizing, longest2) > longest2:
            return -1.0
        if p_kept or q_kept:
            continue
        if agreement(rows, r, p, q) < limits[2]:
            return -1.0
        if limits[1] > 0.0 and triangle_tangent(rows, r, p, q, 0.0) < limits[1]:
            return -1.0
        least = min(least, triangle_tangent(rows, r, p, q, sigma2))
    return least


@kernel
def may_go(halves, links, h, vertex):
    """Whether a vertex may be merged along half-edge h: inside a patch, or along its curve."""
    kind = links[vertex, KIND]
    return kind == INTERIOR or (kind == CURVE and halves[h, CREASE] >= 0)


@kernel
def enough_edges(halves, links, h, drop):
    """Whether the vertices opposite to the edge of h can spare an edge.

    `drop` says that a vertex with three edges is taken out, which may leave others with three.
    """
    for which in range(2):
        side = h if which == 0 else halves[h, TWIN]
        if side < 0:
            continue
        opposite = links[halves[preceding(side), ORIGIN], BASE]
        least = 5 if links[opposite, KIND] == INTERIOR and not drop else 4
        if halves[h, TWIN] < 0:
            least -= 1
        if links[opposite, EDGES] < least:
            return False
        n, p = following(side), preceding(side)
        if halves[n, CREASE] >= 0 and halves[p, CREASE] >= 0:
            return False  # two feature edges would become one
        if halves[n, TWIN] < 0 and halves[p, TWIN] < 0:
            return False
    return True


@kernel
def collapse_half_edge(
    halves, links, rows, counts, h, sigma2, longest2, limits, fan_a, fan_b, mark, sizing
):  # fmt: skip
    """Collapse an edge to the end that leaves better triangles, if it may be; whether it was.

    fan_a, fan_b, mark : scratch; `mark` (0) is left 0.
    """
    g = halves[h, TWIN]
    a, b = halves[h, ORIGIN], halves[following(h), ORIGIN]
    va, vb = links[a, BASE], links[b, BASE]
    a_three = links[va, KIND] == INTERIOR and links[va, EDGES] == 3
    b_three = links[vb, KIND] == INTERIOR and links[vb, EDGES] == 3
    if not enough_edges(halves, links, h, a_three or b_three) or (a_three and b_three):
        return False
    count_a, closed_a = ring(halves, links, va, fan_a)
    count_b, closed_b = ring(halves, links, vb, fan_b)
    if count_a == 0 or count_b == 0 or count_a + count_b > MOST_NEIGHBOURS:
        return False
    common = common_neighbours(
        halves, links, fan_a, count_a, closed_a, fan_b, count_b, closed_b, mark
    )
    if common != (2 if g >= 0 else 1):
        return False
    a_right = halves[following(g), ORIGIN] if g >= 0 else a
    b_right = halves[g, ORIGIN] if g >= 0 else b
    without_a, without_b = -1.0, -1.0
    if may_go(halves, links, h, va) and not b_three:
        without_a = outcome(
            rows, halves, fan_a, count_a, a, b, b_right, vb, links, sigma2, longest2, limits,
            sizing,
        )  # fmt: skip
    if may_go(halves, links, h, vb) and not a_three:
        without_b = outcome(
            rows, halves, fan_b, count_b, b, a, a_right, va, links, sigma2, longest2, limits,
            sizing,
        )  # fmt: skip
    if without_a < 0.0 and without_b < 0.0:
        return False
    if without_a >= without_b:
        collapse_edge(halves, links, counts, h, True, fan_a, count_a)
    else:
        collapse_edge(halves, links, counts, h, False, fan_b, count_b)
    return True


@allocating
def sweep_collapses(
    halves, links, rows, counts, sigma2, shortest2, longest2, limits, at_most, chosen, mark,
    short_sizing, long_sizing,
):  # fmt: skip
    """One pass over all edges; returns the number of collapses."""
    fan_a, fan_b = np.empty(MAX_RING, np.int64), np.empty(MAX_RING, np.int64)
    done = 0
    for h in range(3 * counts[TRIANGLES]):
        g = halves[h, TWIN]
        if halves[h, ORIGIN] < 0 or (0 <= g < h) or done >= at_most:
            continue
        if not (chosen[h // 3] or (g >= 0 and chosen[g // 3])):
            continue
        va = links[halves[h, ORIGIN], BASE]
        vb = links[halves[following(h), ORIGIN], BASE]
        three = links[va, KIND] == INTERIOR and links[va, EDGES] == 3
        three |= links[vb, KIND] == INTERIOR and links[vb, EDGES] == 3
        length2 = sized_edge(rows, links, halves, h, sigma2, short_sizing, shortest2)
        if length2 > shortest2 and not three:
            continue
        may_exceed = length2 < 0.25 * shortest2 and short_sizing[0].size == 0
        bound2 = 4.0 * longest2 if may_exceed else longest2
        if collapse_half_edge(
            halves, links, rows, counts, h, sigma2, bound2, limits, fan_a, fan_b, mark, long_sizing,
        ):  # fmt: skip
            done += 1
    return done
