"""Remeshing quality, fidelity and CPU time on the measured inputs, beside what peers reach.

    python benchmarks/remesh.py [NAME ...] [--rotations K] [--metrics FOLDER] [--data FOLDER]
    python benchmarks/remesh.py --max-error [INPUT ...] [--peers FOLDER] [--data FOLDER]

One line per input: vertices, angles (mean / worst), mean 6D angle at sigma = 0.05 of the diagonal,
two-sided distance (rms and largest, 1e-5 of the diagonal), volume, self-intersections, and CPU
seconds of the second run (kernels compiled). The metrics are those of `surface_metrics.py`, which
needs trimesh, libigl and pymeshlab.

With --max-error instead the vertices that error bounds take, beside those of MeshLib, MeshLab and
fast-simplification at the same measured error; --peers makes (or takes) their environment.
"""

import argparse
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

for variable in ("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.remesh_bound import print_bounds  # noqa: E402
from meshes import TriMesh  # noqa: E402
from meshes.features import find_features  # noqa: E402
from meshes.io import read_surface  # noqa: E402
from remesh import RemeshSettings, TriangleSurface, remesh  # noqa: E402

SIGMA = 0.05  # of the diagonal, of the metrics


@dataclass(frozen=True)
class Ask:
    """One line of the table: the input, what is asked, and the best a peer was measured at."""

    name: str
    file: str
    vertices: int
    sigma: float = 0.0
    smoothing: int = 0
    features: bool = False
    best_peer: str = ""


ASKS = (
    Ask("beams 6D", "beams_mt", 12000, 0.05, 12, best_peer="A6 43, worst 0.3, rms 29.5, 5.5 s"),
    Ask("beams", "beams_mt", 12000, 0.0, 8, best_peer="mean 54.1, worst 36.6, rms 31, 2.3 s"),
    Ask("spot 6D", "spot", 2000, 0.05, best_peer="A6 51.7, worst 6.7, rms 34, 0.5 s"),
    Ask("spot", "spot", 2000, best_peer="mean 54.0, worst 37, rms 88, 0.2 s"),
    Ask("fandisk", "fandisk", 3000, 0.05, features=True, best_peer="mean 47.1, worst 15, rms 9.4"),
    Ask("bunny", "bunny_holes", 10000, features=True),
)


def turned(mesh, seed):
    """The mesh rotated at random (seed 0: as it is)."""
    if seed == 0:
        return mesh
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return mesh.with_points(mesh.points @ (turn * np.linalg.det(turn)))


def run(ask, folder, seed, evaluate):
    """Remesh one input twice; return the metrics of the result and the second run's CPU time."""
    plain = read_surface(folder / f"{ask.file}.ply")
    diagonal = plain.diagonal  # of the input as it lies in the file: sigma is absolute
    mesh = turned(TriMesh(plain.points, plain.faces), seed)
    settings = RemeshSettings(
        vertices=ask.vertices, sigma=ask.sigma * diagonal, smoothing=ask.smoothing
    )
    for _ in range(2):
        start = time.process_time()
        source = find_features(mesh) if ask.features else mesh
        result = remesh(source, TriangleSurface(source), settings).mesh
        seconds = time.process_time() - start
    found = evaluate(
        mesh.points, mesh.faces.astype(np.int64), np.array(result.points),
        result.faces.astype(np.int64), sigma=SIGMA * diagonal / mesh.diagonal,
    )  # fmt: skip
    return found, seconds, diagonal / mesh.diagonal


def line(ask, seed, found, seconds, scale):
    """One row of the table."""
    volume = "open" if found["vol_rel"] is None else f"{100 * found['vol_rel']:+.4f} %"
    return (
        f"{ask.name:10s} {seed:3d} {found['nV']:7d} {found['minang_mean']:6.2f}"
        f"/{found['minang_worst']:5.2f} {found['minang6_mean']:6.2f}"
        f" {1e5 * found['d_rms'] / scale:7.2f} {1e5 * found['d_max'] / scale:7.1f} {volume:>10s}"
        f" {found['selfint_faces']:4d} {found['same_genus']!s:>5s} {seconds:6.2f}   {ask.best_peer}"
    )


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="lines to run; all if none")
    parser.add_argument("--rotations", type=int, default=0, help="random rotations besides")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--metrics", type=Path, default=ROOT.parent / "shared" / "measure")
    parser.add_argument("--max-error", action="store_true", help="error bounds instead")
    parser.add_argument("--peers", type=Path, help="folder of a virtual environment for peers")
    options = parser.parse_args()
    if options.max_error:
        print_bounds(options.names, options.data, options.peers)
        return
    sys.path.insert(0, str(options.metrics))
    from surface_metrics import evaluate

    print("input      turn vertices   angle      A6     rms     max     volume  self genus   CPU s")
    for ask in ASKS:
        if options.names and ask.name not in options.names:
            continue
        for seed in range(options.rotations + 1):
            print(line(ask, seed, *run(ask, options.data, seed, evaluate)), flush=True)


if __name__ == "__main__":
    main()
