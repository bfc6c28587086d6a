"""How the kernels of this package are compiled: cached, reproducible, NaN still caught."""

from numba import njit

OPTIONS = {
    "cache": True,
    "nogil": True,
    "fastmath": {"contract", "nsz"},
    "error_model": "numpy",
}
kernel = njit(**OPTIONS)

inlined = njit(inline="always", **OPTIONS)  # for small functions whose arrays are dear to pass on
