"""Threads for compiled loops: kernels that do part of their items, run side by side.

A kernel takes the range of its items first, and releases Python's lock. That compiles in a third
of the time of a loop that numba makes parallel, and runs as fast.
"""

import itertools
import os
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np

LEAST = 50  # items (cells or groups, of about ten points) worth a thread: waking one costs time
# A part is half of what is left for each thread, so that the last ones are small and all threads
# end together; after so many parts a hundredth is left, which is the last.
PARTS_PER_THREAD = 9

_pools = {}


def in_parts(kernel, count, *arguments, least=LEAST):
    """kernel(first, last, *arguments) for ranges that make up range(count), on all threads.

    Parameters
    ----------
    kernel : callable
        Compiled with `nogil`; an item's results must not depend on the range it is part of.
    count : int
    *arguments
    least : int
        Items worth a thread.

    Notes
    -----
    As many threads as numba has been given (`numba.set_num_threads`).
    """
    threads = min(numba.get_num_threads(), count // least)
    if threads < 2:
        kernel(0, count, *arguments)
        return
    left = (1.0 - 0.5 / threads) ** np.arange(threads * PARTS_PER_THREAD)
    limits = [int(limit) for limit in np.unique(count - np.floor(count * left))] + [count]
    waiting = iter(list(itertools.pairwise(limits)))

    def work():
        for first, last in waiting:
            kernel(first, last, *arguments)

    others = [_pool().submit(work) for _ in range(threads - 1)]
    work()
    for other in others:
        other.result()


def _pool():
    """The threads of this process; a process that was forked off starts its own."""
    if os.getpid() not in _pools:
        _pools.clear()
        _pools[os.getpid()] = ThreadPoolExecutor(max(numba.config.NUMBA_NUM_THREADS, 1))
    return _pools[os.getpid()]
