"""Kernels of the box tree: a balanced binary tree of bounding boxes over triangles.

Node i has the children 2 i + 1 and 2 i + 2; the last 2**depth nodes are leaves. `order` holds the
triangles in the order of the leaves; node i owns order[begin[i]:end[i]]. `boxes` (nodes, 6) are
lower and upper corners. Checked node by node in tests.meshes.test_closest_point.
"""

import numpy as np
from numba import njit

kernel = njit(cache=True, nogil=True, error_model="numpy")


@kernel
def select(order, keys, begin, end, middle):
    """Reorder order[begin:end] so that keys are <= before `middle` and >= from it on (Hoare)."""
    low, high = begin, end - 1
    while low < high:
        pivot = keys[order[(low + high) // 2]]
        i, j = low, high
        while i <= j:
            while keys[order[i]] < pivot:
                i += 1
            while keys[order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@kernel
def split_nodes(centres, leaves, order, begin, end):
    """Fill begin and end (nodes,), halving every node along the longest side of its centres.

    centres is (3, m): one row of keys per axis.
    """
    begin[0], end[0] = 0, order.size
    for node in range(leaves - 1):
        first, last = begin[node], end[node]
        axis, longest = 0, -1.0
        for k in range(3):
            low = high = centres[k, order[first]] if last > first else 0.0
            for i in range(first, last):
                low = min(low, centres[k, order[i]])
                high = max(high, centres[k, order[i]])
            if high - low > longest:
                axis, longest = k, high - low
        middle = (first + last) // 2
        select(order, centres[axis], first, last, middle)
        begin[2 * node + 1], end[2 * node + 1] = first, middle
        begin[2 * node + 2], end[2 * node + 2] = middle, last


@kernel
def fill_boxes(face_boxes, order, begin, end, leaves, boxes):
    """Fill boxes (nodes, 6) from those of the triangles (m, 6), leaves first."""
    for node in range(boxes.shape[0] - 1, -1, -1):
        for k in range(3):
            boxes[node, k], boxes[node, k + 3] = 1e300, -1e300
        if node >= leaves - 1:
            for i in range(begin[node], end[node]):
                face = order[i]
                for k in range(3):
                    boxes[node, k] = min(boxes[node, k], face_boxes[face, k])
                    boxes[node, k + 3] = max(boxes[node, k + 3], face_boxes[face, k + 3])
        else:
            for child in (2 * node + 1, 2 * node + 2):
                for k in range(3):
                    boxes[node, k] = min(boxes[node, k], boxes[child, k])
                    boxes[node, k + 3] = max(boxes[node, k + 3], boxes[child, k + 3])


@kernel
def mark_touching(boxes, tree, marks):
    """Mark (m,), in the tree's order, the triangles whose own box touches one of boxes (k, 6)."""
    nodes, begin, end, triangles, leaves = tree
    waiting = np.empty(64, np.int32)
    for i in range(boxes.shape[0]):
        waiting[0], depth = 0, 1
        while depth:
            depth -= 1
            node = waiting[depth]
            if not touches(boxes[i], nodes[node]):
                continue
            if node < leaves - 1:
                waiting[depth], waiting[depth + 1] = 2 * node + 1, 2 * node + 2
                depth += 2
                continue
            for t in range(begin[node], end[node]):
                if not marks[t]:
                    marks[t] = touches_triangle(boxes[i], triangles[t])


@kernel
def touches(one, other):
    """Whether two boxes (6,) have a point in common."""
    apart = False
    for k in range(3):
        apart |= one[k] > other[k + 3] or other[k] > one[k + 3]
    return not apart


@kernel
def touches_triangle(box, triangle):
    """Whether a box (6,) touches that of a triangle (corner and two edges from it, as (9+,))."""
    for k in range(3):
        a, u, v = triangle[k], triangle[3 + k], triangle[6 + k]
        if box[k] > a + max(u, v, 0.0) or a + min(u, v, 0.0) > box[k + 3]:
            return False
    return True
