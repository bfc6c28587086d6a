"""Moving one vertex: on its patch by closest point, on its curve by arc length, and back."""

from remesh.compiled import hot, kernel
from remesh.connectivity import (
    CREASE,
    HINT,
    OFFSET,
    ORIGIN,
    OTHER,
    PARAMETER,
    preceding,
)
from remesh.curves import curve_point, span
from remesh.guard import squared_edge
from remesh.nearest import place


@hot
def save_vertex(rows, links, vertex, saved, saved_hints):
    """Copy the rows of a vertex (as many as `saved` holds)."""
    r = vertex
    for i in range(saved.shape[0]):
        for k in range(8):
            saved[i, k] = rows[r, k]
        saved_hints[i] = links[r, HINT]
        r = links[r, OTHER]
        if r == vertex:
            break


@hot
def restore_vertex(rows, links, vertex, saved, saved_hints):
    """Undo what was done to a vertex since `save_vertex`."""
    r = vertex
    for i in range(saved.shape[0]):
        for k in range(8):
            rows[r, k] = saved[i, k]
        links[r, HINT] = saved_hints[i]
        r = links[r, OTHER]
        if r == vertex:
            break


@hot
def move_inside(rows, links, vertex, foot, shift, scale, reference, point):
    """Put a vertex at the carrier's point nearest to foot + scale * shift, plus its offset.

    foot : (8,) line of `rows` from which the vertex starts (its offset is taken off again).
    """
    offset = foot[OFFSET]
    links[vertex, HINT] = place(
        reference,
        foot[0] - offset * foot[3] + scale * shift[0],
        foot[1] - offset * foot[4] + scale * shift[1],
        foot[2] - offset * foot[5] + scale * shift[2],
        links[vertex, HINT],
        offset,
        point,
    )
    for k in range(6):
        rows[vertex, k] = point[k]


@kernel
def feature_half(halves, fan, count, which):
    """First (0) or last (1) feature half-edge that leaves the centre of a fan; -1 if there is none.

    At an open boundary the last feature edge only arrives: -1.
    """
    found = -1
    for i in range(count):
        if halves[fan[i], CREASE] >= 0:
            found = fan[i]
            if which == 0:
                return found
    return found


@kernel
def slide(halves, links, rows, vertex, fan, count, parameter, curves, point):
    """Put a curve vertex at a parameter of its curve, with the normals of both sides."""
    for i in range(count):
        h = fan[i]
        code = halves[h, CREASE]
        if code < 0:
            continue
        put_on_curve(links, rows, halves[h, ORIGIN], vertex, code >> 1, code & 1, parameter,
                     curves, point)  # fmt: skip


@kernel
def put_on_curve(links, rows, row, vertex, curve, side, parameter, curves, point):
    """Set one row of a curve vertex from the curve: position, normal of its side, hint."""
    s, node = curve_point(curves, curve, parameter, point)
    for k in range(3):
        rows[row, k] = point[k]
        rows[row, 3 + k] = point[3 + 3 * side + k]
    rows[vertex, PARAMETER] = s
    if curves[2][node, side] >= 0:
        links[row, HINT] = curves[2][node, side]


@kernel
def curve_neighbours(halves, links, rows, vertex, fan, count, closed, sigma2, curves, result):
    """Signed parameter distance and 6D length to both neighbours on a vertex's curve.

    Writes (step, length^2) twice to `result` (4,); returns False if there are not two.
    """
    found = 0
    for i in range(count + 1):
        if i < count:
            h = fan[i]
            leaving = True
        elif not closed:
            h = preceding(fan[count - 1])
            leaving = False
        else:
            break
        if halves[h, CREASE] < 0 or found == 2 or (leaving and i > 0 and not closed):
            continue
        s_from, s_to = span(halves, links, rows, curves, h)
        result[2 * found] = s_to - s_from if leaving else s_from - s_to
        result[2 * found + 1] = squared_edge(rows, halves, h, sigma2)
        found += 1
    return found == 2
