"""How little rotation, scale and translation change: counts and angles beside the plain input's.

    python benchmarks/remesh_invariance.py [NAME ...] [--rotations K] [--single] [--data FOLDER]

sigma is absolute. One line per input and motion: vertices, mean and worst smallest angle, mean 6D
angle at sigma = 0.05 of the diagonal, rms distance (1e-5 of the diagonal of the input as it lies),
their changes in per cent, and, where the connectivity is the same, how far points lie from the
moved points of the first result (in diagonals; figures are not measured again below 1e-6). With
--single moved inputs are stored in single precision, as in most files, which makes them other
surfaces. The metrics are those of `surface_metrics.py`, which needs trimesh and libigl.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.remesh import ASKS, SIGMA, turned  # noqa: E402
from meshes import TriMesh  # noqa: E402
from meshes.features import find_features  # noqa: E402
from meshes.io import read_surface  # noqa: E402
from remesh import RemeshSettings, remesh  # noqa: E402

SCALES = (1e-3, 1e3, 0.7, 3.0, 2.0**-10, 2.0**10)
SAME = 1e-6  # of the diagonal


def motions(rotations):
    """Name, scale, seed of the rotation, and translation in diagonals of every motion."""
    yield "as it is", 1.0, 0, 0.0
    for seed in range(1, rotations + 1):
        yield f"rotation {seed}", 1.0, seed, 0.0
    for scale in SCALES:
        yield f"scale {scale:g}", scale, 0, 0.0
    yield "translation", 1.0, 0, 3.0


SAMPLES = 100_000


def result_of(ask, plain, scale, seed, shift, single):
    """A moved input, its remeshed surface, and the points of that moved back."""
    diagonal = plain.diagonal
    mesh = turned(TriMesh(plain.points, plain.faces), seed)
    mesh = mesh.with_points(scale * (mesh.points + shift * diagonal))
    if single:
        mesh = mesh.with_points(mesh.points.astype(np.float32).astype(float))
    source = find_features(mesh) if ask.features else mesh
    settings = RemeshSettings(
        vertices=ask.vertices, sigma=ask.sigma * diagonal * scale, smoothing=ask.smoothing
    )
    result = remesh(source, settings=settings).mesh
    turn = turned(TriMesh(np.eye(3), [[0, 1, 2]]), seed).points
    return mesh, result, (result.points / scale - shift * diagonal) @ turn.T


def figures_of(mesh, result, diagonal, evaluate):
    """Vertices, mean and worst angle, mean 6D angle and rms distance of a result."""
    ratio = diagonal / mesh.diagonal
    found = evaluate(
        mesh.points - mesh.points.mean(axis=0), mesh.faces.astype(np.int64),
        result.points - mesh.points.mean(axis=0), result.faces.astype(np.int64),
        sigma=SIGMA * ratio, samples=SAMPLES, do_selfint=False,
    )  # fmt: skip
    return np.array([
        found["nV"], found["minang_mean"], found["minang_worst"], found["minang6_mean"],
        1e5 * found["d_rms"] / ratio,
    ])  # fmt: skip


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="inputs of benchmarks/remesh.py; all if none")
    parser.add_argument("--rotations", type=int, default=5)
    parser.add_argument("--single", action="store_true", help="move in single precision")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--metrics", type=Path, default=ROOT.parent / "shared" / "measure")
    options = parser.parse_args()
    sys.path.insert(0, str(options.metrics))
    from surface_metrics import evaluate

    print("input      motion           vertices  mean  worst     A6    rms   changes in %")
    for ask in ASKS:
        if options.names and ask.name not in options.names:
            continue
        plain, first = read_surface(options.data / f"{ask.file}.ply"), None
        changes = []
        for name, scale, seed, shift in motions(options.rotations):
            moved = options.single and name != "as it is"
            mesh, result, back = result_of(ask, plain, scale, seed, shift, moved)
            alike = first is not None and np.array_equal(result.faces, first[1].faces)
            far = np.abs(back - first[1].points).max() / plain.diagonal if alike else np.inf
            found = first[0] if far < SAME else None
            if found is None:
                found = figures_of(mesh, result, scale * plain.diagonal, evaluate)
            first = (found, result) if first is None else first
            changes.append(100.0 * (found / first[0] - 1.0))
            print(
                f"{ask.name:10s} {name:16s} {found[0]:8.0f}" + "%7.2f" * 4 % tuple(found[1:])
                + "%+7.2f" * 5 % tuple(changes[-1])
                + (f"  same connectivity, points within {far:.0e}" if alike else ""), flush=True,
            )  # fmt: skip
        largest = np.abs(changes).max(axis=0)
        print(f"{ask.name:10s} {'largest change':53s}" + "%7.2f" * 5 % tuple(largest), flush=True)


if __name__ == "__main__":
    main()
