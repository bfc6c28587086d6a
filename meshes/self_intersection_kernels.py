"""Kernels that decide exactly whether two triangles meet. Slow twin: tests.meshes.reference.

Triangles are closed sets: touching is meeting. `faces` (m, 3) name the corners, `axes` (m,) an axis
along which the triangle's projection keeps an area, -1 for triangles without area. All integers
are int64, so that every kernel is compiled once: numba compiles a kernel again for an argument that
may be a literal, such as a variable set to 0, hence `np.int64(0)`.
"""

import numpy as np
from numba import njit

from meshes.predicates import line_side, plane_side

kernel = njit(cache=True, nogil=True, error_model="numpy")
STACK = 64


@kernel
def find_axes(points, faces, axes):
    """Fill axes (m,): see above; the first axis of the three if several will do exactly."""
    for f in range(faces.shape[0]):
        axes[f] = -1
        largest = -1.0
        for axis in range(3):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            area = abs(
                (points[a, i] - points[c, i]) * (points[b, j] - points[c, j])
                - (points[b, i] - points[c, i]) * (points[a, j] - points[c, j])
            )
            if area > largest and line_side(points, a, b, c, axis) != 0:
                axes[f], largest = axis, area


@kernel
def intervals_meet(points, p, q, a, b, axis):
    """Whether segments pq and ab on one line of the projection overlap."""
    for k in range(3):
        if k != axis and (
            max(points[p, k], points[q, k]) < min(points[a, k], points[b, k])
            or max(points[a, k], points[b, k]) < min(points[p, k], points[q, k])
        ):
            return False
    return True


@kernel
def segments_meet(points, p, q, a, b, axis):
    """Whether segments pq and ab meet in the projection along an axis."""
    ap, aq = line_side(points, a, b, p, axis), line_side(points, a, b, q, axis)
    if ap * aq > 0:
        return False
    pa, pb = line_side(points, p, q, a, axis), line_side(points, p, q, b, axis)
    if pa * pb > 0:
        return False
    if ap == 0 and aq == 0:
        return intervals_meet(points, p, q, a, b, axis)
    return True


@kernel
def flat_segment_meets(points, p, q, face, axis):
    """Whether segment pq meets the face, all in one plane."""
    low, high = 0, 0
    for k in range(3):
        side = line_side(points, face[k], face[(k + 1) % 3], p, axis)
        low, high = min(low, side), max(high, side)
    if low == 0 or high == 0:  # p lies in the face
        return True
    found = False
    for k in range(3):
        found = found or segments_meet(points, p, q, face[k], face[(k + 1) % 3], axis)
    return found


@kernel
def segment_meets(points, p, q, side_p, side_q, face, axis):
    """Whether segment pq, whose ends lie on the given sides of the face's plane, meets the face."""
    if side_p * side_q > 0:
        return False
    if side_p == 0 and side_q == 0:
        return flat_segment_meets(points, p, q, face, axis)
    low, high = 0, 0
    for k in range(3):
        side = plane_side(points, p, q, face[k], face[(k + 1) % 3])
        low, high = min(low, side), max(high, side)
        if low < 0 and high > 0:
            return False
    return True


@kernel
def fill_sides(points, face, other, sides):
    """Fill sides (3,) with the sides of the face's plane on which the corners of another lie.

    Returns whether all lie strictly on one side.
    """
    total = 0
    for k in range(3):
        sides[k] = plane_side(points, face[0], face[1], face[2], other[k])
        total += sides[k]
    return abs(total) == 3


@kernel
def apart_faces_meet(points, s, t, axis_s, axis_t, room):
    """Whether two faces without common vertex meet. room is (2, 3) int64 to work in."""
    if fill_sides(points, s, t, room[0]) or fill_sides(points, t, s, room[1]):
        return False
    for turn in range(2):
        for k in range(3):
            l = (k + 1) % 3
            if segment_meets(points, t[k], t[l], room[turn, k], room[turn, l], s, axis_s):
                return True
        s, t, axis_s = t, s, axis_t
    return False


@kernel
def tips_meet(points, s, t, i, j, axis_s, axis_t):
    """Whether faces with the common vertex s[i] = t[j] alone meet elsewhere too.

    A ray from the common vertex within both faces leaves one of them through the edge opposite.
    """
    for _ in range(2):
        p, q = t[(j + 1) % 3], t[(j + 2) % 3]
        side_p = plane_side(points, s[0], s[1], s[2], p)
        side_q = plane_side(points, s[0], s[1], s[2], q)
        if side_p * side_q > 0:
            return False
        if segment_meets(points, p, q, side_p, side_q, s, axis_s):
            return True
        s, t, j, axis_s = t, s, i, axis_t
    return False


@kernel
def wings_meet(points, s, t, common, axis):
    """Whether faces with a common edge meet elsewhere too: folded over in one plane.

    Bit i of `common` says that corner i of s belongs to t.
    """
    i = 0 if common == 6 else (1 if common == 5 else 2)
    tip, a, b = s[i], s[(i + 1) % 3], s[(i + 2) % 3]
    other = t[0]
    for k in range(1, 3):
        if t[k] != a and t[k] != b:
            other = t[k]
    if plane_side(points, s[0], s[1], s[2], other) != 0:
        return False
    return line_side(points, a, b, tip, axis) == line_side(points, a, b, other, axis)


@kernel
def faces_meet(points, faces, axes, f, g, room):
    """Whether faces f and g meet elsewhere than in common vertices or a common edge.

    room is (2, 3) int64 to work in.
    """
    s, t = faces[f], faces[g]
    common = count = i = j = np.int64(0)
    for k in range(3):
        for l in range(3):
            if s[k] == t[l]:
                common |= 1 << k
                count += 1
                i, j = k, l
    if count == 0:
        return apart_faces_meet(points, s, t, axes[f], axes[g], room)
    if count == 1:
        return tips_meet(points, s, t, i, j, axes[f], axes[g])
    if count == 2:
        return wings_meet(points, s, t, common, axes[f])
    return True


@kernel
def boxes_meet(boxes, i, others, j):
    """Whether two closed boxes meet."""
    for k in range(3):
        if boxes[i, k] > others[j, k + 3] or others[j, k] > boxes[i, k + 3]:
            return False
    return True


@kernel
def mark_meeting(points, faces, axes, face_boxes, tree, first, last, nodes, room, marked):
    """Mark (m,) the faces that meet another, for pairs of places i < j with first <= i < last.

    Faces are in the order of the tree's leaves; tree = (boxes, begin, end, leaves). nodes (STACK,)
    int32 and room (2, 3) int64 are to work in.
    """
    boxes, begin, end, leaves = tree
    for i in range(first, last):
        if axes[i] < 0:
            continue
        nodes[0], depth = 0, 1
        while depth:
            depth -= 1
            node = nodes[depth]
            if end[node] <= i + 1 or not boxes_meet(face_boxes, i, boxes, node):
                continue
            if node < leaves - 1:
                nodes[depth], nodes[depth + 1] = 2 * node + 2, 2 * node + 1
                depth += 2
                continue
            for j in range(max(begin[node], i + 1), end[node]):
                if (
                    axes[j] >= 0
                    and not (marked[i] and marked[j])
                    and boxes_meet(face_boxes, i, face_boxes, j)
                    and faces_meet(points, faces, axes, i, j, room)
                ):
                    marked[i] = True
                    marked[j] = True
