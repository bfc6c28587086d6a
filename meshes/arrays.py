"""Read-only arrays: what the frozen mesh types are made of."""

import numpy as np


def frozen(array, dtype, shape, name):
    """Return a C-contiguous read-only copy-or-view of `array` with the dtype and shape asked for.

    Parameters
    ----------
    array : array_like
    dtype : numpy dtype
    shape : tuple of int or None
        Expected shape; `None` matches any length.
    name : str
        What the array is called in the error.

    Raises
    ------
    ValueError
        If the shape does not match.
    """
    source = np.asarray(array)
    result = np.ascontiguousarray(source, dtype=dtype)
    if result.ndim == 1 and result.size == 0 and len(shape) == 2:
        result = result.reshape(0, shape[1])
    if result.ndim != len(shape) or any(
        want is not None and want != have for want, have in zip(shape, result.shape)
    ):
        raise ValueError(f"{name} must have shape {shape}, got {result.shape}")
    if result is source and result.flags.writeable:
        result = result.copy()
    result.flags.writeable = False
    return result
