"""Closest point on the carrier's triangles, restricted to one patch, from a nearby triangle.

The carrier (see `carrier`) is the triangulation that vertices are moved on. Its kernels take
`reference`, a tuple of arrays:

corners : (m, 12) float64
    First corner, the two edges from it, and the edges' three dot products.
normals : (m, 9) float64
    The surface's unit normals at the three corners.
sides : (m, 4) int64
    The neighbours across the edges (0, 1), (1, 2), (2, 0), -1 at feature edges; the patch.
cell_start, cell_triangles : int64
    Triangles by cell of a regular grid.
cell_boxes : (e, 6) float32
    Bounding box of each triangle listed in a cell, from the grid's corner, rounded outward: read
    in order, where the triangles themselves would be fetched from all over the memory.
grid : (7,) float64
    Lower corner, cell size, and the number of cells along each axis.
"""

import math

from remesh.compiled import hot, kernel

MOST_CROSSINGS = 40
INSIDE = 1.0 - 1e-12  # barycentric sum below which a point is not on the far edge
SAME_DISTANCE = 1.0 + 1e-9
ROUNDING = 3e-7  # relative: float32 keeps boxes that are larger by this outside
NEAR = 0.25  # of a cell: a walk that ends farther off is not trusted


@hot
def clipped(x):
    """x limited to [0, 1]."""
    return min(max(x, 0.0), 1.0)


@hot
def triangle_distance(corners, t, x, y, z):
    """Closest point of triangle t as barycentric (v, w), and the squared distance to it."""
    px, py, pz = x - corners[t, 0], y - corners[t, 1], z - corners[t, 2]
    ux, uy, uz = corners[t, 3], corners[t, 4], corners[t, 5]
    vx, vy, vz = corners[t, 6], corners[t, 7], corners[t, 8]
    uu, uv, vv = corners[t, 9], corners[t, 10], corners[t, 11]
    pu = px * ux + py * uy + pz * uz
    pv = px * vx + py * vy + pz * vz
    determinant = uu * vv - uv * uv
    v = vv * pu - uv * pv
    w = uu * pv - uv * pu
    if determinant > 1e-14 * uu * vv and v >= 0.0 and w >= 0.0 and v + w <= determinant:
        v /= determinant
        w /= determinant
    else:  # the nearest point of the three edges
        v, w = clipped(pu / uu) if uu > 0.0 else 0.0, 0.0
        least = v * (v * uu - 2.0 * pu)
        s = clipped(pv / vv) if vv > 0.0 else 0.0
        square = s * (s * vv - 2.0 * pv)
        if square < least:
            least, v, w = square, 0.0, s
        across = uu - 2.0 * uv + vv
        s = clipped((uu - uv - pu + pv) / across) if across > 0.0 else 0.0
        square = (1.0 - s) * ((1.0 - s) * uu + 2.0 * s * uv - 2.0 * pu) + s * (s * vv - 2.0 * pv)
        if square < least:
            v, w = 1.0 - s, s
    dx, dy, dz = px - v * ux - w * vx, py - v * uy - w * vy, pz - v * uz - w * vz
    return v, w, dx * dx + dy * dy + dz * dz


@hot
def walk(reference, x, y, z, hint):
    """Triangle reached from `hint` by crossing edges towards a point: (t, v, w, distance^2).

    The walk stays in its patch and goes round a vertex where that is nearest. It ends at a local
    minimum of the distance, which is the nearest point of all for steps along the surface that
    are short compared with its curvature.
    """
    corners, sides = reference[0], reference[2]
    nearest, here, before = hint, hint, -1
    v, w, least = triangle_distance(corners, hint, x, y, z)
    best_v, best_w, distance = v, w, least
    for _ in range(MOST_CROSSINGS):
        after, after_v, after_w, square = -1, 0.0, 0.0, math.inf
        for k in range(3):
            crossed = (w <= 0.0) if k == 0 else (v + w >= INSIDE if k == 1 else v <= 0.0)
            t = sides[here, k] if crossed else -1
            if t >= 0 and t != before:
                trial_v, trial_w, trial = triangle_distance(corners, t, x, y, z)
                if trial < square:
                    after, after_v, after_w, square = t, trial_v, trial_w, trial
        if after < 0 or square > SAME_DISTANCE * distance:
            break
        before, here, v, w, distance = here, after, after_v, after_w, square
        if square < least:
            nearest, best_v, best_w, least = here, v, w, square
    return nearest, best_v, best_w, least


@kernel
def closest(reference, x, y, z, hint):
    """Nearest triangle of the patch of `hint`, barycentric (v, w) on it, squared distance.

    A walk from the hint gives a bound; the cells within that bound make it exact.
    """
    corners, _, sides, cell_start, cell_triangles, cell_boxes, grid = reference
    nearest, best_v, best_w, least = walk(reference, x, y, z, hint)
    patch = sides[hint, 3]
    size = grid[3]
    radius = math.sqrt(least)
    px, py, pz = x - grid[0], y - grid[1], z - grid[2]
    ny, nz = int(grid[5]), int(grid[6])
    i0, i1 = max(int((px - radius) / size), 0), min(int((px + radius) / size), int(grid[4]) - 1)
    j0, j1 = max(int((py - radius) / size), 0), min(int((py + radius) / size), ny - 1)
    k0, k1 = max(int((pz - radius) / size), 0), min(int((pz + radius) / size), nz - 1)
    for i in range(i0, i1 + 1 if k0 <= k1 else i0):
        for j in range(j0, j1 + 1):
            cell = (i * ny + j) * nz
            for entry in range(cell_start[cell + k0], cell_start[cell + k1 + 1]):
                dx = max(cell_boxes[entry, 0] - px, max(px - cell_boxes[entry, 3], 0.0))
                dy = max(cell_boxes[entry, 1] - py, max(py - cell_boxes[entry, 4], 0.0))
                dz = max(cell_boxes[entry, 2] - pz, max(pz - cell_boxes[entry, 5], 0.0))
                if dx * dx + dy * dy + dz * dz >= least:
                    continue
                t = cell_triangles[entry]
                if t == nearest or sides[t, 3] != patch:
                    continue
                v, w, square = triangle_distance(corners, t, x, y, z)
                if square < least:
                    least, nearest, best_v, best_w = square, t, v, w
    return nearest, best_v, best_w, least


