"""manifest.json: what was run, with which versions, how long it took and how it ended."""

import datetime
import importlib.metadata
import os
import platform
import sys

import psutil

from cases.json_file import write_json

_PACKAGES = (
    "phasemesh",
    "numpy",
    "scipy",
    "numba",
    "scikit-fem",
    "pyamg",
    "pytetwild",
    "meshio",
    "pyvista",
)


class Manifest:
    """The manifest of one run; it is written anew whenever something happens.

    Parameters
    ----------
    path : Path
    facts : dict
        What is known before the first stage (case, preset, seed, threads ...).
    stages : dict, optional
        The stages of an earlier run that are used again.
    """

    def __init__(self, path, facts, stages=None):
        self._path = path
        self.data = {
            **facts,
            "versions": versions(),
            "machine": {
                "system": platform.platform(),
                "cores": os.cpu_count(),
                "memory_gib": round(psutil.virtual_memory().total / 2**30, 1),
            },
            "started": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
            "mesh": None,
            "stages": {name: {**stage, "reused": True} for name, stage in (stages or {}).items()},
            "warnings": [],
            "outcome": "running",
        }
        self.write()

    def stage_done(self, name, seconds, cpu_seconds, peak_bytes, figures):
        """Record a finished stage and the figures it reports."""
        self.data["stages"][name] = {
            "seconds": round(seconds, 3),
            "cpu_seconds": round(cpu_seconds, 3),
            "peak_memory_mib": round(peak_bytes / 2**20, 1),
            **figures,
        }
        self.write()

    def finish(self, outcome):
        """Record how the run ended."""
        self.data["outcome"] = outcome
        self.write()

    def write(self):
        """Put the present state on disk."""
        write_json(self._path, self.data)


def versions():
    """Versions of Python and of the packages that shape a result."""
    found = {"python": ".".join(map(str, sys.version_info[:3]))}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = None
    return found
