"""Surfaces of coarse runs beside those of runs at half the edge length, as tables.

    python -m benchmarks.isosurface_runs [--keep DIR] [--pairs FIRST LAST]

A pair is a run on a body-centred cubic lattice and one on the lattice of half the cells, which goes
on from the first one's design, so that both lie in the same minimum; gamma and eps are the same.
Both surfaces enclose the material's volume. Distances are root mean squares from the fine run's
surface (quadratic crossings, as extracted), both ways, in mean edges h of the coarse lattice.

What the distance consists of: its signed mean; its root mean square after averaging over balls of
1, 2 and 4 h (waves much shorter than the ball are gone); and the distance of the fine field sampled
at the coarse nodes, which is that of the extraction alone. --keep: a folder for the designs.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

ROOT = Path(__file__).resolve().parents[1]
if __package__ in (None, ""):
    sys.path[0] = str(ROOT)

import isosurface as iso  # noqa: E402
from benchmarks.isosurface import sampled  # noqa: E402
from cases.load import load_case  # noqa: E402
from cases.problem import to_problem  # noqa: E402
from isosurface.crossing import CROSSINGS  # noqa: E402
from meshes import PhaseField  # noqa: E402
from meshes.closest_point import ClosestPoint, two_sided_distance  # noqa: E402
from meshes.quality import area_vectors, face_normals  # noqa: E402
from meshes.structured import bcc_box  # noqa: E402
from meshes.tet_mesh import tet_volumes  # noqa: E402
from topopt.domain import attach_sets  # noqa: E402
from topopt.optimize import OptimizationSettings, optimize  # noqa: E402
from topopt.parameters import mean_edge_length  # noqa: E402
from topopt.transfer import transferred  # noqa: E402

# Case, cells of the coarse lattice, edges across the interface. The crossings' trust in their
# quadratics (`crossing.MISFIT`) was chosen on the first twelve; the others are its test.
PAIRS = (
    ("bridge", (12, 4, 5), 4), ("bridge", (13, 4, 5), 6), ("bridge", (14, 4, 6), 6),
    ("bridge", (15, 5, 6), 3), ("bridge", (15, 5, 6), 4), ("bridge", (16, 5, 6), 4),
    ("bridge", (18, 5, 7), 6), ("table", (12, 4, 5), 6), ("table", (13, 4, 6), 6),
    ("table", (15, 4, 6), 4), ("tower", (15, 3, 3), 6), ("tower", (20, 4, 4), 4),
    ("bridge", (13, 4, 6), 4), ("bridge", (17, 5, 6), 4), ("bridge", (19, 6, 7), 4),
    ("bridge", (19, 6, 7), 6), ("bridge", (20, 6, 8), 5), ("table", (14, 4, 5), 6),
    ("table", (16, 5, 7), 6), ("table", (17, 5, 7), 4), ("tower", (17, 3, 3), 6),
    ("tower", (18, 3, 3), 4), ("tower", (21, 4, 4), 5), ("tower", (23, 4, 4), 6),
)  # fmt: skip
CHOSEN_ON = 12
SETTINGS = OptimizationSettings(steps=150, tolerance=5e-4, stagnation=0.0, check_resolution=False)
SAMPLES = 30_000


def main():
    """Print a line for each pair, and the means."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, metavar="DIR")
    parser.add_argument("--pairs", nargs=2, type=int, default=(0, len(PAIRS)))
    options = parser.parse_args()
    print(f"{'case, tets, edges across':25} |  mean  1 h   2 h   4 h   | {columns()}")
    rows = {}
    for number in range(*options.pairs):
        coarse, fine = designs(*PAIRS[number], options.keep)
        rows[number] = print_pair(PAIRS[number], coarse, fine)
    for name, chosen in (("first 12", range(CHOSEN_ON)), ("others", range(CHOSEN_ON, len(PAIRS)))):
        found = np.array([rows[number] for number in chosen if number in rows])
        if len(found):
            print_means(name, found)


def columns():
    """Head of the columns of `print_pair`."""
    names = [f"{field} {crossing[:4]}" for field in ("own", "samp") for crossing in CROSSINGS]
    return "  ".join(f"{name:9}" for name in names)


def designs(case, cells, edges, keep=None):
    """The designs of a coarse run and of the run at half its edge length that goes on from it."""
    problem = to_problem(load_case(ROOT / "cases" / f"{case}.yaml"))
    meshes = [lattice(problem, np.multiply(cells, factor)) for factor in (1, 2)]
    path = keep and keep / f"{case}-{'-'.join(map(str, cells))}-{edges}.npz"
    if path and path.exists():
        with np.load(path) as kept:
            values = [kept["coarse"], kept["fine"]]
    else:
        values = optimized(problem, meshes, edges)
        if path:
            np.savez(path, coarse=values[0], fine=values[1])
    return [PhaseField(mesh, of) for mesh, of in zip(meshes, values)]


