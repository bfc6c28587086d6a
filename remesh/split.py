"""Edge splits: the longest edge of each triangle, at its midpoint on the surface or curve."""

import numpy as np

from remesh.compiled import allocating, hot, kernel
from remesh.connectivity import (
    BASE,
    CREASE,
    CURVE,
    EDGES,
    HINT,
    IDEAL,
    INTERIOR,
    KIND,
    OFFSET,
    ORIGIN,
    OTHER,
    PARAMETER,
    TRIANGLES,
    TWIN,
    VERTICES,
    following,
    free_vertex,
    new_row,
    preceding,
    room,
    split_edge,
)
from remesh.curves import curve_point, span
from remesh.embedding import agreement
from remesh.guard import sized_edge
from remesh.nearest import place
from remesh.sizing import NO_SIZING


def split_long_edges(work, longest, sigma, least_agreement, at_most=None):
    """Split edges longer than `longest`; return how many were split.

    Parameters
    ----------
    work : WorkMesh
    longest : float [unit of the points]
        6D length, by the sizing of the work mesh, above which an edge is split.
    sigma : float [unit of the points]
    least_agreement : float
        Least cosine between the new triangles' normals and the surface's.
    at_most : int, optional
        Stop after so many.
    """
    at_most = np.iinfo(np.int64).max if at_most is None else at_most
    sizing = NO_SIZING if work.sizing is None else work.sizing.for_splits()
    total = 0
    while total < at_most:
        work.reserve(max(64, work.vertices // 4))
        done, full = sweep_splits(
            work.halves, work.links, work.rows, work.labels, work.counts, sigma**2, longest**2,
            least_agreement, at_most - total, work.carrier.reference, work.curves, sizing,
        )  # fmt: skip
        total += done
        if not full:
            break
    return total


@hot
def longest_edge(halves, links, rows, t, sigma2, fixed, sizing, longest2):
    """The half-edge of triangle t with the longest edge that is not fixed, and its 6D length^2."""
    longest, length2 = 3 * t, -1.0
    for k in range(3):
        code = halves[3 * t + k, CREASE]
        if code >= 0 and fixed[code >> 1] == 1:
            continue
        square = sized_edge(rows, links, halves, 3 * t + k, sigma2, sizing, longest2)
        if square > length2:
            longest, length2 = 3 * t + k, square
    return longest, length2


@kernel
def init_vertex(links, counts, row, kind, ideal):
    """Make a row a vertex of its own."""
    links[row, BASE] = row
    links[row, OTHER] = row
    links[row, KIND] = kind
    links[row, IDEAL] = ideal
    links[row, EDGES] = 0
    counts[VERTICES] += 1


@kernel
def midpoint_inside(halves, links, rows, counts, h, reference, point):
    """A new vertex at the projected midpoint of an edge inside a patch; returns its row."""
    a, b = halves[h, ORIGIN], halves[following(h), ORIGIN]
    m = new_row(links, counts)
    init_vertex(links, counts, m, INTERIOR, 6)
    offset = 0.5 * (rows[a, OFFSET] + rows[b, OFFSET])
    links[m, HINT] = place(
        reference,
        0.5 * (rows[a, 0] + rows[b, 0]),
        0.5 * (rows[a, 1] + rows[b, 1]),
        0.5 * (rows[a, 2] + rows[b, 2]),
        links[a, HINT],
        offset,
        point,
    )
    for k in range(6):
        rows[m, k] = point[k]
    rows[m, OFFSET] = offset
    rows[m, PARAMETER] = 0.0
    return m


@kernel
def vertex_on_curve(halves, links, rows, counts, h, parameter, curves, point):
    """A new vertex at a parameter of a feature edge; returns its rows left and right of h."""
    code = halves[h, CREASE]
    parameter, node = curve_point(curves, code >> 1, parameter, point)
    on_boundary = halves[h, TWIN] < 0
    left = new_row(links, counts)
    init_vertex(links, counts, left, CURVE, 4 if on_boundary else 6)
    right = left
    if not on_boundary:
        right = new_row(links, counts)
        links[right, BASE], links[right, OTHER], links[left, OTHER] = left, left, right
    for which in range(1 if on_boundary else 2):
        row = left if which == 0 else right
        side = (code & 1) ^ which
        for k in range(3):
            rows[row, k] = point[k]
            rows[row, 3 + k] = point[3 + 3 * side + k]
        rows[row, OFFSET] = 0.0
        rows[row, PARAMETER] = parameter
        links[row, HINT] = curves[2][node, side]
    return left, right


@kernel
def split_agreement(halves, rows, h, left, right):
    """Least agreement with the normals of the triangles that a split would make."""
    a, b, c = halves[h, ORIGIN], halves[following(h), ORIGIN], halves[preceding(h), ORIGIN]
    least = min(agreement(rows, c, a, left), agreement(rows, c, left, b))
    g = halves[h, TWIN]
    if g >= 0:
        b, a, d = halves[g, ORIGIN], halves[following(g), ORIGIN], halves[preceding(g), ORIGIN]
        least = min(least, min(agreement(rows, d, right, a), agreement(rows, d, b, right)))
    return least


@kernel
def split_half_edge(
    halves, links, rows, labels, counts, h, least_agreement, reference, curves, point
):  # fmt: skip
    """Split an edge in its middle, on the surface or its curve, for which there is room.

    Returns the new vertex, -1 where triangles would agree less than asked with the normals.
    """
    if halves[h, CREASE] >= 0:
        s_a, s_b = span(halves, links, rows, curves, h)
        left, right = vertex_on_curve(
            halves, links, rows, counts, h, 0.5 * (s_a + s_b), curves, point
        )
    else:
        left = midpoint_inside(halves, links, rows, counts, h, reference, point)
        right = left
    if split_agreement(halves, rows, h, left, right) < least_agreement:
        free_vertex(links, counts, left)
        return -1
    split_edge(halves, links, counts, labels, h, left, right)
    return left


@allocating
def sweep_splits(
    halves, links, rows, labels, counts, sigma2, longest2, least_agreement, at_most,
    reference, curves, sizing,
):  # fmt: skip
    """One pass over all triangles; returns the number of splits, and whether room ran out."""
    point = np.empty(9)
    done = 0
    for t in range(counts[TRIANGLES]):
        if halves[3 * t, ORIGIN] < 0 or done >= at_most:
            continue
        h, length2 = longest_edge(halves, links, rows, t, sigma2, curves[4], sizing, longest2)
        if length2 <= longest2:
            continue
        if not room(halves, links, counts, 2, 2):
            return done, True
        made = split_half_edge(
            halves, links, rows, labels, counts, h, least_agreement, reference, curves, point
        )
        done += 1 if made >= 0 else 0
    return done, False
