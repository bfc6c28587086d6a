"""Scattered values of any number: small interpolants on boxes that overlap, blended smoothly.

Where points fill a volume, a support that is wide enough to be accurate holds hundreds of them. A
blend (partition of unity) of interpolants of some 60 points each is more accurate, is fitted in a
fraction of the time, and a query sums up three or four of them.
"""

import numpy as np
from scipy.spatial import cKDTree

from meshes import InvalidCase, NotConverged
from rbf import local_kernels as kernels
from rbf.cells import sorting_order
from rbf.scattered import average_duplicates, check_values
from rbf.spacing import WELD_PER_SPACING, point_spacing
from rbf.threads import in_parts

MOST, LEAST = 80, 50  # points of a patch: it is split above, and filled up with neighbours below
MARGIN = 0.25  # by which a patch's box is wider than its leaf of the tree, on each side
FLATTEST = 0.01  # least ratio of the sides of the box around all points
DEEPEST = 200  # level of the tree
DAMPING = 1e-12  # of polynomials that the points of a patch do not determine
RESIDUAL = 1e-6  # largest deviation from the data, relative to the values of a patch
AT_ONCE = 64  # patches solved together
QUERIES = 1000  # points worth a thread


class LocalInterpolant:
    """A blend of local interpolants: r^5 with a polynomial of degree 2 in each patch. C2.

    Attributes
    ----------
    points : (n, 3) float array
        The data sites, after welding.
    patches : int
    welded : int
        Points that were averaged with another.
    value_error : float
        Largest deviation from the data.
    """

    def __init__(self, points, tree, patches, welded, value_error):
        self.points, self.welded, self.value_error = points, welded, value_error
        self.patches = len(patches[0])
        self._tree, self._patches = tree, patches
        self._neighbours = None

    def value(self, points):
        """S at points (n, 3): (n,), NaN outside the box of the data and a margin."""
        return self._evaluate(points, np.empty((0, 3)))

    def gradient(self, points):
        """Gradient of S at points (n, 3): (n, 3), NaN as `value`."""
        return self.value_and_gradient(points)[1]

    def value_and_gradient(self, points):
        """Both at once."""
        gradients = np.empty((len(points), 3))
        return self._evaluate(points, gradients), gradients

    def distance_to_data(self, points):
        """Distance (n,) from points (n, 3) to the nearest data site.

        Where it is larger than between neighbouring sites, S is extrapolated.
        """
        if self._neighbours is None:
            self._neighbours = cKDTree(self.points)
        return self._neighbours.query(np.asarray(points, dtype=float))[0]

    def _evaluate(self, points, gradients):
        points = np.ascontiguousarray(points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InvalidCase(f"points must have shape (n, 3), got {points.shape}")
        leaves, values = np.empty(len(points), np.int64), np.empty(len(points))
        in_parts(kernels.find_leaves, len(points), points, self._tree, leaves, least=QUERIES)
        order = sorting_order(leaves + 1, self.patches + 1)
        leaves = leaves[order]
        starts = np.flatnonzero(np.diff(leaves, prepend=-2, append=-2))
        groups = order, leaves[starts[:-1]], starts
        place = points, *groups, self._tree, self._patches
        in_parts(kernels.evaluate, len(starts) - 1, *place, values, gradients, least=8)
        return values


def fit_local(points, values, most=MOST, least=LEAST, margin=MARGIN, weld_distance=None):
    """Interpolate scattered values by blending local interpolants.

    Parameters
    ----------
    points : (n, 3) float array
        Of a volume, a surface or a line, of any density.
    values : (n,) float array
    most, least : int
        Boxes are halved until they hold at most so many points, margins included; the interpolant
        of a box with fewer than `least` takes the nearest ones besides.
    margin : float
        By which boxes are widened on each side, in their widths: where they overlap, they blend.
    weld_distance : float, optional
        Points nearer than this are averaged; 1e-4 spacings if not given.

    Returns
    -------
    LocalInterpolant

    Raises
    ------
    InvalidCase, InvalidMesh
        If a parameter makes no sense, or points and values are not finite.
    NotConverged
        If points lie too close together for their values to be met.

    Notes
    -----
    Partition of unity: Wendland 2005, chapter 15.4 (scattered data by local interpolants);
    polyharmonic splines of order 3 in each patch. Polynomials of degree 2 are reproduced.
    """
    if not (most >= 4 and 1 <= least <= most and 0.0 < margin <= 1.0):
        raise InvalidCase(
            "a patch needs most >= 4, least in [1, most] and a margin in (0, 1], got "
            f"{most}, {least} and {margin}"
        )
    points, values = check_values(points, values)
    if weld_distance is None:
        weld_distance = WELD_PER_SPACING * point_spacing(points, instead="two at least")
    welded = len(points)
    points, values = average_duplicates(points, values, weld_distance)
    welded -= len(points)
    if len(points) < 2:
        raise InvalidCase(
            f"there are not two distinct ones among the points at a weld_distance of "
            f"{weld_distance:g}: give two at least, or a smaller distance"
        )
    tree, middles, reaches, members = grow_tree(points, most, margin)
    members = _fill_up(points, middles, members, min(least, len(points)))
    patches, errors = _solve(points, values, middles, reaches, members)
    worst = int(np.argmax(errors))
    if not errors[worst] <= RESIDUAL:
        raise NotConverged(
            f"the values near {middles[worst]} are missed by {errors[worst]:.1e} of their size: "
            "average points that lie close together (weld_distance)"
        )
    value_error = float(np.max(errors * [np.abs(values[chosen]).max() for chosen in members]))
    return LocalInterpolant(points, tree, patches, welded, value_error)


def grow_tree(points, most, margin):
    """Halve the box of the points until each box, widened by its margins, holds few of them.

    Parameters
    ----------
    points : (n, 3) float array
    most : int
    margin : float

    Returns
    -------
    tree : tuple
        See `local_kernels.find_leaves`.
    middles, reaches : (k, 3) float arrays
        Of the widened boxes of the leaves: middle and half widths.
    members : list of int arrays
        The points in each of them.
    """
    lower, upper = points.min(axis=0), points.max(axis=0)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    half = np.maximum(half, FLATTEST * half.max())
    axes, cuts, children, boxes, leaves = [], [], [], [], []
    waiting = [(middle - half, middle + half, np.arange(len(points)), 0, None, 0)]
    while waiting:
        lower, upper, inside, level, parent, side = waiting.pop()
        node, width = len(axes), upper - lower
        if parent is not None:
            children[parent][side] = node
        boxes.append((lower - margin * width, upper + margin * width))
        near = points[inside]
        inside = inside[((near >= boxes[-1][0]) & (near <= boxes[-1][1])).all(axis=1)]
        if len(inside) <= most or level == DEEPEST:
            axes.append(-1), cuts.append(0.0), children.append([len(leaves), -1])
            leaves.append((node, inside))
            continue
        axis = int(np.argmax(width))
        cut = 0.5 * (lower[axis] + upper[axis])
        axes.append(axis), cuts.append(cut), children.append([-1, -1])
        below, above = upper.copy(), lower.copy()
        below[axis] = above[axis] = cut
        waiting.append((above, upper, inside, level + 1, node, 1))
        waiting.append((lower, below, inside, level + 1, node, 0))
    boxes = np.array(boxes)
    tree = np.array(axes), np.array(cuts), np.array(children), boxes
    own = boxes[[node for node, _ in leaves]]
    middles, reaches = own.mean(axis=1), 0.5 * (own[:, 1] - own[:, 0])
    return tree, middles, reaches, [inside for _, inside in leaves]


def _fill_up(points, middles, members, least):
    """Give patches of fewer than `least` points the nearest ones to their middle, too."""
    few = [patch for patch, inside in enumerate(members) if len(inside) < least]
    nearest = cKDTree(points).query(middles[few], k=range(1, least + 1))[1]
    for patch, found in zip(few, nearest, strict=True):
        members[patch] = np.union1d(members[patch], found)
    return members


def _solve(points, values, middles, reaches, members):
    """The patches, see `local_kernels.evaluate`, and their largest relative residuals (k,)."""
    sizes = np.array([len(inside) for inside in members])
    columns = (sizes + 7) // 8 * 8
    data = np.zeros((kernels.ROWS * len(members), columns.max()))
    tails, errors = np.empty((len(members), kernels.TERMS)), np.empty(len(members))
    scales = reaches.max(axis=1)

    def solve_some(first, last):
        for batch in range(first, last):  # the same ones whatever the threads: bits depend on them
            some = range(batch * AT_ONCE, min((batch + 1) * AT_ONCE, len(members)))
            sites = [(points[members[p]] - middles[p]) / scales[p] for p in some]
            solved = _solve_together(sites, [values[members[p]] for p in some])
            for patch, x, a, tail, error in zip(some, sites, *solved, strict=True):
                rows = data[kernels.ROWS * patch : kernels.ROWS * (patch + 1), : sizes[patch]]
                rows[:3], rows[3] = x.T, a[: len(x)]
                tails[patch], errors[patch] = tail, error

    in_parts(solve_some, -(-len(members) // AT_ONCE), least=1)
    return (middles, reaches, scales, columns, data, tails), errors


def _solve_together(sites, values):
    """Coefficients, tails and relative residuals of some patches.

    Parameters
    ----------
    sites, values : lists of (n, 3) and (n,) float arrays
        In the patches' own coordinates.
    """
    count, most = len(sites), max(len(x) for x in sites)
    matrix = np.zeros((count, most + kernels.TERMS, most + kernels.TERMS))
    right = np.zeros((count, most + kernels.TERMS))
    for place, (x, value) in enumerate(zip(sites, values, strict=True)):
        n = len(x)
        matrix[place, :n, :n] = ((x[:, None] - x) ** 2).sum(axis=2) ** 2.5
        matrix[place, :n, most:] = _terms(x)
        matrix[place, most:, :n] = matrix[place, :n, most:].T
        matrix[place, range(n, most), range(n, most)] = 1.0
        right[place, :n] = value
    tail = range(most, most + kernels.TERMS)
    matrix[:, tail, tail] = DAMPING
    size = np.maximum(np.abs(right).max(axis=1), np.finfo(float).tiny)
    try:
        solution = np.linalg.solve(matrix, right[..., None])
    except np.linalg.LinAlgError:  # of one of them at least
        solution = np.full((*right.shape, 1), np.nan)
    error = np.abs(np.matmul(matrix, solution)[..., 0] - right).max(axis=1) / size
    return solution[:, :most, 0], solution[:, most:, 0], error


def _terms(x):
    """1, x, y, z, xx, yy, zz, xy, xz, yz at points (n, 3): (n, 10)."""
    one, square = np.ones((len(x), 1)), x**2
    mixed = np.stack([x[:, 0] * x[:, 1], x[:, 0] * x[:, 2], x[:, 1] * x[:, 2]], axis=1)
    return np.hstack([one, x, square, mixed])
