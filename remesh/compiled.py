"""How the kernels of this package are compiled: cached, reproducible, NaN still caught.

A kernel that makes no arrays is compiled without reference counts (`_nrt`): each call would raise
and lower the counts of all its arrays, which takes as long as a small kernel's own work.
"""

from numba import njit

OPTIONS = {
    "cache": True,
    "nogil": True,
    "fastmath": {"contract", "nsz"},
    "error_model": "numpy",
}
allocating = njit(**OPTIONS)  # may make arrays
kernel = njit(_nrt=False, **OPTIONS)
inlined = njit(inline="always", **OPTIONS)  # for small functions whose arrays are dear to pass on
