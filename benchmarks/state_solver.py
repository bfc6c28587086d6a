"""The state solve beside the stock pyamg recipe, on one table.

    python -m benchmarks.state_solver [--sizes 20 160 640] [--repeats 5] [--mesh FILE.npz]
                                      [--run FOLDER] [--peer]

Prints, for boxes of about 20k, 160k and 640k unknowns (and for the mesh in FILE.npz with arrays
`points` and `tets`, and for the bridge's mesh and final design in the FOLDER of a run), wall and
CPU microseconds per unknown of the assembly, of the numeric set-up and of the solve to 1e-5 for an
arch of material in void; the share of the machine's streaming bandwidth the solve reaches; and
with --peer the same system solved by pyamg's smoothed aggregation with its own block Gauss-Seidel
smoother. The best of the repeats counts.
"""

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numba
import numpy as np
from numba import njit, prange

from meshes.io import load_tet_mesh
from meshes.structured import bcc_box
from meshes.tet_mesh import TetMesh, boundary_facets, tet_volumes
from topopt.elasticity import ElasticModel
from topopt.interpolation import stiffness_factor
from topopt.problem import BoundaryConditions, BoxDomain, Problem

SIZE = np.array([0.05, 0.015, 0.02])
TOLERANCE = 1e-5


def box_of(unknowns):
    """A BCC box of the bridge's quarter with about so many unknowns."""
    cell = (np.prod(SIZE) * 2.3 * 3 / unknowns) ** (1 / 3)
    return bcc_box((0, 0, 0), SIZE, np.maximum(1, np.round(SIZE / cell)).astype(int))


def mesh_of(path):
    """The mesh in an .npz file with arrays `points` and `tets`."""
    with np.load(path) as data:
        points, tets = (data[k] for k in ("points", "tets"))
    inverted = tet_volumes(points, tets) < 0
    tets[inverted] = tets[inverted][:, [0, 2, 1, 3]]
    facets = boundary_facets(tets)
    return TetMesh(points, tets, facets, np.zeros(len(facets)), ())


def bridge(mesh):
    """Supports and load of the bridge's quarter, and a finished arch as phase field."""
    x, y, z = mesh.points.T
    fixed = np.zeros(mesh.points.shape, bool)
    fixed[:, 0], fixed[:, 1] = x <= 1e-9, y <= 1e-9
    fixed[(z <= 1e-9) & (x >= 0.045)] = True
    forces = np.zeros(mesh.points.shape)
    top = (z >= SIZE[2] - 1e-9) & (x <= 0.01) & (y <= 0.01)
    forces[top, 2] = -0.24 / top.sum()
    middle = 0.0175 * (1 - (x / 0.0475) ** 2)
    rib = np.abs(z - middle) / np.hypot(1, 2 * 0.0175 * x / 0.0475**2) - 0.0016
    rib = np.maximum(rib, y - 0.0045)
    deck = np.maximum(np.maximum(np.abs(z - 0.0187) - 0.0013, x - 0.011), y - 0.011)
    phi = 0.5 * (1 - np.tanh(3 * np.minimum(rib, deck) / 0.00175))
    return BoundaryConditions(fixed, forces, {}), phi


@njit(parallel=True, fastmath=True)
def _sweep(a, b, c):
    for i in prange(a.shape[0]):
        a[i] = b[i] + 0.5 * c[i]


def streaming_bandwidth():
    """GB/s of a triad on the threads in use, best of some; write-allocation counted."""
    a, b, c = (np.ones(8_000_000) for _ in range(3))
    best = np.inf
    for _ in range(12):
        began = time.perf_counter()
        _sweep(a, b, c)
        best = min(best, time.perf_counter() - began)
    return 4 * a.nbytes / best / 1e9


class Stopwatch:
    """Best wall and CPU seconds of each named phase over the repeats."""

    def __init__(self):
        self.best = {}

    def run(self, phase, action):
        wall, cpu = time.perf_counter(), time.process_time()
        result = action()
        spent = np.array([time.perf_counter() - wall, time.process_time() - cpu])
        self.best[phase] = np.minimum(self.best.get(phase, np.inf), spent)
        return result


