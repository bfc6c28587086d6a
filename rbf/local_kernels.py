"""Compiled loops of the local interpolation: in which patches a query lies, and their blend.

    S = sum_p w_p s_p / sum_p w_p,    s_p = sum_j a_j |x - x_j|^5 + (a polynomial of degree 2)

The weight w_p is a product of Wendland's phi_{1,1}(u) = (1 - u)^3 (3 u + 1), which is C2, over the
three axes, u = 1 at the sides of the patch's box. Every patch has coordinates of its own.
"""

import numpy as np
from numba import njit

from rbf.evaluate_kernels import bounds
from rbf.lanes import (
    below,
    compress,
    count_bits,
    improved_root,
    load,
    magnitude,
    root_estimate,
    spread,
    store,
    total,
)
from rbf.profiles import LEAN, OPTIONS, TINY

ROWS = 4  # of a patch: x, y, z of its points and their coefficients
TERMS = 10  # of a polynomial of degree 2


@njit(**LEAN)
def find_leaves(first, last, points, tree, leaves):
    """The leaf of the tree in which each of some points lies.

    Parameters
    ----------
    first, last : int
        The points to do.
    points : (n, 3) float array
    tree : tuple
        Axis and middle at which each node is split (the axis of a leaf is -1), its two children
        (of a leaf: the number of its patch), and the box (nodes, 2, 3) of all its patches.
    leaves : (n,) int64 array
        Result: the number of the patch; -1 outside all patches.
    """
    axes, middles, children, boxes = tree
    for p in range(first, last):
        inside = True
        for axis in range(3):
            inside &= boxes[0, 0, axis] <= points[p, axis] <= boxes[0, 1, axis]
        node = 0
        while axes[node] >= 0:
            node = children[node, 1 if points[p, axes[node]] >= middles[node] else 0]
        leaves[p] = children[node, 0] if inside else -1


@njit(**LEAN)
def find_patches(box, tree, patches, waiting, near):
    """The patches that a box (2, 3; middle and half widths) touches.

    Parameters
    ----------
    patches : tuple
        Middle (k, 3) and half widths (k, 3) of each patch's box, and what `evaluate` needs.
    waiting : (nodes,) int64 array
        Memory.
    near : (7, k + 8) float array
        Filled with the middles, inverse half widths and numbers of the patches found.

    Returns
    -------
    count : int
    """
    axes, _, children, boxes = tree
    middles, reaches = patches[0], patches[1]
    waiting[0], left, count = 0, 1, 0
    while left > 0:
        left -= 1
        node = waiting[left]
        touches = True
        for axis in range(3):
            touches &= boxes[node, 0, axis] <= box[0, axis] + box[1, axis]
            touches &= boxes[node, 1, axis] >= box[0, axis] - box[1, axis]
        if touches and axes[node] >= 0:
            waiting[left], waiting[left + 1] = children[node, 1], children[node, 0]
            left += 2
        elif touches:
            patch = children[node, 0]
            for axis in range(3):
                near[axis, count] = middles[patch, axis]
                near[3 + axis, count] = 1.0 / reaches[patch, axis]
            near[6, count] = patch
            count += 1
    store(spread(np.inf), near, 3, count)  # the rest of the last eight contains nothing
    return count


@njit(**LEAN)
def containing(near, count, x, y, z, hits):
    """Which of the patches found contain a point: their number, and their places in `hits`."""
    found = 0
    for j in range(0, count, 8):
        bits = below(magnitude(x - load(near, 0, j)) * load(near, 3, j), 1.0)
        bits &= below(magnitude(y - load(near, 1, j)) * load(near, 4, j), 1.0)
        bits &= below(magnitude(z - load(near, 2, j)) * load(near, 5, j), 1.0)
        store(compress(load(near, 6, j), bits), hits, 0, found)
        found += count_bits(bits)
    return found


