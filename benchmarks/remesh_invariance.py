"""How little rotation, scale and translation change: counts and angles beside the plain input's.

    python benchmarks/remesh_invariance.py [NAME ...] [--rotations K] [--data FOLDER]

sigma is absolute. One line per input and motion: vertices, mean and worst smallest angle, and their
changes in per cent. Same connectivity is asked of powers of two alone.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.remesh import ASKS, turned  # noqa: E402
from meshes import TriMesh  # noqa: E402
from meshes.features import find_features  # noqa: E402
from meshes.io import read_surface  # noqa: E402
from remesh import RemeshSettings, remesh  # noqa: E402
from remesh.embedding import smallest_angles  # noqa: E402

SCALES = (1e-3, 1e3, 0.7, 3.0, 2.0**-10, 2.0**10)


def motions(rotations):
    """Name, scale, seed of the rotation, and translation in diagonals of every motion."""
    yield "as it is", 1.0, 0, 0.0
    for seed in range(1, rotations + 1):
        yield f"rotation {seed}", 1.0, seed, 0.0
    for scale in SCALES:
        yield f"scale {scale:g}", scale, 0, 0.0
    yield "translation", 1.0, 0, 3.0


def result_of(ask, plain, scale, seed, shift):
    """The remeshed surface of a moved input."""
    diagonal = plain.diagonal
    mesh = turned(TriMesh(plain.points, plain.faces), seed)
    mesh = mesh.with_points(scale * (mesh.points + shift * diagonal))
    source = find_features(mesh) if ask.features else mesh
    settings = RemeshSettings(
        vertices=ask.vertices, sigma=ask.sigma * diagonal * scale, smoothing=ask.smoothing
    )
    return remesh(source, settings=settings).mesh


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="inputs of benchmarks/remesh.py; all if none")
    parser.add_argument("--rotations", type=int, default=5)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    options = parser.parse_args()
    print("input      motion           vertices  mean   worst   changes in %: count, mean, worst")
    for ask in ASKS:
        if options.names and ask.name not in options.names:
            continue
        plain, first = read_surface(options.data / f"{ask.file}.ply"), None
        for name, scale, seed, shift in motions(options.rotations):
            mesh = result_of(ask, plain, scale, seed, shift)
            angles = smallest_angles(mesh.points[mesh.faces])
            found = np.array([len(mesh.points), angles.mean(), angles.min()])
            first = (found, mesh.faces) if first is None else first
            change = 100.0 * (found / first[0] - 1.0)
            same = "  same connectivity" if np.array_equal(mesh.faces, first[1]) else ""
            print(
                f"{ask.name:10s} {name:16s} {len(mesh.points):8d} {found[1]:6.2f} {found[2]:6.2f}  "
                f"{change[0]:+6.2f} {change[1]:+6.2f} {change[2]:+7.2f}{same}",
                flush=True,
            )


if __name__ == "__main__":
    main()
