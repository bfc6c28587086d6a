"""Kernels that bound the distance of triangles from another surface. Slow twin: dense samples.

A piece of a triangle (again a triangle) whose three corners lie within d of one and the same
triangle of the other surface lies within d of it altogether, because the distance from a convex
set is convex. Pieces for which that does not suffice are cut: along the planes through the edges
of the nearest triangle, perpendicular to it, or else in two halves.

A piece is a row of 10: its three corners, and the place of a triangle nearby. `tree` and
`neighbours` are those of `meshes.closest_point.ClosestPoint`.
"""

import math

from numba import njit

from meshes.closest_point_kernels import (
    FAR,
    box_distance,
    closest_in_tree,
    closest_on_triangle,
    walk,
)

kernel = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
ENOUGH = 1.01  # upper over lower bound
LEAST_CUT = 0.02  # of a piece's radius: less is not cut off
SMALLEST = 0.5  # of the limit: smaller pieces are not cut for the sake of the normals
MOST_WAITING = 128
CUTS_WAITING = 48  # more pieces that wait: halves alone, which get small for certain
MOST_FOR_NORMALS = 200  # pieces of one triangle
MOST_PIECES = 200_000  # of one triangle; after that bounds are left as loose as they are


@kernel
def nearest(x, y, z, hint, tree, neighbours, nodes, squares):
    """Nearest triangle to a point, from a triangle nearby: (place, squared distance)."""
    t, v, w, least = walk(x, y, z, hint, tree[3], neighbours)
    t, v, w, least = closest_in_tree(x, y, z, t, v, w, least, tree, nodes, squares)
    return t, least


@kernel
def corner_distance(piece, triangle):
    """Largest squared distance of a piece's corners from a triangle, and which corner it is."""
    most, which = -1.0, 0
    for k in range(3):
        square = closest_on_triangle(
            piece[3 * k], piece[3 * k + 1], piece[3 * k + 2], triangle, FAR
        )[2]
        if square > most:
            most, which = square, k
    return most, which


@kernel
def radius_about(piece, x, y, z):
    """Largest distance of a piece's corners from a point."""
    most = 0.0
    for k in range(3):
        most = max(
            most,
            (piece[3 * k] - x) ** 2 + (piece[3 * k + 1] - y) ** 2 + (piece[3 * k + 2] - z) ** 2,
        )
    return math.sqrt(most)


@kernel
def cosine_to(normal, triangle):
    """Cosine between a unit normal and a triangle's; -1 for a triangle without area."""
    x, y, z = triangle[9], triangle[10], triangle[11]
    size = math.sqrt(x * x + y * y + z * z)
    if size <= 0.0:
        return -1.0
    return (normal[0] * x + normal[1] * y + normal[2] * z) / size


@kernel
def best_cosine(piece, normal, cx, cy, cz, limit2, best, tree, nodes):
    """Best cosine between the normal and that of a triangle within `limit` of the whole piece."""
    boxes, begin, end, triangles, leaves = tree
    nodes[0], depth = 0, 1
    while depth:
        depth -= 1
        node = nodes[depth]
        if box_distance(boxes, node, cx, cy, cz) > limit2:
            continue
        if node < leaves - 1:
            nodes[depth], nodes[depth + 1] = 2 * node + 2, 2 * node + 1
            depth += 2
            continue
        for t in range(begin[node], end[node]):
            cosine = cosine_to(normal, triangles[t])
            if cosine > best and corner_distance(piece, triangles[t])[0] <= limit2:
                best = cosine
    return best