@hot
def near(reference, x, y, z, hint):
    """What `walk` finds, or `closest` where that is far off."""
    t, v, w, square = walk(reference, x, y, z, hint)
    trusted = NEAR * reference[6][3]
    if square > trusted * trusted:
        return closest(reference, x, y, z, t)
    return t, v, w, square


@hot
def point_and_normal(reference, t, v, w, out):
    """Write the point (v, w) of carrier triangle t and the normal interpolated there (6,)."""
    corners, normals = reference[0], reference[1]
    u = 1.0 - v - w
    length = 0.0
    for k in range(3):
        out[k] = corners[t, k] + v * corners[t, 3 + k] + w * corners[t, 6 + k]
        n = u * normals[t, k] + v * normals[t, 3 + k] + w * normals[t, 6 + k]
        out[3 + k] = n
        length += n * n
    length = math.sqrt(length)
    if length > 0.0:
        for k in range(3):
            out[3 + k] /= length


@hot
def place(reference, x, y, z, hint, offset, out):
    """Point of the carrier near (x, y, z), moved by `offset` along the normal there.

    Writes position and normal to `out` (6,), returns the carrier's triangle.
    """
    t, v, w, _ = near(reference, x, y, z, hint)
    point_and_normal(reference, t, v, w, out)
    for k in range(3):
        out[k] += offset * out[3 + k]
    return t


@kernel
def describe_triangles(points, faces, labels, twins, crease, corners, sides, boxes):
    """Write what `reference` says of every triangle, and its bounding box (m, 6)."""
    for t in range(faces.shape[0]):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        uu, uv, vv = 0.0, 0.0, 0.0
        for k in range(3):
            p, u, v = points[a, k], points[b, k] - points[a, k], points[c, k] - points[a, k]
            corners[t, k], corners[t, 3 + k], corners[t, 6 + k] = p, u, v
            uu, uv, vv = uu + u * u, uv + u * v, vv + v * v
            boxes[t, k] = min(p, min(points[b, k], points[c, k]))
            boxes[t, 3 + k] = max(p, max(points[b, k], points[c, k]))
            h = 3 * t + k
            sides[t, k] = -1 if crease[h] else twins[h] // 3
        corners[t, 9], corners[t, 10], corners[t, 11] = uu, uv, vv
        sides[t, 3] = labels[t]


@kernel
def cell_of(boxes, grid, t, first):
    """The grid's cell with a corner of a box: the lower (first = 0) or the upper one (3)."""
    return (
        int((boxes[t, first] - grid[0]) / grid[3]),
        int((boxes[t, first + 1] - grid[1]) / grid[3]),
        int((boxes[t, first + 2] - grid[2]) / grid[3]),
    )


@kernel
def count_cells(boxes, grid, starts):
    """First pass of the grid: starts[cell + 1] += 1 for each triangle's box."""
    ny, nz = int(grid[5]), int(grid[6])
    for t in range(boxes.shape[0]):
        x0, y0, z0 = cell_of(boxes, grid, t, 0)
        x1, y1, z1 = cell_of(boxes, grid, t, 3)
        for i in range(x0, x1 + 1):
            for j in range(y0, y1 + 1):
                for k in range(z0, z1 + 1):
                    starts[(i * ny + j) * nz + k + 1] += 1


@kernel
def fill_cells(boxes, grid, position, triangles, cell_boxes):
    """Second pass: list the triangles of each cell; `position` starts as the cells' starts."""
    ny, nz = int(grid[5]), int(grid[6])
    for t in range(boxes.shape[0]):
        x0, y0, z0 = cell_of(boxes, grid, t, 0)
        x1, y1, z1 = cell_of(boxes, grid, t, 3)
        for i in range(x0, x1 + 1):
            for j in range(y0, y1 + 1):
                for k in range(z0, z1 + 1):
                    cell = (i * ny + j) * nz + k
                    at = position[cell]
                    triangles[at] = t
                    for z in range(3):
                        low, high = boxes[t, z] - grid[z], boxes[t, 3 + z] - grid[z]
                        cell_boxes[at, z] = low - ROUNDING * abs(low)
                        cell_boxes[at, 3 + z] = high + ROUNDING * abs(high)
                    position[cell] += 1


@kernel
def closest_many(reference, points, hints, triangles, barycentric):
    """`closest` for points (n, 3): triangles (n,), (v, w, distance^2) in barycentric (n, 3)."""
    for i in range(points.shape[0]):
        t, v, w, square = closest(reference, points[i, 0], points[i, 1], points[i, 2], hints[i])
        triangles[i] = t
        barycentric[i, 0], barycentric[i, 1], barycentric[i, 2] = v, w, square
