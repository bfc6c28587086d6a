"""Kernel that finds the tet around a point. Slow twin: tests.topopt.reference_transfer.

`tree` is the tuple (boxes, begin, end, leaves) of a box tree (`meshes.box_tree`); `frames` (m, 12)
holds for each tet, in the order of the leaves, its first corner and the gradients of the hat
functions of the other three.
"""

import numpy as np
from numba import njit

kernel = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
STACK = 64
GROUP = 64  # points
OUTSIDE = -1e-9  # least weight of a corner that still counts as inside: neighbours overlap


@kernel
def weights_in_tet(x, y, z, frame, weights):
    """Fill the barycentric weights (4,) of a point; return the least of them."""
    px, py, pz = x - frame[0], y - frame[1], z - frame[2]
    rest = 1.0
    for k in range(3):
        at = 3 + 3 * k
        weights[k + 1] = px * frame[at] + py * frame[at + 1] + pz * frame[at + 2]
        rest -= weights[k + 1]
    weights[0] = rest
    return min(min(weights[0], weights[1]), min(weights[2], weights[3]))


@kernel
def locate_one(x, y, z, tree, frames, stack, weights):
    """The place of the tet around one point, or -1; fills its weights (4,)."""
    boxes, begin, end, leaves = tree
    stack[0], height = 0, 1
    while height > 0:
        height -= 1
        node = stack[height]
        box = boxes[node]
        if x < box[0] or y < box[1] or z < box[2] or x > box[3] or y > box[4] or z > box[5]:
            continue
        if node < leaves - 1:
            stack[height], stack[height + 1] = 2 * node + 2, 2 * node + 1
            height += 2
            continue
        for place in range(begin[node], end[node]):
            if weights_in_tet(x, y, z, frames[place], weights) >= OUTSIDE:
                return place
    return -1


@kernel
def locate(points, tree, frames, first, last, found, weights):
    """Find the tets around points[first:last]: into found (n,) their places, -1 where there is
    none, and into weights (n, 4) the weights of their corners.

    The last point's tet is tried before the tree is asked, within groups of points that do not
    depend on how the points are dealt out.
    """
    stack, spare, place = np.empty(STACK, np.int32), np.empty(4), -1
    for i in range(first - first % GROUP, last):
        x, y, z = points[i]
        row = weights[i] if i >= first else spare
        fresh = i % GROUP == 0 or place < 0
        if fresh or weights_in_tet(x, y, z, frames[place], row) < OUTSIDE:
            place = locate_one(x, y, z, tree, frames, stack, row)
        if i >= first:
            found[i] = place