@kernel
def best_plane(piece, triangle, least, sides, best_sides):
    """Fill best_sides (3,) with the corners' distances from the plane that cuts a piece best.

    Returns whether one of the planes through the triangle's edges cuts off more than `least`.
    """
    nx, ny, nz = triangle[9], triangle[10], triangle[11]
    most = least
    for k in range(3):
        if k == 0:
            px, py, pz = 0.0, 0.0, 0.0
            ex, ey, ez = triangle[3], triangle[4], triangle[5]
        elif k == 1:
            px, py, pz = triangle[3], triangle[4], triangle[5]
            ex, ey, ez = triangle[6] - px, triangle[7] - py, triangle[8] - pz
        else:
            px, py, pz = triangle[6], triangle[7], triangle[8]
            ex, ey, ez = -px, -py, -pz
        mx, my, mz = ey * nz - ez * ny, ez * nx - ex * nz, ex * ny - ey * nx
        size = math.sqrt(mx * mx + my * my + mz * mz)
        if size <= 0.0:
            continue
        low, high = FAR, -FAR
        for i in range(3):
            side = (
                (piece[3 * i] - triangle[0] - px) * mx
                + (piece[3 * i + 1] - triangle[1] - py) * my
                + (piece[3 * i + 2] - triangle[2] - pz) * mz
            ) / size
            sides[i] = side
            low, high = min(low, side), max(high, side)
        if min(high, -low) > most:
            most = min(high, -low)
            for i in range(3):
                best_sides[i] = sides[i]
    return most > least


@kernel
def put_corner(pieces, row, k, piece, i, j, s):
    """Corner k of a row becomes the point at s on the way from corner i to corner j of a piece."""
    for d in range(3):
        pieces[row, 3 * k + d] = (1.0 - s) * piece[3 * i + d] + s * piece[3 * j + d]


@kernel
def cut_by_plane(piece, sides, pieces, depth):
    """Push the three parts into which a plane cuts a piece; returns the new depth."""
    lone = 0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        if (sides[i] >= 0.0) == (sides[j] >= 0.0):
            lone = k
    i, j = (lone + 1) % 3, (lone + 2) % 3
    s = sides[lone] / (sides[lone] - sides[i])
    r = sides[lone] / (sides[lone] - sides[j])
    for row in range(depth, depth + 3):
        pieces[row, 9] = piece[9]
    put_corner(pieces, depth, 0, piece, lone, lone, 0.0)
    put_corner(pieces, depth, 1, piece, lone, i, s)
    put_corner(pieces, depth, 2, piece, lone, j, r)
    put_corner(pieces, depth + 1, 0, piece, lone, i, s)
    put_corner(pieces, depth + 1, 1, piece, i, i, 0.0)
    put_corner(pieces, depth + 1, 2, piece, j, j, 0.0)
    put_corner(pieces, depth + 2, 0, piece, lone, i, s)
    put_corner(pieces, depth + 2, 1, piece, j, j, 0.0)
    put_corner(pieces, depth + 2, 2, piece, lone, j, r)
    return depth + 3


@kernel
def halve(piece, pieces, depth):
    """Push the two halves of a piece, cut across its longest edge; returns the new depth."""
    longest, which = -1.0, 0
    for k in range(3):
        j = (k + 1) % 3
        square = 0.0
        for d in range(3):
            square += (piece[3 * k + d] - piece[3 * j + d]) ** 2
        if square > longest:
            longest, which = square, k
    i, j, k = which, (which + 1) % 3, (which + 2) % 3
    for row in range(depth, depth + 2):
        pieces[row, 9] = piece[9]
        put_corner(pieces, row, 1, piece, i, j, 0.5)
        put_corner(pieces, row, 2, piece, k, k, 0.0)
    put_corner(pieces, depth, 0, piece, i, i, 0.0)
    put_corner(pieces, depth + 1, 0, piece, j, j, 0.0)
    return depth + 2


