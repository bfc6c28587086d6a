"""How much to smooth noisy data: the ridge (nugget) from the noise, or from the data alone."""

import numpy as np

from rbf.solve import Preconditioner, solve_with

TOLERANCE = 1e-4  # of the solves while searching
SMALLEST, LARGEST = 1e-8, 1e4
PROBES = 2
SEARCH_STEPS = 12


def ridge_for_noise(make_system, right, noise, neighbours):
    """The ridge with which the values deviate by `noise` in the mean square.

    The misfit grows with the ridge; bisection on its logarithm.

    Notes
    -----
    Morozov's discrepancy principle.
    """
    low, high = np.log(SMALLEST), np.log(LARGEST)
    for _ in range(SEARCH_STEPS):
        middle = 0.5 * (low + high)
        if _misfit(make_system, right, np.exp(middle), neighbours)[0] < noise:
            low = middle
        else:
            high = middle
    return float(np.exp(0.5 * (low + high)))


def ridge_by_cross_validation(make_system, right, neighbours, seed=0):
    """The ridge that minimises the generalised cross-validation score

        n |r|^2 / trace(I - H)^2,

    with r the deviation of the values and H the matrix that maps data to fitted values. The trace
    is estimated with random signs (Hutchinson), the same for every ridge.

    Notes
    -----
    Golden-section search on the logarithm, after a scan of its decades.
    """
    rng = np.random.default_rng(seed)
    probes = rng.choice([-1.0, 1.0], size=(PROBES, *right.shape))

    def score(log_ridge):
        return _misfit(make_system, right, np.exp(log_ridge), neighbours, probes)[1]

    decades = np.log(10.0) * np.arange(-7, 3, 1.5)
    scores = [score(log_ridge) for log_ridge in decades]
    best = int(np.argmin(scores))
    low, high = decades[max(best - 1, 0)], decades[min(best + 1, len(decades) - 1)]
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    left, right_point = high - golden * (high - low), low + golden * (high - low)
    left_score, right_score = score(left), score(right_point)
    for _ in range(SEARCH_STEPS // 2):
        if left_score < right_score:
            high, right_point, right_score = right_point, left, left_score
            left = high - golden * (high - low)
            left_score = score(left)
        else:
            low, left, left_score = left, right_point, right_score
            right_point = low + golden * (high - low)
            right_score = score(right_point)
    return float(np.exp(0.5 * (low + high)))


def _misfit(make_system, right, ridge, neighbours, probes=()):
    """Root mean square deviation of the values, and the cross-validation score."""
    system = make_system(ridge)
    preconditioner = Preconditioner(system, neighbours)
    columns = slice(0, system.ridge_columns)
    weights = system.ridge[:, None]
    deviation = weights * solve_with(system, preconditioner, right, TOLERANCE).x[:, columns]
    square = float(np.mean(deviation**2))
    if not len(probes):
        return np.sqrt(square), np.nan
    trace = 0.0
    for probe in probes:
        signs = np.zeros_like(right)
        signs[:, columns] = probe[:, columns]
        x = solve_with(system, preconditioner, signs, TOLERANCE).x[:, columns]
        trace += float(np.mean(signs[:, columns] * weights * x)) / len(probes)
    return np.sqrt(square), square / trace**2
