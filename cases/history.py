"""history.csv: one row per accepted step, on disk as soon as the step is done."""

import csv
from pathlib import Path

from meshes.errors import InvalidCase

COLUMNS = (
    "iteration",
    "compliance_J",
    "ginzburg_landau_J",
    "objective_J",
    "volume_fraction",
    "tau",
    "rejected",
    "pdas_iterations",
    "state_iterations",
    "kkt_residual",
    "kkt_stationarity",
    "kkt_complementarity",
    "kkt_sign",
    "volume_error",
    "seconds",
)


class HistoryFile:
    """A context manager that writes rows (mappings with the keys of COLUMNS) as they come."""

    def __init__(self, path):
        self._path = Path(path)
        self._file = None

    def __enter__(self):
        try:
            self._file = open(self._path, "w", encoding="utf-8", newline="")
        except OSError as error:
            raise InvalidCase(f"{self._path}: cannot be written ({error.strerror})") from error
        self._write(COLUMNS)
        return self

    def __exit__(self, *_):
        self._file.close()

    def append(self, row):
        """Write one row; floats with all their digits."""
        self._write([_text(row[name]) for name in COLUMNS])

    def _write(self, items):
        try:
            self._file.write(",".join(map(str, items)) + "\n")
            self._file.flush()
        except OSError as error:
            raise InvalidCase(f"{self._path}: cannot be written ({error.strerror})") from error


def _text(value):
    return repr(float(value)) if isinstance(value, float) else str(int(value))


def read_history(path):
    """The rows of a history file as a dict of column to list of float."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [float(row[name]) for row in rows] for name in COLUMNS}