@kernel
def bound_faces(
    corners, normals, first, last, block, tree, neighbours, limits, nodes, squares, pieces,
    bounds, places,
):  # fmt: skip
    """Fill bounds (m, 3) and places (m, 3) for the triangles first ... last.

    Parameters
    ----------
    corners : (m, 9), normals : (m, 3)
    block : faces are searched from the place of the one before, but the first of every block
    limits : (floor, limit, cosine)
        Upper bounds below the floor need not be sharp; the normal is looked for within `limit`;
        cosines above the last are good enough.
    nodes (STACK,) int32, squares (STACK,), pieces (MOST_WAITING + 4, 10)
        Room to work in.
    bounds : upper and lower bound of the largest distance, lower bound of the cosine
    places : a point where the lower bound is taken, or if that is below the floor the cosine's
    """
    floor, limit, goal = limits
    piece, sides, best_sides = pieces[MOST_WAITING + 3], squares[:3], squares[3:6]
    room, t = squares[6:], 0
    for f in range(first, last):
        upper, lower, cosine = 0.0, 0.0, 1.0
        pieces[0, :9] = corners[f]
        if (f - first) % block == 0:
            x, y, z = corners[f, 0], corners[f, 1], corners[f, 2]
            t = closest_in_tree(x, y, z, 0, 0.0, 0.0, FAR, tree, nodes, room)[0]
        pieces[0, 9] = t
        for d in range(3):
            places[f, d] = (corners[f, d] + corners[f, 3 + d] + corners[f, 6 + d]) / 3.0
        depth, count = 1, 0
        while depth:
            depth -= 1
            count += 1
            piece[:] = pieces[depth]
            cx = (piece[0] + piece[3] + piece[6]) / 3.0
            cy = (piece[1] + piece[4] + piece[7]) / 3.0
            cz = (piece[2] + piece[5] + piece[8]) / 3.0
            t, v, w, square = walk(cx, cy, cz, int(piece[9]), tree[3], neighbours)
            radius = radius_about(piece, cx, cy, cz)
            most, which = corner_distance(piece, tree[3][t])
            bound = min(math.sqrt(most), math.sqrt(square) + radius)
            if bound > floor:  # what the walk has found is not near enough
                t, v, w, square = closest_in_tree(cx, cy, cz, t, v, w, square, tree, nodes, room)
                if square > lower * lower:
                    lower = math.sqrt(square)
                    places[f, 0], places[f, 1], places[f, 2] = cx, cy, cz
                most, which = corner_distance(piece, tree[3][t])
                bound = min(math.sqrt(most), math.sqrt(square) + radius)
            piece[9] = t
            if bound > floor and bound > ENOUGH * lower:
                x, y, z = piece[3 * which], piece[3 * which + 1], piece[3 * which + 2]
                _, square = nearest(x, y, z, t, tree, neighbours, nodes, room)
                if square > lower * lower:
                    lower = math.sqrt(square)
                    places[f, 0], places[f, 1], places[f, 2] = x, y, z
            full = depth > MOST_WAITING - 3 or count > MOST_PIECES
            sharp = floor if lower <= floor else ENOUGH * lower
            if bound <= sharp or full:
                here = cosine_to(normals[f], tree[3][t]) if bound <= limit else -1.0
                if here < min(goal, cosine) and bound <= limit:
                    here = best_cosine(
                        piece, normals[f], cx, cy, cz, limit * limit, here, tree, nodes
                    )
                if (
                    here >= min(goal, cosine)
                    or radius < SMALLEST * limit
                    or full
                    or count > MOST_FOR_NORMALS
                ):
                    if here < cosine and lower <= floor:
                        places[f, 0], places[f, 1], places[f, 2] = cx, cy, cz
                    upper, cosine = max(upper, bound), min(cosine, here)
                    continue
                depth = halve(piece, pieces, depth)
            elif depth < CUTS_WAITING and best_plane(
                piece, tree[3][t], LEAST_CUT * radius, sides, best_sides
            ):
                depth = cut_by_plane(piece, best_sides, pieces, depth)
            else:
                depth = halve(piece, pieces, depth)
        bounds[f, 0], bounds[f, 1], bounds[f, 2] = upper, lower, cosine
