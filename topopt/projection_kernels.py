"""The compiled loop of the projection onto box and volume."""

from numba import njit


@njit(cache=True, error_model="numpy")
def projected_volume(kappa, linear, diagonal, mass, lower, upper, x):
    """x = clip((linear - kappa mass) / diagonal, lower, upper).

    Returns the volume mass . x, and its derivative by -kappa.
    """
    volume, slope = 0.0, 0.0
    for i in range(x.size):
        value = (linear[i] - kappa * mass[i]) / diagonal[i]
        if value <= lower[i]:
            value = lower[i]
        elif value >= upper[i]:
            value = upper[i]
        else:
            slope += mass[i] * mass[i] / diagonal[i]
        x[i] = value
        volume += mass[i] * value
    return volume, slope
