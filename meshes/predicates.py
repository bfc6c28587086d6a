"""Exact signs of determinants: on which side of a line or a plane a point lies.

Each predicate first computes its determinant in floating point. If it is larger than the bound on
its rounding error (Shewchuk 1997, the A estimates), its sign is right; else it is summed exactly as
an expansion of non-overlapping doubles. Exact as long as no product underflows: see
`meshes.self_intersection.normalised_coordinates`. Slow twin: fractions, in tests.meshes.reference.

Compiled without fast-math of any kind: the error-free transformations need every rounding as it is
written.
"""

import numpy as np
from numba import njit

kernel = njit(cache=True, nogil=True, error_model="numpy")

ROUNDING = 2.0**-53
PLANE_BOUND = (7.0 + 56.0 * ROUNDING) * ROUNDING
LINE_BOUND = (3.0 + 16.0 * ROUNDING) * ROUNDING
SPLITTER = 2.0**27 + 1.0


@kernel
def two_sum(a, b):
    """a + b exactly, as rounded sum and error."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@kernel
def split(a):
    """a as the sum of two numbers of 26 bits."""
    big = SPLITTER * a
    high = big - (big - a)
    return high, a - high


@kernel
def two_product(a, b):
    """a b exactly, as rounded product and error."""
    product = a * b
    a1, a0 = split(a)
    b1, b0 = split(b)
    return product, a0 * b0 - (((product - a1 * b1) - a0 * b1) - a1 * b0)


@kernel
def add_exactly(expansion, count, value):
    """Add a value to an expansion (non-overlapping, smallest first); returns its new length."""
    kept = 0
    for i in range(count):
        value, error = two_sum(value, expansion[i])
        if error != 0.0:
            expansion[kept] = error
            kept += 1
    if value != 0.0:
        expansion[kept] = value
        kept += 1
    return kept


@kernel
def sign_of(expansion, count):
    """Sign of an expansion: that of its largest part."""
    if count == 0:
        return 0
    return 1 if expansion[count - 1] > 0.0 else -1


@kernel
def exact_plane_side(points, a, b, c, d):
    """The sign of `plane_side`, summed exactly."""
    difference = np.empty((3, 3, 2))
    for k in range(3):
        for row, p in enumerate((a, b, c)):
            high, low = two_sum(points[p, k], -points[d, k])
            difference[row, k, 0], difference[row, k, 1] = high, low
    expansion = np.empty(200)
    count = np.int64(0)
    for i in range(3):
        for turn in range(2):
            j = (i + 1 + turn) % 3
            k = 3 - i - j
            for bits in range(8):
                x = difference[0, i, bits & 1]
                y = difference[1, j, (bits >> 1) & 1]
                z = difference[2, k, bits >> 2]
                if x == 0.0 or y == 0.0 or z == 0.0:
                    continue
                high, low = two_product(x, y)
                for part in (high, low):
                    if part == 0.0:
                        continue
                    top, rest = two_product(part, z)
                    if turn == 1:
                        top, rest = -top, -rest
                    count = add_exactly(expansion, count, rest)
                    count = add_exactly(expansion, count, top)
    return sign_of(expansion, count)


@kernel
def plane_side(points, a, b, c, d):
    """Sign of det(a - d, b - d, c - d) for four of the points (n, 3), given by number.

    1 if d sees a, b, c clockwise (d lies below), -1 if counter-clockwise, 0 if all lie in a plane.
    """
    ax, bx = points[a, 0] - points[d, 0], points[b, 0] - points[d, 0]
    cx = points[c, 0] - points[d, 0]
    ay, by = points[a, 1] - points[d, 1], points[b, 1] - points[d, 1]
    cy = points[c, 1] - points[d, 1]
    az, bz = points[a, 2] - points[d, 2], points[b, 2] - points[d, 2]
    cz = points[c, 2] - points[d, 2]
    bxcy, cxby = bx * cy, cx * by
    cxay, axcy = cx * ay, ax * cy
    axby, bxay = ax * by, bx * ay
    determinant = az * (bxcy - cxby) + bz * (cxay - axcy) + cz * (axby - bxay)
    permanent = (
        (abs(bxcy) + abs(cxby)) * abs(az)
        + (abs(cxay) + abs(axcy)) * abs(bz)
        + (abs(axby) + abs(bxay)) * abs(cz)
    )
    bound = PLANE_BOUND * permanent
    if determinant > bound:
        return 1
    if determinant < -bound:
        return -1
    if permanent == 0.0:
        return 0
    return exact_plane_side(points, a, b, c, d)


@kernel
def exact_line_side(points, a, b, c, i, j):
    """The sign of `line_side`, summed exactly."""
    expansion = np.empty(40)
    count = np.int64(0)
    for turn in range(2):
        p, q = (a, b) if turn == 0 else (b, a)
        first = two_sum(points[p, i], -points[c, i])
        second = two_sum(points[q, j], -points[c, j])
        for x in first:
            for y in second:
                high, low = two_product(x, y)
                if turn == 1:
                    high, low = -high, -low
                count = add_exactly(expansion, count, low)
                count = add_exactly(expansion, count, high)
    return sign_of(expansion, count)


@kernel
def line_side(points, a, b, c, axis):
    """Sign of det(a - c, b - c) in the projection along an axis; 0 if the three are collinear."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    left = (points[a, i] - points[c, i]) * (points[b, j] - points[c, j])
    right = (points[b, i] - points[c, i]) * (points[a, j] - points[c, j])
    determinant = left - right
    bound = LINE_BOUND * (abs(left) + abs(right))
    if determinant > bound:
        return 1
    if determinant < -bound:
        return -1
    if left == 0.0 and right == 0.0:
        return 0
    return exact_line_side(points, a, b, c, i, j)
