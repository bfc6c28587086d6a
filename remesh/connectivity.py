"""Half-edges in flat arrays, and the three operations on them that change connectivity.

Half-edge h = 3 t + k runs from corner k of triangle t to corner k + 1, and the triangle lies on
its left. Three arrays hold a mesh:

halves : (3 m, 3) int64
    ORIGIN: the row at the half-edge's start (-1: the triangle is free); TWIN: the half-edge on
    the other side (-1: open boundary); CREASE: -1, or 2 * curve + direction for an edge of a
    feature curve, direction 0 where the half-edge runs along the curve.
links : (n, 7) int64
    One line per row. A row is a vertex as one smooth patch sees it: a vertex of a feature curve
    has one row per sector between its feature edges, all at the same position, each with its own
    normal. BASE: the first row of the vertex (-1: free); OTHER: the next row of the same vertex,
    cyclic; HINT: the carrier's triangle under it. On base rows only: OUT: a half-edge that leaves
    the vertex (on an open boundary the one without a twin, so that turning left meets all
    triangles); EDGES: how many edges meet; KIND: INTERIOR, CURVE or CORNER; IDEAL: how many edges
    should meet.
rows : (n, 8) float64
    Position, unit normal, offset along the normal from the carrier, parameter along the curve.

The operations here only rearrange: whether one is allowed is decided in `collapse`, `split` and
`flip`. `counts` holds [rows used, triangles used, first free row, first free triangle, vertices].
"""

from remesh.compiled import hot, kernel

ORIGIN, TWIN, CREASE = 0, 1, 2
BASE, OTHER, HINT, OUT, EDGES, KIND, IDEAL = range(7)
LINKS = 7
OFFSET, PARAMETER = 6, 7
INTERIOR, CURVE, CORNER = 0, 1, 2
ROWS, TRIANGLES, FREE_ROW, FREE_TRIANGLE, VERTICES = range(5)
MAX_RING = 128


@kernel
def following(h):
    """The next half-edge of the same triangle."""
    return h - 2 if h % 3 == 2 else h + 1


@kernel
def preceding(h):
    """The previous half-edge of the same triangle."""
    return h + 2 if h % 3 == 0 else h - 1


@hot
def ring(halves, links, vertex, out):
    """Write the half-edges that leave a vertex, turning left; return (how many, is it closed).

    (0, False) if there are more than `out` holds.
    """
    first = links[vertex, OUT]
    h = first
    count = 0
    while count < out.size:
        out[count] = h
        count += 1
        h = halves[preceding(h), TWIN]
        if h < 0:
            return count, False
        if h == first:
            return count, True
    return 0, False


@kernel
def target_base(halves, links, h):
    """The vertex at the end of a half-edge."""
    return links[halves[following(h), ORIGIN], BASE]


@hot
def adjacent(halves, links, a, b):
    """Whether vertices a and b share an edge."""
    first = links[a, OUT]
    h = first
    for _ in range(MAX_RING):
        if target_base(halves, links, h) == b:
            return True
        back = preceding(h)
        if links[halves[back, ORIGIN], BASE] == b:
            return True
        h = halves[back, TWIN]
        if h < 0 or h == first:
            return False
    return True


@kernel
def mirrored(crease):
    """The crease code of the half-edge on the other side."""
    return crease ^ 1 if crease >= 0 else crease


@kernel
def join(halves, h, g, crease):
    """Make h and g twins (g may be -1) with the crease code of h; g gets its mirror."""
    halves[h, TWIN] = g
    halves[h, CREASE] = crease
    if g >= 0:
        halves[g, TWIN] = h
        halves[g, CREASE] = mirrored(crease)


@kernel
def settle_out(halves, links, vertex, h):
    """Set OUT of a vertex from any half-edge that leaves it, turned right as far as it goes."""
    first = h
    while True:
        g = halves[h, TWIN]
        if g < 0:
            break
        h = following(g)
        if h == first:
            break
    links[vertex, OUT] = h


@kernel
def new_triangle(halves, counts):
    """Take a triangle from the free list or the end; -1 if the arrays are full."""
    t = counts[FREE_TRIANGLE]
    if t >= 0:
        counts[FREE_TRIANGLE] = halves[3 * t, TWIN]
        return t
    t = counts[TRIANGLES]
    if 3 * t >= halves.shape[0]:
        return -1
    counts[TRIANGLES] = t + 1
    return t


