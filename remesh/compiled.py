"""How the kernels of this package are compiled: cached, reproducible, NaN still caught.

A kernel that makes no arrays is compiled without reference counts (`_nrt`): each call would raise
and lower the counts of all its arrays, which takes as long as a small kernel's own work. For the
same reason what sweeps call for every vertex or edge is compiled into its callers (`hot`): an array
is nine words to hand on, and those of the carrier are a hundred together.
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
hot = njit(_nrt=False, forceinline=True, **OPTIONS)  # compiled into its callers
