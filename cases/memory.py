"""Peak memory, sampled: what the process and its children hold at any one time."""

import threading

import psutil


class MemorySampler:
    """A thread that looks at the resident memory every `interval` seconds.

    Use as a context manager; `take_peak()` returns the peak [bytes] since it was last called.
    """

    def __init__(self, interval=0.05):
        self._interval = interval
        self._process = psutil.Process()
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
        while not self._stop.wait(self._interval):
            self._sample()

    def _sample(self):
        total = 0
        try:
            for process in (self._process, *self._process.children(recursive=True)):
                total += process.memory_info().rss
        except psutil.Error:  # a child that ended meanwhile
            pass
        with self._lock:
            self._peak = max(self._peak, total)
