"""history.csv: one row per accepted step, and one for the start of each level but the first."""

from dataclasses import astuple
from pathlib import Path

from meshes.errors import InvalidCase
from topopt.history import COLUMNS


class HistoryFile:
    """A context manager that writes HistoryRows as they come, floats with all their digits.

    Parameters
    ----------
    path : path-like
    earlier : sequence of HistoryRow
        The rows of the run that is gone on with.

    Raises
    ------
    InvalidCase
        If the file cannot be written.
    """

    def __init__(self, path, earlier=()):
        self._path = Path(path)
        self._earlier = earlier
        self._file = None

    def __enter__(self):
        self._guarded(self._open)
        return self

    def __exit__(self, *_):
        self._file.close()

    def append(self, row):
        """Write one HistoryRow."""
        self._guarded(self._write, astuple(row))

    def _open(self):
        self._file = open(self._path, "w", encoding="ascii", newline="")  # noqa: SIM115
        self._write(COLUMNS)
        for row in self._earlier:
            self._write(astuple(row))

    def _write(self, items):
        self._file.write(",".join(map(str, items)) + "\n")
        self._file.flush()

    def _guarded(self, work, *arguments):
        try:
            work(*arguments)
        except OSError as error:
            raise InvalidCase(f"{self._path}: cannot be written ({error.strerror})") from error