@njit(**LEAN)
def patch_sum(patch, columns, data, tail, x, y, z):
    """Value and gradient of one patch's interpolant, in the patch's coordinates.

    Parameters
    ----------
    patch, columns : int
        Its number, and how many columns of `data` are its own (a multiple of 8).
    data : (4 k, m) float array
        Four rows for each patch.
    tail : (10,) float array
        Coefficients of 1, x, y, z, xx, yy, zz, xy, xz, yz.
    x, y, z : float
    """
    v = gx = gy = gz = spread(0.0)
    row = ROWS * patch
    for j in range(0, columns, 8):
        dx, dy, dz = x - load(data, row, j), y - load(data, row + 1, j), z - load(data, row + 2, j)
        squared = dx * dx + (dy * dy + (dz * dz + TINY))
        r = squared * improved_root(squared, root_estimate(squared))
        cubes = load(data, row + 3, j) * (squared * r)
        v = v + cubes * squared
        gx, gy, gz = gx + cubes * dx, gy + cubes * dy, gz + cubes * dz
    c, cx, cy, cz, cxx, cyy, czz, cxy, cxz, cyz = tail
    value = c + x * (cx + cxx * x + cxy * y + cxz * z) + y * (cy + cyy * y + cyz * z)
    value += z * (cz + czz * z) + total(v)
    return (
        value,
        cx + 2.0 * cxx * x + cxy * y + cxz * z + 5.0 * total(gx),
        cy + cxy * x + 2.0 * cyy * y + cyz * z + 5.0 * total(gy),
        cz + cxz * x + cyz * y + 2.0 * czz * z + 5.0 * total(gz),
    )


@njit(**LEAN)
def _bump(x, middle, reach):
    """phi_{1,1} and its derivative along one axis."""
    u = abs(x - middle) / reach
    t = max(1.0 - u, 0.0)
    slope = -12.0 * u * t * t / reach
    return t * t * t * (3.0 * u + 1.0), slope if x > middle else -slope


@njit(**LEAN)
def blend(hits, found, patches, x, y, z):
    """Value and gradient at a point from the patches hits[0, :found] that contain it."""
    middles, reaches, scales, columns, data, tails = patches
    sw = swx = swy = swz = s = sx = sy = sz = 0.0
    for hit in range(found):
        patch = int(hits[0, hit])
        mx, my, mz = middles[patch, 0], middles[patch, 1], middles[patch, 2]
        wx, dx = _bump(x, mx, reaches[patch, 0])
        wy, dy = _bump(y, my, reaches[patch, 1])
        wz, dz = _bump(z, mz, reaches[patch, 2])
        w, dx, dy, dz = wx * wy * wz, dx * wy * wz, wx * dy * wz, wx * wy * dz
        f = 1.0 / scales[patch]
        local = (x - mx) * f, (y - my) * f, (z - mz) * f
        tail = _tail(tails, patch)
        v, gx, gy, gz = patch_sum(patch, columns[patch], data, tail, *local)
        sw, swx, swy, swz = sw + w, swx + dx, swy + dy, swz + dz
        s, sx, sy, sz = s + w * v, sx + dx * v, sy + dy * v, sz + dz * v
        sx, sy, sz = sx + w * f * gx, sy + w * f * gy, sz + w * f * gz
    if not sw > 0.0:
        return np.nan, np.nan, np.nan, np.nan
    v = s / sw
    return v, (sx - v * swx) / sw, (sy - v * swy) / sw, (sz - v * swz) / sw


@njit(**LEAN)
def _tail(tails, p):
    return (
        tails[p, 0], tails[p, 1], tails[p, 2], tails[p, 3], tails[p, 4],
        tails[p, 5], tails[p, 6], tails[p, 7], tails[p, 8], tails[p, 9],
    )  # fmt: skip


@njit(**OPTIONS)
def evaluate(
    first_group, last_group, points, order, leaves, starts, tree, patches, values, gradients
):
    """Blended values and gradients at the queries of some leaves; NaN outside all patches.

    Parameters
    ----------
    first_group, last_group : int
        The groups of queries to do.
    points : (n, 3) float array
    order, leaves, starts : int64 arrays
        Group i is points order[starts[i]:starts[i + 1]], in leaf leaves[i].
    tree : tuple
        See `find_leaves`.
    patches : tuple
        Of k patches: middles and half widths (k, 3), scales (k,), columns (k,), data (4 k, m) and
        tails (k, 10); see `patch_sum`.
    values, gradients : (n,) and (n, 3) float arrays
        Results; gradients of shape (0, 3) are left out.
    """
    count = len(patches[0])
    waiting, box = np.empty(len(tree[0]) + 1, np.int64), np.empty((2, 3))
    near, hits = np.empty((7, count + 8)), np.empty((1, count + 8))
    for group in range(first_group, last_group):
        first, last = starts[group], starts[group + 1]
        count = 0
        if leaves[group] >= 0:
            bounds(points, order, first, last, box)
            count = find_patches(box, tree, patches, waiting, near)
        for place in range(first, last):
            p = order[place]
            x, y, z = points[p, 0], points[p, 1], points[p, 2]
            found = containing(near, count, x, y, z, hits)
            v, gx, gy, gz = blend(hits, found, patches, x, y, z)
            values[p] = v
            if gradients.shape[0] > 0:
                gradients[p, 0], gradients[p, 1], gradients[p, 2] = gx, gy, gz