def our_solve(model, phi, forces, repeats):
    """Assembly, set-up and solve, each phase by itself."""
    watch = Stopwatch()
    factor = stiffness_factor(phi, model.mesh.tets, model.material.void_ratio)[model._tet_order]
    for _ in range(repeats):
        assemble = lambda: model._assembler.assemble(factor, model._matrix)  # noqa: E731
        model._matrix = watch.run("assembly", assemble)
        watch.run("set-up", lambda: model._solver.update(model._matrix))
        solution = watch.run("solve", lambda: model._solver.solve(forces, tolerance=TOLERANCE))
    compliance = np.vdot(forces + solution.residual_vector, solution.displacement)
    return watch.best, solution.iterations, compliance


def bytes_per_iteration(solver):
    """What one iteration of conjugate gradients reads: every matrix as often as it is used."""
    settings, visits = solver.settings, 1
    total = solver._matrix[2].nbytes + solver._matrix[1].nbytes
    for depth, level in enumerate(solver.hierarchy.levels[:-1]):
        matrix = level.blocks.nbytes + level.pattern.indices.nbytes
        if depth > 0 and level.f.size <= settings.krylov_unknowns:
            total += 2 * visits * matrix
            visits *= 2
        transfer = level.p_blocks.nbytes + level.transfer.prolongator.indices.nbytes
        total += visits * 2 * (settings.degree * (matrix + level.inverse.nbytes) + transfer)
    return total


def report(name, best, iterations, compliance, unknowns, extra=""):
    phases = {k: 1e6 * v / unknowns for k, v in best.items()}
    both = phases["set-up"] + phases["solve"]
    cells = [f"{phases[k][0]:6.2f}/{phases[k][1]:6.2f}" for k in best]
    print(
        f"{name:10s} {unknowns:8d}  {'  '.join(cells)}  {both[0]:6.2f}/{both[1]:6.2f}"
        f"  {iterations:4d}  {compliance:.9e}  {extra}"
    )
    return both


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="*", default=[20, 160, 640])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--mesh", action="append", default=[])
    parser.add_argument("--run", action="append", default=[], type=Path)
    parser.add_argument("--peer", action="store_true", help="also solve with stock pyamg")
    options = parser.parse_args()
    bandwidth = streaming_bandwidth()
    print(f"{numba.get_num_threads()} threads, streaming {bandwidth:.1f} GB/s, to {TOLERANCE:g}")
    print("microseconds per unknown, wall/CPU")
    print(
        "solver     unknowns       assembly         set-up          solve   set-up+solve"
        "  iter   compliance"
    )
    for mesh in (box_of(1000 * size) for size in options.sizes):
        compare(mesh, None, options, bandwidth)
    for path in options.mesh:
        compare(mesh_of(path), None, options, bandwidth)
    for folder in options.run:
        with np.load(folder / "phase_field.npz") as data:
            design = data["values"]
        compare(load_tet_mesh(folder / "mesh.npz"), design, options, bandwidth)


def compare(mesh, design, options, bandwidth):
    """Print the rows of one mesh, for a design or (None) for an arch."""
    conditions, phi = bridge(mesh)
    phi = phi if design is None else design
    problem = Problem(BoxDomain((0, 0, 0), tuple(SIZE)), (), (), 0.1)
    unknowns = 3 * len(mesh.points)
    began = time.process_time()
    model = ElasticModel(mesh, problem, conditions, "multigrid")
    once = time.process_time() - began
    forces = np.where(conditions.fixed, 0.0, conditions.forces)[model._order]
    ours = our_solve(model, phi, forces, options.repeats)
    moved = bytes_per_iteration(model._solver) * ours[1] / ours[0]["solve"][0] / 1e9
    note = f"once per mesh {once:.2f} s CPU; {100 * moved / bandwidth:.0f} % of streaming"
    both = report("multigrid", *ours, unknowns, note)
    share = ours[0]["assembly"] / ours[0]["solve"]
    print(f"{'':10s} assembly / solve {share[0]:.2f} wall, {share[1]:.2f} CPU")
    if options.peer:
        peer = ElasticModel(mesh, problem, conditions, "pyamg")
        theirs = our_solve(peer, phi, forces, max(1, options.repeats // 3))
        slower = report("pyamg", *theirs, unknowns) / both
        print(f"{'':10s} pyamg / multigrid: {slower[0]:.1f} wall, {slower[1]:.1f} CPU")


if __name__ == "__main__":
    main()
