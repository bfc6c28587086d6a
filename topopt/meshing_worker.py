"""Run pytetwild in a process of its own: `python -P meshing_worker.py INPUT.npz OUTPUT.npz`.

pytetwild holds the interpreter while it runs: in a process of its own it can be stopped at any
moment, the caller's progress display stays alive, its memory is given back, and a crash in it is
an exit code. The file imports nothing of this project, so that it starts quickly.
"""

import ctypes
import signal
import sys

import numpy as np

SET_PARENT_DEATH_SIGNAL = 1  # prctl's PR_SET_PDEATHSIG


def die_with_parent():
    """Ask Linux to end this process when its parent ends; elsewhere do nothing."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)


def main(source, target):
    """Mesh the surface in the archive `source`; write points and tets to `target`."""
    die_with_parent()
    import pytetwild

    with np.load(source) as archive:
        arrays = dict(archive)
    vertices, faces = arrays.pop("vertices"), arrays.pop("faces")
    options = {name: value if value.ndim else value.item() for name, value in arrays.items()}
    points, tets = pytetwild.tetrahedralize(vertices, faces, quiet=True, **options)
    np.savez(target, points=points, tets=tets)


if __name__ == "__main__":
    main(*sys.argv[1:])
