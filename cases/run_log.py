"""run.log: all that the stages say, with the seconds since the start; warnings go further."""

import logging

from meshes.errors import InvalidCase

LOG = logging.getLogger("phasemesh")


class RunLog:
    """A context manager that sends what the logger "phasemesh" gets to the file and the user.

    Parameters
    ----------
    path : Path
    reporter : Reporter
    append : bool
        Go on with the file of an earlier run.

    Attributes
    ----------
    warnings : list of str
        All warnings so far.
    """

    def __init__(self, path, reporter, append=False):
        self._path = path
        self._mode = "a" if append else "w"
        self.warnings = []
        self._handlers = [_Forward(reporter, self.warnings)]

    def __enter__(self):
        try:
            file = logging.FileHandler(self._path, self._mode, encoding="utf-8")
        except OSError as error:
            raise InvalidCase(f"{self._path}: cannot be written ({error.strerror})") from error
        file.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
        self._handlers.append(file)
        self._before = LOG.level, LOG.propagate
        LOG.setLevel(logging.INFO)
        LOG.propagate = False
        for handler in self._handlers:
            LOG.addHandler(handler)
        return self

    def __exit__(self, *_):
        for handler in self._handlers:
            LOG.removeHandler(handler)
            handler.close()
        LOG.level, LOG.propagate = self._before


class _Forward(logging.Handler):
    """Warnings become notes, the rest details."""

    def __init__(self, reporter, warnings):
        super().__init__()
        self._reporter = reporter
        self._warnings = warnings

    def emit(self, record):
        text = record.getMessage()
        if record.levelno >= logging.WARNING:
            self._warnings.append(text)
            self._reporter.note(f"warning: {text}")
        else:
            self._reporter.detail(text)