@kernel
def free_triangle(halves, counts, t):
    """Give a triangle back."""
    for k in range(3):
        halves[3 * t + k, ORIGIN] = -1
        halves[3 * t + k, CREASE] = -1
    halves[3 * t, TWIN] = counts[FREE_TRIANGLE]
    counts[FREE_TRIANGLE] = t


@kernel
def new_row(links, counts):
    """Take a row from the free list or the end; -1 if the arrays are full."""
    r = counts[FREE_ROW]
    if r >= 0:
        counts[FREE_ROW] = links[r, OUT]
        return r
    r = counts[ROWS]
    if r >= links.shape[0]:
        return -1
    counts[ROWS] = r + 1
    return r


@kernel
def free_vertex(links, counts, vertex):
    """Give all rows of a vertex back."""
    r = vertex
    while True:
        following_row = links[r, OTHER]
        links[r, BASE] = -1
        links[r, OUT] = counts[FREE_ROW]
        counts[FREE_ROW] = r
        r = following_row
        if r == vertex:
            break
    counts[VERTICES] -= 1


@kernel
def room(halves, links, counts, triangles, new_rows):
    """Whether that many triangles and rows can still be had (free lists counted as one each)."""
    more_triangles = counts[TRIANGLES] + triangles <= halves.shape[0] // 3
    return more_triangles and counts[ROWS] + new_rows <= links.shape[0]


@kernel
def flip_edge(halves, links, h):
    """Replace the edge a-b of half-edge h by c-d, its opposite corners."""
    g = halves[h, TWIN]
    t3, u3 = h - h % 3, g - g % 3
    n, p = following(h), preceding(h)
    gn, gp = following(g), preceding(g)
    a, b = halves[h, ORIGIN], halves[n, ORIGIN]
    c, d = halves[p, ORIGIN], halves[gp, ORIGIN]
    va, vb, vc, vd = links[a, BASE], links[b, BASE], links[c, BASE], links[d, BASE]
    twin_n, crease_n = halves[n, TWIN], halves[n, CREASE]
    twin_p, crease_p = halves[p, TWIN], halves[p, CREASE]
    twin_gn, crease_gn = halves[gn, TWIN], halves[gn, CREASE]
    twin_gp, crease_gp = halves[gp, TWIN], halves[gp, CREASE]
    if links[va, OUT] == h or links[va, OUT] == gn:
        links[va, OUT] = t3 + 1
    if links[vb, OUT] == g or links[vb, OUT] == n:
        links[vb, OUT] = u3 + 1
    if links[vc, OUT] == p:
        links[vc, OUT] = t3
    if links[vd, OUT] == gp:
        links[vd, OUT] = u3
    halves[t3, ORIGIN], halves[t3 + 1, ORIGIN], halves[t3 + 2, ORIGIN] = c, a, d
    halves[u3, ORIGIN], halves[u3 + 1, ORIGIN], halves[u3 + 2, ORIGIN] = d, b, c
    join(halves, t3, twin_p, crease_p)
    join(halves, t3 + 1, twin_gn, crease_gn)
    join(halves, t3 + 2, u3 + 2, -1)
    join(halves, u3, twin_gp, crease_gp)
    join(halves, u3 + 1, twin_n, crease_n)
    links[va, EDGES] -= 1
    links[vb, EDGES] -= 1
    links[vc, EDGES] += 1
    links[vd, EDGES] += 1


