"""What a run tells while it works: a live line on a terminal, plain lines elsewhere, or nothing.

All of it goes to the standard error stream, so that the summary can be piped.
"""

import time

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

_PLAIN_INTERVAL = 10.0  # seconds between lines without a terminal


class Reporter:
    """Says nothing: the reporter of --quiet, and what the others are made of."""

    def begin(self, stage):
        """A stage starts."""

    def update(self, text, done=None, total=None):
        """Where the stage is: a few words, and its share if that is known."""

    def end(self, text):
        """The stage is done; `text` says with what."""

    def note(self, text):
        """Something worth a line of its own."""

    def detail(self, text):
        """Something for -v only."""

    def close(self):
        """No more is to come."""


class PlainReporter(Reporter):
    """Lines: one when a stage begins or ends, and one every few seconds between."""

    def __init__(self, console, verbose=False):
        self._console = console
        self._verbose = verbose
        self._stage = ""
        self._started = self._last = 0.0

    def _line(self, text):
        self._console.print(Text(text), soft_wrap=True)

    def begin(self, stage):
        self._stage = stage
        self._started = self._last = time.perf_counter()
        self._line(f"{stage} ...")

    def update(self, text, done=None, total=None):
        now = time.perf_counter()
        if self._verbose or now - self._last >= _PLAIN_INTERVAL:
            self._last = now
            share = f" {done}/{total}" if total else ""
            self._line(f"{self._stage}{share}: {text}")

    def end(self, text):
        self._line(f"{self._stage}: {text} ({time.perf_counter() - self._started:.1f} s)")

    def note(self, text):
        self._line(text)

    def detail(self, text):
        if self._verbose:
            self._line(text)


class LiveReporter(PlainReporter):
    """The same with one live line that shows where the stage is."""

    def __init__(self, console, verbose=False):
        super().__init__(console, verbose)
        self._progress = Progress(
            TextColumn("{task.description:11}"),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            TextColumn("{task.fields[text]}"),
            console=console,
            transient=True,
        )
        self._task = None

    def begin(self, stage):
        self._stage = stage
        self._started = time.perf_counter()
        self._progress.start()
        self._task = self._progress.add_task(stage, total=None, text="")

    def update(self, text, done=None, total=None):
        if self._task is not None:
            self._progress.update(self._task, completed=done or 0, total=total, text=text)
        if self._verbose:
            super().update(text, done, total)

    def end(self, text):
        if self._task is not None:
            self._progress.remove_task(self._task)
            self._task = None
        super().end(text)

    def close(self):
        self._progress.stop()


def make_reporter(quiet=False, verbose=False):
    """The reporter that suits the options and the terminal."""
    if quiet:
        return Reporter()
    console = Console(stderr=True, highlight=False)
    if console.is_terminal and not console.is_dumb_terminal:
        return LiveReporter(console, verbose)
    return PlainReporter(console, verbose)
