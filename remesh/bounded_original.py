"""Kernels that hold triangles to the original: near it, and not against its normals.

`reference` is (tree, neighbours, normals): of `meshes.closest_point.ClosestPoint` the first two;
normals (m, 9) are the original's at the corners of its triangles, in the tree's order.
"""

import math

from meshes.closest_point_kernels import closest_in_tree, walk
from meshes.distance_bound_kernels import (
    CUTS_WAITING,
    LEAST_CUT,
    MOST_WAITING,
    best_plane,
    corner_distance,
    cut_by_plane,
    halve,
    radius_about,
)
from remesh.compiled import kernel

WITHIN_V, WITHIN_W = (0.3, 0.7, 1.0 / 3.0), (0.0, 0.0, 1.0 / 3.0)  # of a star's triangles
CHECK_V = (0.0, 1.0, 0.0, 0.5, 0.0, 0.5, 1.0 / 3.0)
CHECK_W = (0.0, 0.0, 1.0, 0.0, 0.5, 0.5, 1.0 / 3.0)
MOST_PIECES = 3000  # of one triangle, until it is given up
LEAST_COSINE = 0.05  # between a triangle and the original's normal at its centroid


@kernel
def place_near(x, y, z, limit2, t, reference, nodes, squares):
    """A place of the original within the distance allowed, else the closest: (t, v, w, square).

    t is the place of a triangle nearby. Only where none is found on the way from there, all are
    searched.
    """
    tree, neighbours, _ = reference
    t, v, w, least = walk(x, y, z, t, tree[3], neighbours)
    if least > limit2:
        t, v, w, least = closest_in_tree(x, y, z, t, v, w, least, tree, nodes, squares)
    return t, v, w, least


@kernel
def turned_against(star, i, t, v, w, reference):
    """Whether a star's triangle turns away from the original at (v, w) of its triangle t.

    From the interpolated normal there, or from the triangle's own.
    """
    tree, _, normals = reference
    flat, u = tree[3], 1.0 - v - w
    dot, square, own = 0.0, 0.0, 0.0
    for d in range(3):
        normal = u * normals[t, d] + v * normals[t, 3 + d] + w * normals[t, 6 + d]
        dot += normal * star[i, 9 + d]
        own += flat[t, 9 + d] * star[i, 9 + d]
        square += normal * normal
    size = star[i, 9] ** 2 + star[i, 10] ** 2 + star[i, 11] ** 2
    return own < 0.0 or dot < LEAST_COSINE * math.sqrt(square * size)


@kernel
def inverted_in(star, i, x, y, z, t, reference, nodes, squares):
    """Whether a star's triangle with centroid (x, y, z) lies against the original's normal there.

    t is the place of a triangle nearby, from which the search begins.
    """
    tree, neighbours, _ = reference
    t, v, w, least = walk(x, y, z, t, tree[3], neighbours)
    if not turned_against(star, i, t, v, w, reference):
        return False
    t, v, w, _ = closest_in_tree(x, y, z, t, v, w, least, tree, nodes, squares)
    return turned_against(star, i, t, v, w, reference)


@kernel
def inverted_count(star, count, t, reference, nodes, squares):
    """How many triangles of a star lie against the original's normals at their centroids."""
    found = 0
    for i in range(count):
        x = star[i, 0] + (star[i, 3] + star[i, 6]) / 3.0
        y = star[i, 1] + (star[i, 4] + star[i, 7]) / 3.0
        z = star[i, 2] + (star[i, 5] + star[i, 8]) / 3.0
        if inverted_in(star, i, x, y, z, t, reference, nodes, squares):
            found += 1
    return found


@kernel
def wrong_count(star, count, limit2, t, reference, nodes, squares):
    """How many triangles of a star lie against the original's normals, or too far from it.

    The latter by their corners, centroids and the middles of their edges.
    """
    found = 0
    for i in range(count):
        wrong = False
        for k in range(len(CHECK_V)):
            v, w = CHECK_V[k], CHECK_W[k]
            x = star[i, 0] + v * star[i, 3] + w * star[i, 6]
            y = star[i, 1] + v * star[i, 4] + w * star[i, 7]
            z = star[i, 2] + v * star[i, 5] + w * star[i, 8]
            t, _, _, square = place_near(x, y, z, limit2, t, reference, nodes, squares)
            wrong |= square > limit2
        if wrong or inverted_in(star, i, x, y, z, t, reference, nodes, squares):
            found += 1
    return found


@kernel
def leaves_original(star, count, x, limit2, t, reference, nodes, squares):
    """Whether a star's vertex, or points within its triangles, are too far from the original.

    Also whether a triangle lies against its normals. t is the place of a triangle nearby.
    """
    t, _, _, square = place_near(x[0], x[1], x[2], limit2, t, reference, nodes, squares)
    if square > limit2:
        return True
    start = t
    for i in range(count):
        for k in range(3):  # one and two thirds along the spoke, and the centroid
            v = WITHIN_V[k]
            w = WITHIN_W[k]
            px = x[0] + v * star[i, 3] + w * star[i, 6]
            py = x[1] + v * star[i, 4] + w * star[i, 7]
            pz = x[2] + v * star[i, 5] + w * star[i, 8]
            t, _, _, square = place_near(
                px, py, pz, limit2, start if k == 0 else t, reference, nodes, squares
            )
            if square > limit2:
                return True
        if inverted_in(star, i, px, py, pz, t, reference, nodes, squares):
            return True
    return False


@kernel
def strays(star, i, limit2, t, reference, nodes, squares, pieces):
    """Whether not all of a star's triangle is found to be within the distance of the original.

    As `meshes.distance_bound_kernels.bound_faces`, which ends where a point is too far. t is the
    place of a triangle nearby; pieces (MOST_WAITING + 4, 10) is to work in.
    """
    flat, piece, depth = reference[0][3], pieces[MOST_WAITING + 3], 1
    sides, best_sides = squares[:3], squares[3:6]
    for d in range(3):
        pieces[0, d] = star[i, d]
        pieces[0, 3 + d] = star[i, d] + star[i, 3 + d]
        pieces[0, 6 + d] = star[i, d] + star[i, 6 + d]
    pieces[0, 9] = t
    for _ in range(MOST_PIECES):
        depth -= 1
        for d in range(10):
            piece[d] = pieces[depth, d]
        x = (piece[0] + piece[3] + piece[6]) / 3.0
        y = (piece[1] + piece[4] + piece[7]) / 3.0
        z = (piece[2] + piece[5] + piece[8]) / 3.0
        t, _, _, square = place_near(x, y, z, limit2, int(piece[9]), reference, nodes, squares)
        if square > limit2:
            return True
        if corner_distance(piece, flat[t])[0] > limit2:
            piece[9] = t
            if depth > MOST_WAITING - 3:
                return True
            least = LEAST_CUT * radius_about(piece, x, y, z)
            if depth < CUTS_WAITING and best_plane(piece, flat[t], least, sides, best_sides):
                depth = cut_by_plane(piece, best_sides, pieces, depth)
            else:
                depth = halve(piece, pieces, depth)
        if depth == 0:
            return False
    return True
