"""Kernels that find the closest point of a triangulation. Slow twin: tests.meshes.reference.

`triangles` (m, 12) holds for each triangle its first corner, the two edges u and v from it, and
n = u x v. `tree` is the tuple (boxes, begin, end, triangles in the order of the leaves, leaves).
"""

from numba import njit

kernel = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
NEEDLE = 1e-8  # squared sine of the angle between u and v under which the edges are tried too
FAR = 1e300
STACK = 64


@kernel
def clipped(x):
    """x limited to [0, 1]."""
    return min(max(x, 0.0), 1.0)


@kernel
def closest_on_edges(px, py, pz, triangle):
    """Closest point (v, w) on the triangle's outline, and its squared distance from p."""
    ux, uy, uz = triangle[3], triangle[4], triangle[5]
    vx, vy, vz = triangle[6], triangle[7], triangle[8]
    ex, ey, ez = vx - ux, vy - uy, vz - uz
    uu = ux * ux + uy * uy + uz * uz
    vv = vx * vx + vy * vy + vz * vz
    ee = ex * ex + ey * ey + ez * ez
    s = clipped((px * ux + py * uy + pz * uz) / uu) if uu > 0.0 else 0.0
    dx, dy, dz = px - s * ux, py - s * uy, pz - s * uz
    v, w, least = s, 0.0, dx * dx + dy * dy + dz * dz
    s = clipped((px * vx + py * vy + pz * vz) / vv) if vv > 0.0 else 0.0
    dx, dy, dz = px - s * vx, py - s * vy, pz - s * vz
    square = dx * dx + dy * dy + dz * dz
    if square < least:
        v, w, least = 0.0, s, square
    qx, qy, qz = px - ux, py - uy, pz - uz
    s = clipped((qx * ex + qy * ey + qz * ez) / ee) if ee > 0.0 else 0.0
    dx, dy, dz = qx - s * ex, qy - s * ey, qz - s * ez
    square = dx * dx + dy * dy + dz * dz
    if square < least:
        v, w, least = 1.0 - s, s, square
    return v, w, least


@kernel
def closest_on_triangle(x, y, z, triangle, limit):
    """Closest point a + v u + w v of a triangle to (x, y, z): (v, w, squared distance).

    Right for needles and for triangles without area too. Where the squared distance is known to
    exceed `limit` from the lines of the edges alone, FAR comes back for it.
    """
    px, py, pz = x - triangle[0], y - triangle[1], z - triangle[2]
    ux, uy, uz = triangle[3], triangle[4], triangle[5]
    vx, vy, vz = triangle[6], triangle[7], triangle[8]
    nx, ny, nz = triangle[9], triangle[10], triangle[11]
    nn = nx * nx + ny * ny + nz * nz
    uu = ux * ux + uy * uy + uz * uz
    vv = vx * vx + vy * vy + vz * vz
    v = (py * vz - pz * vy) * nx + (pz * vx - px * vz) * ny + (px * vy - py * vx) * nz
    w = (uy * pz - uz * py) * nx + (uz * px - ux * pz) * ny + (ux * py - uy * px) * nz
    needle = nn < NEEDLE * uu * vv
    if nn <= 0.0 or v < 0.0 or w < 0.0 or v + w > nn:
        # Beyond an edge's line: v / |n| is |edge v| times the distance from it in the plane.
        if not needle and (
            (v < 0.0 and v * v > 1.0001 * limit * vv * nn)
            or (w < 0.0 and w * w > 1.0001 * limit * uu * nn)
        ):
            return 0.0, 0.0, FAR
        return closest_on_edges(px, py, pz, triangle)
    v /= nn
    w /= nn
    dx, dy, dz = px - v * ux - w * vx, py - v * uy - w * vy, pz - v * uz - w * vz
    square = dx * dx + dy * dy + dz * dz
    if needle:
        v2, w2, square2 = closest_on_edges(px, py, pz, triangle)
        if square2 < square:
            return v2, w2, square2
    return v, w, square


@kernel
def box_distance(boxes, node, x, y, z):
    """Squared distance of (x, y, z) from a node's box."""
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel
def walk(x, y, z, start, triangles, neighbours):
    """Go from triangle `start` to nearer neighbours as long as there are any: (t, v, w, d2)."""
    best = before = start
    v, w, least = closest_on_triangle(x, y, z, triangles[start], FAR)
    while True:
        here = best
        for k in range(3):
            other = neighbours[here, k]
            if other >= 0 and other != before:
                v2, w2, square = closest_on_triangle(x, y, z, triangles[other], least)
                if square < least:
                    best, v, w, least = other, v2, w2, square
        if best == here:
            return best, v, w, least
        before = here


@kernel
def closest_in_tree(x, y, z, best, v, w, least, tree, nodes, squares):
    """Search the tree for a triangle nearer than `least`: (t, v, w, squared distance).

    nodes (STACK,) int32 and squares (STACK,) float64 are room to work in.
    """
    boxes, begin, end, triangles, leaves = tree
    nodes[0], squares[0], depth = 0, 0.0, 1
    while depth:
        depth -= 1
        if squares[depth] >= least:
            continue
        node = nodes[depth]
        while node < leaves - 1:  # down to the nearest leaf, the farther halves for later
            node = 2 * node + 1
            near = box_distance(boxes, node, x, y, z)
            far = box_distance(boxes, node + 1, x, y, z)
            other = node + 1
            if far < near:
                near, far = far, near
                other, node = node, node + 1
            if far < least:
                nodes[depth], squares[depth] = other, far
                depth += 1
            if near >= least:
                break
        else:
            for t in range(begin[node], end[node]):
                v2, w2, square = closest_on_triangle(x, y, z, triangles[t], least)
                if square < least:
                    best, v, w, least = t, v2, w2, square
    return best, v, w, least


@kernel
def closest_points(points, hints, first, last, tree, neighbours, nodes, squares, found, result):
    """Fill found (n,) and result (n, 3) = (v, w, squared distance) for points[first:last].

    hints (n,) are triangles to begin at, -1 for none. A point with NaN finds -1.
    """
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        best, v, w, least = -1, 0.0, 0.0, FAR
        if hints[i] >= 0:
            best, v, w, least = walk(x, y, z, hints[i], tree[3], neighbours)
        best, v, w, least = closest_in_tree(x, y, z, best, v, w, least, tree, nodes, squares)
        found[i] = best
        result[i, 0], result[i, 1], result[i, 2] = v, w, least