def lattice(problem, cells):
    """The mesh of a box domain with so many cells."""
    return attach_sets(bcc_box(problem.domain.lower, problem.domain.upper, cells), problem)


def optimized(problem, meshes, edges):
    """Nodal values of both runs; prints how they went."""
    eps = edges * mean_edge_length(meshes[0]) * np.sqrt(2.0) / np.pi
    problem = replace(problem, eps=eps, gamma=None)
    start, values = None, []
    for mesh in meshes:
        started = time.perf_counter()
        start = start and transferred(start, mesh)
        result = optimize(mesh, problem, SETTINGS, start)
        problem = replace(problem, gamma=result.gamma)
        start = result.phase_field
        values.append(start.values)
        row = result.history[-1]
        print(
            f"  {len(mesh.tets)} tets: J = {row.objective_J:.4e} J, KKT {row.kkt_residual:.1e} "
            f"after {row.iteration} steps, {time.perf_counter() - started:.0f} s",
            flush=True,
        )
    return values


def print_pair(pair, coarse, fine):
    """Print what the distance of a pair consists of; two-sided distances (2, 3) of its surfaces."""
    mesh, size = coarse.mesh, mean_edge_length(coarse.mesh)
    problem = to_problem(load_case(ROOT / "cases" / f"{pair[0]}.yaml"))
    volume = problem.volume_fraction * tet_volumes(mesh.points, mesh.tets).sum()
    reference = iso.mirror(surface_of(fine, volume, "quadratic"), mesh.symmetry)
    parts = waves(surface_of(coarse, volume, "quadratic"), mesh.symmetry, reference, size)
    found = np.empty((2, 3))
    for row, field in enumerate((coarse, sampled(fine, mesh))):
        for column, crossing in enumerate(CROSSINGS):
            final = smoothed(surface_of(field, volume, crossing), mesh.symmetry, volume)
            whole = iso.mirror(final, mesh.symmetry)
            found[row, column] = two_sided_distance(whole, reference, SAMPLES)[0] / size
    label = f"{pair[0]}, {len(mesh.tets)}, {pair[2]}"
    parts = " ".join(f"{part:.3f}" for part in parts)
    print(f"{label:25} | {parts} | " + "  ".join(f"{x:<9.3f}" for x in found.ravel()), flush=True)
    return found


def surface_of(field, volume, crossing):
    """The surface as extracted, at the level that encloses the volume."""
    symmetry = field.mesh.symmetry

    def enclosed(level):
        return iso.modelled_volume(iso.extract_surface(field, level, crossing), symmetry)

    level = iso.surface_level(field, volume, enclosed)
    return iso.extract_surface(iso.drop_islands(field, level)[0], level, crossing)


def smoothed(surface, symmetry, volume):
    """The surface as the cases smooth it."""
    repaired, _ = iso.repair_slivers(surface, symmetry)
    return iso.smooth(repaired, iso.SmoothingSettings(target_volume=volume), symmetry)[0]


def waves(surface, symmetry, reference, size):
    """Signed mean distance, and root mean squares of its averages over balls of 1, 2 and 4 h."""
    whole = iso.mirror(surface, symmetry)
    faces = whole.faces[whole.face_labels == [p.name for p in whole.labels].index("isosurface")]
    places = whole.points[faces].mean(axis=1)
    area = np.linalg.norm(area_vectors(whole.points, faces), axis=1)
    face, weights, _ = ClosestPoint(reference.points, reference.faces).query(places)
    nearest = np.einsum("ij,ijk->ik", weights, reference.points[reference.faces[face]])
    normals = face_normals(reference.points, reference.faces)[face]
    apart = places - nearest
    signed = np.sign(np.einsum("ij,ij->i", apart, normals)) * np.linalg.norm(apart, axis=1) / size
    tree, found = cKDTree(places), [np.average(signed, weights=area)]
    for radius in (1.0, 2.0, 4.0):
        near = tree.query_ball_point(places, radius * size)
        means = np.array([np.average(signed[of], weights=area[of]) for of in near])
        found.append(np.sqrt(np.average(means**2, weights=area)))
    return found


def print_means(name, found):
    """Geometric means of distances (k, 2, 3) relative to linear crossings, and who is closer."""
    share = found / found[:, :, :1]
    for row, field in enumerate(("own", "sampled")):
        parts = [
            f"{crossing} {np.exp(np.log(share[:, row, k]).mean()):.3f} "
            f"(closer in {np.count_nonzero(share[:, row, k] < 1.0)} of {len(found)})"
            for k, crossing in enumerate(CROSSINGS)
            if k
        ]
        print(f"{name}, {field}: {', '.join(parts)}")


if __name__ == "__main__":
    main()
