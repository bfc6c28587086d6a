"""Kernels compiled on one core while the other one meshes and optimises.

The first run on a machine has to compile every numba kernel: more than two minutes on one core.
Meshing keeps only one core busy, so a first run starts this module as a child process. It runs a
tiny case from the lattice to the remeshed surface, in a folder of its own, and so fills numba's
cache on disk, from which the run itself then loads the kernels of its later stages.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import remesh
from cases.run_folder import STAGES

LONGEST_WAIT = 180.0  # seconds; after that the run compiles for itself

TINY = """\
name: tiny
domain:
  box: {lower: [0, 0, 0], upper: [20mm, 10mm, 10mm]}
symmetry: [x=0, y=0]
supports:
  foot: {plane: z=0, x: [16mm, 20mm], fixed: [x, y, z]}
loads:
  deck: {plane: z=10mm, x: [0, 6mm], traction: [0, 0, -2400]}
mesh: {kind: bcc, tets: 1500}
topopt: {volume_fraction: 0.4, gamma: 1.0e-4, eps: 2mm, steps: 2}
isosurface: {level: volume}
rbf: {support_factor: 2.5}
remesh: {edge_factor: 2, iterations: 2}
output: {pictures: false, snapshots: 0}
"""


class CompileAhead:
    """The child process, or nothing where it would not help.

    Parameters
    ----------
    kind : {"pytetwild", "bcc"}
        A lattice is there at once: there is nothing to hide behind.
    last : str
        The last stage to run.
    threads : int
        Threads of the run; with one the child would only be in its way.
    """

    def __init__(self, kind, last, threads):
        self._child = None
        late = STAGES.index(last) > STAGES.index("topopt")
        if late and kind != "bcc" and threads > 1 and not compiled():
            self._child = _spawn()

    @property
    def running(self):
        """Whether the child is still compiling."""
        return self._child is not None and self._child.poll() is None

    def wait(self):
        """Wait until the kernels are there, or the child has failed or takes too long."""
        if self._child is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._child.wait(LONGEST_WAIT)

    def close(self):
        """End the child if it still runs."""
        if self.running:
            self._child.kill()
            self._child.wait()


def compiled():
    """Whether numba's cache holds kernels of the last stage."""
    folder = os.environ.get("NUMBA_CACHE_DIR") or Path(remesh.__file__).parent / "__pycache__"
    return any(Path(folder).rglob("*.nbi"))


def _spawn():
    root = str(Path(__file__).resolve().parents[1])
    path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    quiet = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
    }
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "cases.compile_ahead"],
            env={**os.environ, "PYTHONPATH": path, "NUMBA_NUM_THREADS": "1"},
            **quiet,
        )
    except OSError:
        return None


def main():
    """Run the tiny case in a temporary folder."""
    from cases.cli import RunOptions
    from cases.pipeline import run_pipeline

    with tempfile.TemporaryDirectory(prefix="phasemesh-") as folder:
        path = Path(folder) / "tiny.yaml"
        path.write_text(TINY, encoding="utf-8")
        run_pipeline(path, path.name, RunOptions(out=Path(folder) / "run", threads=1, quiet=True))


if __name__ == "__main__":
    main()
