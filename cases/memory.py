"""Peak memory, sampled: what the process and its children hold at any one time."""

import contextlib
import threading

import psutil


class MemorySampler:
    """A thread that looks at the resident memory every `interval` seconds.

    Children are looked for once a second: that reads every process of the machine.

    Use as a context manager; `take_peak()` returns the peak [bytes] since it was last called.
    """

    def __init__(self, interval=0.05):
        self._interval = interval
        self._process, self._children = psutil.Process(), ()
        self._peak = 0
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True, name="memory")

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()

    def take_peak(self):
        """The greatest resident memory [bytes] since the last call; never 0."""
        self._sample()
        with self._lock:
            peak, self._peak = self._peak, 0
        return peak

    def _run(self):
        rest = 0
        while not self._stop.wait(self._interval):
            if rest == 0:
                self._look_for_children()
            rest = (rest + 1) % max(1, round(1.0 / self._interval))
            self._sample()

    def _look_for_children(self):
        with contextlib.suppress(psutil.Error):
            self._children = self._process.children(recursive=True)

    def _sample(self):
        total = 0
        try:
            for process in (self._process, *self._children):
                total += process.memory_info().rss
        except psutil.Error:  # a child that ended meanwhile
            self._children = ()
        with self._lock:
            self._peak = max(self._peak, total)
