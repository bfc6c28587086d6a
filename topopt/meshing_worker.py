"""Run pytetwild in a process of its own: an archive of arrays comes in, one goes out.

pytetwild holds the interpreter while it runs: in a process of its own it can be stopped at any
moment, the caller's progress display stays alive, its memory is given back, and a crash in it is
an exit code. The file imports nothing of this project, so that it starts quickly.
"""

import ctypes
import io
import os
import signal
import sys

import numpy as np

SET_PARENT_DEATH_SIGNAL = 1  # prctl's PR_SET_PDEATHSIG


def die_with_parent():
    """Ask Linux to end this process when its parent ends; elsewhere do nothing."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)


def private_output():
    """The standard output as a file; what else is written there, in C++ too, goes nowhere."""
    output = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    return output


def main():
    """Read vertices, faces and options of pytetwild; write points and tets."""
    die_with_parent()
    with private_output() as output:
        import pytetwild

        with np.load(io.BytesIO(sys.stdin.buffer.read())) as archive:
            arrays = dict(archive)
        vertices, faces = arrays.pop("vertices"), arrays.pop("faces")
        options = {name: value if value.ndim else value.item() for name, value in arrays.items()}
        points, tets = pytetwild.tetrahedralize(vertices, faces, quiet=True, **options)
        result = io.BytesIO()
        np.savez(result, points=points, tets=tets)
        output.write(result.getbuffer())


if __name__ == "__main__":
    main()
