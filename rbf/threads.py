"""Threads where they pay: waking them costs more than a small job."""

from contextlib import contextmanager

import numba

SMALL = 1000  # points or queries, about half a millisecond of work


@contextmanager
def threads_for(count):
    """Within the block compiled loops over `count` items use one thread if that is few."""
    before = numba.get_num_threads()
    if count < SMALL:
        numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)
