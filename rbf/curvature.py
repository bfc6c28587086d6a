"""Curvatures of the level sets of a function, from its first and second derivatives."""

import numpy as np


def principal_curvatures(gradients, hessians):
    """Principal curvatures of the level sets.

    Parameters
    ----------
    gradients : (n, 3) float array
    hessians : (n, 3, 3) float array

    Returns
    -------
    curvatures : (n, 2) float array
        The larger first, in 1 / unit of length; positive where the surface is convex, seen from
        the side the gradient points to. NaN where the gradient vanishes.

    Notes
    -----
    The shape operator is P H P / |g| with P the projection on the tangent plane; its trace and
    its squared norm are k1 + k2 and k1^2 + k2^2.
    """
    length = np.linalg.norm(gradients, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = gradients / length[:, None]
        tangent = np.eye(3) - normals[:, :, None] * normals[:, None, :]
        shape = tangent @ hessians @ tangent / length[:, None, None]
    trace = np.einsum("nii->n", shape)
    square = np.einsum("nij,nij->n", shape, shape)
    half = np.sqrt(np.maximum(0.5 * square - 0.25 * trace**2, 0.0))
    return np.stack([0.5 * trace + half, 0.5 * trace - half], axis=1)
