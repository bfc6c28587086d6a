"""Fewer centres: start with a few points, and add those where the interpolant errs most."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from meshes import InvalidCase
from rbf.dense import LARGEST, choose_scale, fit_global
from rbf.kernels import find_kernel
from rbf.scattered import check_values, fit_values


@dataclass(frozen=True)
class GreedyFit:
    """An interpolant through some of the points.

    Attributes
    ----------
    interpolant : GlobalInterpolant or ValueInterpolant
    centres : (k,) int array
        The points that were chosen, in the order they came.
    counts, largest, rms : (rounds,) arrays
        The error curve: centres used, and the error at all points, largest and root mean square.
    """

    interpolant: object
    centres: np.ndarray
    counts: np.ndarray
    largest: np.ndarray
    rms: np.ndarray


def fit_greedy(
    points, values, tolerance, kernel="cubic", growth=1.3, first=50, most=None, **options
):
    """Interpolate with as few centres as the tolerance allows.

    Parameters
    ----------
    points : (n, 3) float array
    values : (n,) float array
    tolerance : float
        On the largest error at any point, in the unit of the values.
    kernel : str
        A global kernel, or a Wendland kernel, which then needs `support_radius`.
    growth : float
        Centres in one round relative to the round before, above 1.
    first : int
        Centres to start with, spread by farthest-point sampling.
    most : int, optional
        Stop at so many centres even if the tolerance is not met; all points (for a global kernel
        at most 5000) if not given. The error curve says what was reached.
    **options
        For `fit_global` or `fit_values`.

    Returns
    -------
    GreedyFit

    Raises
    ------
    InvalidCase, InvalidMesh, NotConverged
        If a parameter makes no sense, and as the fit.

    Notes
    -----
    Carr et al. 2001, section 4. Of the points with large errors, those near a worse one are left
    for the next round.
    """
    chosen_kernel = find_kernel(kernel)
    points, values = check_values(points, values)
    if not (growth > 1.0 and 0.0 < tolerance < np.inf and first >= 4):
        raise InvalidCase(
            f"growth must be above 1, tolerance positive and first at least 4, got {growth}, "
            f"{tolerance}, {first}"
        )
    if chosen_kernel.compact and "support_radius" not in options:
        raise InvalidCase(f"kernel {kernel!r} needs support_radius, because centres get denser")
    if not chosen_kernel.compact:
        options["scale"], _ = choose_scale(points, options.get("scale"))
    fit = fit_values if chosen_kernel.compact else fit_global
    limit = len(points) if chosen_kernel.compact else min(len(points), LARGEST)
    limit = limit if most is None else min(most, limit)
    centres, curve = _spread(points, min(first, limit)), []
    while True:
        interpolant = fit(points[centres], values[centres], kernel=kernel, **options)
        error = np.abs(interpolant.value(points) - values)
        error[np.isnan(error)] = np.abs(values[np.isnan(error)]) + tolerance  # no support yet
        curve.append((len(centres), error.max(), np.sqrt(np.mean(error**2))))
        if error.max() <= tolerance or len(centres) >= limit:
            break
        count = min(max(int(np.ceil(growth * len(centres))), len(centres) + 1), limit)
        centres = np.append(centres, _worst(points, error, centres, count - len(centres)))
    counts, largest, rms = np.array(curve).T
    return GreedyFit(interpolant, centres, counts.astype(int), largest, rms)


def _spread(points, count):
    """Farthest-point sampling from the point farthest from the middle; no place is taken twice."""
    distance = np.linalg.norm(points - points.mean(axis=0), axis=1)
    chosen = [int(distance.argmax())]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count and distance.max() > 0.0:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def _worst(points, error, centres, count):
    """Up to `count` points of large error, none of them near a worse one where possible."""
    error = error.copy()
    error[centres] = -1.0
    order = np.argsort(-error, kind="stable")
    order = order[error[order] >= 0.0][: 8 * count]
    spacing = np.median(cKDTree(points[centres]).query(points[centres], k=2)[0][:, 1])
    near = cKDTree(points[order]).query_ball_point(points[order], 0.5 * spacing)
    free = np.ones(len(order), bool)
    chosen = []
    for place, others in enumerate(near):
        if free[place] and len(chosen) < count:
            chosen.append(place)
            free[others] = False
    rest = np.setdiff1d(np.arange(len(order)), chosen)
    chosen = np.concatenate([chosen, rest[: count - len(chosen)]]).astype(int)
    return order[chosen]