@kernel
def split_edge(halves, links, counts, labels, h, left, right):
    """Put a vertex with rows `left` (in the triangle of h) and `right` on the edge of h.

    The caller has made the rows, and sure that there is room for two triangles.
    """
    g = halves[h, TWIN]
    t3 = h - h % 3
    n, p = following(h), preceding(h)
    a, b, c = halves[h, ORIGIN], halves[n, ORIGIN], halves[p, ORIGIN]
    va, vb, vc, vm = links[a, BASE], links[b, BASE], links[c, BASE], links[left, BASE]
    code = halves[h, CREASE]
    twin_n, crease_n = halves[n, TWIN], halves[n, CREASE]
    twin_p, crease_p = halves[p, TWIN], halves[p, CREASE]
    x = new_triangle(halves, counts)
    x3 = 3 * x
    labels[x] = labels[t3 // 3]
    if links[va, OUT] == h:
        links[va, OUT] = t3 + 1
    if links[vb, OUT] == n:
        links[vb, OUT] = x3 + 2
    if links[vc, OUT] == p:
        links[vc, OUT] = t3
    halves[t3, ORIGIN], halves[t3 + 1, ORIGIN], halves[t3 + 2, ORIGIN] = c, a, left
    halves[x3, ORIGIN], halves[x3 + 1, ORIGIN], halves[x3 + 2, ORIGIN] = c, left, b
    join(halves, t3, twin_p, crease_p)
    join(halves, x3 + 2, twin_n, crease_n)
    join(halves, x3, t3 + 2, -1)
    links[vm, OUT] = x3 + 1
    links[vm, EDGES] = 3
    links[vc, EDGES] += 1
    if g < 0:
        join(halves, t3 + 1, -1, code)
        join(halves, x3 + 1, -1, code)
        return
    u3 = g - g % 3
    gn, gp = following(g), preceding(g)
    d = halves[gp, ORIGIN]
    vd = links[d, BASE]
    twin_gn, crease_gn = halves[gn, TWIN], halves[gn, CREASE]
    twin_gp, crease_gp = halves[gp, TWIN], halves[gp, CREASE]
    a_right, b_right = halves[gn, ORIGIN], halves[g, ORIGIN]
    y = new_triangle(halves, counts)
    y3 = 3 * y
    labels[y] = labels[u3 // 3]
    if links[va, OUT] == gn:
        links[va, OUT] = u3 + 2
    if links[vb, OUT] == g:
        links[vb, OUT] = y3 + 1
    if links[vd, OUT] == gp:
        links[vd, OUT] = y3
    halves[u3, ORIGIN], halves[u3 + 1, ORIGIN], halves[u3 + 2, ORIGIN] = d, right, a_right
    halves[y3, ORIGIN], halves[y3 + 1, ORIGIN], halves[y3 + 2, ORIGIN] = d, b_right, right
    join(halves, u3 + 2, twin_gn, crease_gn)
    join(halves, y3, twin_gp, crease_gp)
    join(halves, u3, y3 + 2, -1)
    join(halves, t3 + 1, u3 + 1, code)
    join(halves, x3 + 1, y3 + 1, code)
    links[vm, EDGES] = 4
    links[vd, EDGES] += 1


@kernel
def close_gap(halves, links, counts, h):
    """Take out the triangle of half-edge h (between merged vertices) and join its other sides.

    Returns a half-edge that leaves the merged vertex.
    """
    n, p = following(h), preceding(h)
    opposite = links[halves[p, ORIGIN], BASE]
    twin_n, twin_p = halves[n, TWIN], halves[p, TWIN]
    code = halves[n, CREASE]  # of target(h) -> opposite
    if code < 0:
        code = mirrored(halves[p, CREASE])  # of opposite -> origin(h)
    free_triangle(halves, counts, h // 3)
    links[opposite, EDGES] -= 1
    # twin_p runs origin(h) -> opposite, as n does after the merge; twin_n runs back
    if twin_p < 0:
        join(halves, twin_n, twin_p, mirrored(code))
        settle_out(halves, links, opposite, twin_n)
        return following(twin_n)
    join(halves, twin_p, twin_n, code)
    settle_out(halves, links, opposite, following(twin_p))
    return twin_p


@kernel
def collapse_edge(halves, links, counts, h, remove_origin, fan, fan_size):
    """Merge the vertex `removed` (origin or target of h) into the other one.

    `fan` lists the half-edges that leave the removed vertex.
    """
    g = halves[h, TWIN]
    n = following(h)
    origin_left, target_left = halves[h, ORIGIN], halves[n, ORIGIN]
    origin_right, target_right = origin_left, target_left
    if g >= 0:
        target_right, origin_right = halves[g, ORIGIN], halves[following(g), ORIGIN]
    if remove_origin:
        gone, keep_left, keep_right = origin_left, target_left, target_right
    else:
        gone, keep_left, keep_right = target_left, origin_left, origin_right
    removed, kept = links[gone, BASE], links[keep_left, BASE]
    edges = links[removed, EDGES] + links[kept, EDGES] - 3
    for i in range(fan_size):
        f = fan[i]
        halves[f, ORIGIN] = keep_left if halves[f, ORIGIN] == gone else keep_right
    leaving = close_gap(halves, links, counts, h)
    if g >= 0:
        leaving = close_gap(halves, links, counts, g)
        edges -= 1
    links[kept, EDGES] = edges
    settle_out(halves, links, kept, leaving)
    free_vertex(links, counts, removed)
