"""Kernels compiled in child processes while the domain is meshed and optimised.

The first run on a machine has to compile every numba kernel: about two minutes on one core.
Meshing keeps only one core busy, so a first run starts this module as child processes, one for
each group of later stages. Each runs its stages on a small ball, in a folder of its own, and so
fills numba's cache on disk, from which the run itself then loads the kernels.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import remesh
from cases.run_folder import STAGES

LONGEST_WAIT = 180.0  # seconds; after that the run compiles for itself

TINY = """\
name: tiny
domain:
  box: {lower: [0, 0, 0], upper: [20mm, 10mm, 10mm]}
symmetry: [x=0, y=0]
supports:
  foot: {plane: z=0, fixed: [x, y, z]}
loads:
  deck: {plane: z=10mm, traction: [0, 0, -2400]}
mesh: {kind: bcc, tets: 1500}
topopt: {volume_fraction: 0.4}
isosurface: {level: volume}
rbf: {support_factor: 2.5}
remesh: {edge_factor: 2, iterations: 2}
"""


class CompileAhead:
    """The child processes, or none where they would not help.

    Parameters
    ----------
    kind : {"pytetwild", "bcc"}
        A lattice is there at once: there is nothing to hide behind.
    last : str
        The last stage to run.
    threads : int
        Threads of the run; with one the children would only be in its way.
    """

    def __init__(self, kind, last, threads):
        self._children = {}
        if kind == "bcc" or threads == 1 or compiled():
            return
        for stage in COMPILED_WITH:
            if STAGES.index(stage) <= STAGES.index(last):
                self._children[stage] = _spawn(stage)

    def running(self, stage):
        """Whether the kernels of `stage` are still being compiled."""
        child = self._children.get(stage)
        return child is not None and child.poll() is None

    def wait(self, stage):
        """Wait until the kernels of `stage` are there, or their child has failed or takes long."""
        if self.running(stage):
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._children[stage].wait(LONGEST_WAIT)

    def close(self):
        """End the children that still run."""
        for stage, child in self._children.items():
            if self.running(stage):
                child.kill()
                child.wait()


def compiled():
    """Whether numba's cache holds kernels of the last stage."""
    folder = os.environ.get("NUMBA_CACHE_DIR") or Path(remesh.__file__).parent / "__pycache__"
    return any(Path(folder).rglob("*.nbi"))


def _spawn(stage):
    root = str(Path(__file__).resolve().parents[1])
    path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    quiet = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
    }
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "cases.compile_ahead", stage],
            env={**os.environ, "PYTHONPATH": path, "NUMBA_NUM_THREADS": "1"},
            **quiet,
        )
    except OSError:
        return None


def ball(folder):
    """A Run whose design is an eighth of a ball, and its raw isosurface."""
    from cases.design_stages import MeshStage
    from cases.load import load_case
    from cases.problem import to_problem
    from cases.progress import Reporter
    from cases.run_state import Run
    from cases.surface_stages import IsosurfaceStage
    from meshes import PhaseField
    from topopt.geometry import tet_geometry

    path = folder / "tiny.yaml"
    path.write_text(TINY, encoding="utf-8")
    loaded = load_case(path)
    run = Run(loaded, to_problem(loaded), folder, Reporter())
    MeshStage().run(run)
    radius = np.linalg.norm(run.mesh.points - [0.0, 0.0, 0.003], axis=1)
    values = np.clip(0.5 + (0.0075 - radius) / 0.004, 0.0, 1.0)
    run.design = PhaseField(run.mesh, values)
    volume = float(tet_geometry(run.mesh).lumped_mass @ values)
    run.figures["topopt"] = {"material_volume_m3": volume}
    IsosurfaceStage().run(run)
    return run


def smooth_ball(run):
    """Smooth the ball's isosurface and measure it: repair, filter, self-intersections."""
    from cases import report
    from cases.surface_stages import SmoothStage

    SmoothStage().run(run)
    report.quality(run)


def remesh_ball(run):
    """Interpolate and remesh the ball's isosurface."""
    from cases.remesh_stage import RemeshStage

    run.smoothed = run.isosurface
    RemeshStage().run(run)


COMPILED_WITH = {"smooth": smooth_ball, "remesh": remesh_ball}


def main(stage):
    """Run one group of stages on the ball, in a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="phasemesh-") as folder:
        COMPILED_WITH[stage](ball(Path(folder)))


if __name__ == "__main__":
    main(sys.argv[1])
