"""Whole design iterations beside pyMOTO and beside the stock pyamg solver, as one table.

    python benchmarks/optimize.py [--cells 16 32] [--iterations 12] [--threads N] [--pyamg]
                                  [--peers DIR]

A cantilever three times as long as high and wide, clamped at one end, its load on the lower edge
of the other, volume 0.3, from a uniform start; every state solve to 1e-5 or better. pyMOTO
(--peers DIR makes a virtual environment for it in DIR) optimises the densities of 3 c x c x c
voxels, c = --cells, by optimality criteria with its geometric multigrid and conjugate gradients; we
optimise the phase field on a tetrahedral box with as many unknowns. --pyamg adds our own loop with
pyamg's smoothed aggregation in the solver's slot. Each row is measured in a process of its own;
printed are means over the design iterations after the second.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PEER = "pyMOTO"
TOLERANCE = 1e-5
VOLUME = 0.3
SKIPPED = 2  # iterations at the start that are not counted


def main():
    """Run the rows one by one and print them, with the ratios to ours."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="*", default=[16, 32], help="across")
    parser.add_argument("--iterations", type=int, default=12)
    parser.add_argument("--threads", type=int, help="of numba; all cores if not given")
    parser.add_argument("--pyamg", action="store_true", help="our loop with pyamg, too")
    parser.add_argument("--peers", type=Path, help="folder of a virtual environment for peers")
    parser.add_argument("--row", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.row:
        name, cells = options.row.split(":")
        print(json.dumps(ROWS[name](int(cells), options.iterations)))
        return
    environment = dict(os.environ, OPENBLAS_NUM_THREADS="1")
    environment.setdefault("GOMP_SPINCOUNT", "10000")  # as the command line of the cases has it
    if options.threads:
        environment["NUMBA_NUM_THREADS"] = str(options.threads)
    pythons = {"multigrid": sys.executable}
    if options.pyamg:
        pythons["pyamg"] = sys.executable
    if options.peers:
        pythons["pymoto"] = make_peer_environment(options.peers.resolve())
    print("per design iteration      unknowns   wall s    CPU s   state solve us/unknown   ratio")
    for cells in options.cells:
        ours = None
        for name, python in pythons.items():
            command = [python, "-P", __file__, "--row", f"{name}:{cells}"]
            command += ["--iterations", str(options.iterations)]
            run = subprocess.run(command, env=environment, capture_output=True, text=True)
            if run.returncode:
                print(f"{name:24s} failed: {run.stderr.strip().splitlines()[-1]}")
                continue
            result = json.loads(run.stdout.splitlines()[-1])
            ours = ours or result
            print_row(name, result, ours)


def print_row(name, result, ours):
    """One line: seconds, microseconds per unknown, and how many times ours."""
    state = result.get("state_us")
    wall, cpu = (result[k] / ours[k] for k in ("wall", "cpu"))
    print(
        f"{name:24s} {result['unknowns']:9d} {result['wall']:8.3f} {result['cpu']:8.3f}"
        f"   {'' if state is None else f'{state:.2f}':>21s}   {wall:.2f} wall, {cpu:.2f} CPU",
        flush=True,
    )


def make_peer_environment(folder):
    """A virtual environment with pyMOTO; returns its interpreter."""
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    subprocess.run([python, "-m", "pip", "install", "-q", PEER], check=True)
    return str(python)


def means(marks):
    """Mean wall and CPU seconds between the marks, the first iterations left out."""
    (wall, cpu), (wall_end, cpu_end) = marks[SKIPPED], marks[-1]
    count = len(marks) - 1 - SKIPPED
    return {"wall": (wall_end - wall) / count, "cpu": (cpu_end - cpu) / count}


def mark():
    """Wall and CPU clock."""
    return time.perf_counter(), time.process_time()


# --- ours ------------------------------------------------------------------------------------


def our_cantilever(unknowns):
    """The cantilever on the tetrahedral box nearest to so many unknowns: (mesh, problem)."""
    from meshes.structured import bcc_box
    from topopt.problem import Box, BoxDomain, Load, Problem, Support

    size, everywhere = (0.06, 0.02, 0.02), 1.0
    meshes = (bcc_box((0, 0, 0), size, (3 * c, c, c)) for c in cells_near(unknowns))
    mesh = min(meshes, key=lambda m: abs(3 * len(m.points) - unknowns))
    wall = Box((0.0, -everywhere, -everywhere), (0.0, everywhere, everywhere))
    edge = Box((size[0], 0.0, 0.0), (size[0], size[1], 0.05 * size[2]))
    problem = Problem(
        BoxDomain((0.0, 0.0, 0.0), size),
        supports=(Support("wall", wall),),
        loads=(Load("edge", edge, (0.0, 0.0, -20000.0)),),
        volume_fraction=VOLUME,
    )
    return mesh, problem


def cells_near(unknowns):
    """Cells across, for boxes of about six nodes a cell cubed."""
    middle = round((unknowns / 3 / 6) ** (1 / 3))
    return range(max(1, middle - 1), middle + 2)


def our_row(solver):
    """A row of our own loop with the given solver."""

    def row(cells, iterations):
        sys.path.insert(0, str(ROOT))
        from topopt.optimize import OptimizationSettings, optimize

        settings = {"tolerance": 0.0, "stagnation": 0.0, "solver": solver}
        settings["state_tolerance"] = TOLERANCE
        optimize(*our_cantilever(4000), OptimizationSettings(steps=3, **settings))  # compiles
        mesh, problem = our_cantilever(3 * (3 * cells + 1) * (cells + 1) ** 2)
        marks, states = [], []

        def note(_, loop):
            marks.append(mark())
            states.append(loop.state)

        optimize(mesh, problem, OptimizationSettings(steps=iterations, **settings), callback=note)
        seconds = [s.setup_seconds + s.solve_seconds for s in states[SKIPPED + 1 :]]
        unknowns = 3 * len(mesh.points)
        state = 1e6 * sum(seconds) / len(seconds) / unknowns
        return {"unknowns": unknowns, "state_us": state, **means(marks)}

    return row


# --- theirs, run by their own interpreter ----------------------------------------------------


def pymoto_row(cells, iterations):
    """A row of pyMOTO: SIMP, filter, multigrid down to 4 voxels across, optimality criteria."""
    import contextlib
    import io

    import numpy as np
    import pymoto as pym

    domain = pym.VoxelDomain(3 * cells, cells, cells)
    wall = domain.get_nodenumber(*np.meshgrid(0, range(cells + 1), range(cells + 1))).ravel()
    edge = domain.get_nodenumber(3 * cells, np.arange(cells + 1), 0)
    force = np.zeros(3 * domain.nnodes)
    force[3 * edge + 2] = -1.0 / len(edge)
    levels = [pym.solvers.GeometricMultigrid(domain)]
    while levels[-1].sub_domain.nely % 2 == 0 and levels[-1].sub_domain.nely >= 8:
        levels.append(pym.solvers.GeometricMultigrid(levels[-1].sub_domain))
        levels[-2].inner_level = levels[-1]
    solver = pym.solvers.CG(preconditioner=levels[0], tol=TOLERANCE)
    marks, update = [], solver.update

    def marked_update(matrix):  # once in a design iteration
        marks.append(mark())
        return update(matrix)

    solver.update = marked_update
    density = pym.Signal("x", state=np.full(domain.nel, VOLUME))
    with pym.Network() as network:
        filtered = pym.DensityFilter(domain, radius=1.5)(density)
        stiffness = pym.MathExpression("1e-4 + (1 - 1e-4)*inp0^3")(filtered)
        held = (3 * wall[:, None] + np.arange(3)).ravel()
        matrix = pym.AssembleStiffness(domain, bc=held)(stiffness)
        displacement = pym.LinSolve(hermitian=True, solver=solver)(matrix, force)
        compliance = pym.EinSum("i,i->")(displacement, force)
        objective = pym.Scaling(scaling=100.0)(compliance)
    with contextlib.redirect_stdout(io.StringIO()):
        pym.minimize_oc(
            density, objective, function=network, maxit=iterations + 1, tolx=0.0, tolf=0.0
        )
    return {"unknowns": 3 * domain.nnodes, **means(marks)}


ROWS = {"multigrid": our_row("multigrid"), "pyamg": our_row("pyamg"), "pymoto": pymoto_row}


if __name__ == "__main__":
    main()
