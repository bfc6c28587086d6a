"""Our cantilever beside a SIMP one: both as 0/1 voxels, both re-solved by pyMOTO on one mesh.

    python benchmarks/cantilever.py --peers DIR [--cells 48] [--gamma G] [--eps E] [--levels 2]

The box of 48 x 16 x 16 unit voxels has E = 1 and nu = 0.3, is clamped at x = 0 and carries a load
of 1, spread over the 17 nodes of the lower edge of its other end; volume 0.3. pyMOTO (in a virtual
environment of its own in DIR) optimises densities with p = 3, a filter of radius 1.5 and 60
optimality criteria steps, and keeps the 30 % densest voxels. Our phase field is optimised on a
tetrahedral lattice until its KKT residual is small; kept are the 30 % of the voxels with the
largest mean of phi. pyMOTO's hexahedra then give the compliance of both, void at 1e-9.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
CELLS = (48, 16, 16)
VOLUME, VOID = 0.3, 1e-9
POWER, RADIUS, STEPS = 3, 1.5, 60
ALLOWED = 1.03


def main():
    """Optimise both, re-solve both, print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peers", type=Path, required=True, help="folder of pyMOTO's environment")
    parser.add_argument("--cells", type=int, default=48, help="of the finest lattice, along x")
    parser.add_argument("--gamma", type=float, default=0.002)
    parser.add_argument("--eps", type=float, default=0.9)
    parser.add_argument("--tolerance", type=float, default=0.02)
    parser.add_argument("--levels", type=int, default=2)
    parser.add_argument("--row", help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.row:
        ROWS[options.row](options.folder)
        return
    from benchmarks.optimize import make_peer_environment

    python = make_peer_environment(options.peers.resolve())
    with tempfile.TemporaryDirectory(prefix="phasemesh-") as name:
        folder = Path(name)
        seconds = {"ours": our_design(folder, options)}
        seconds["simp"] = run_peer(python, "simp", folder)
        run_peer(python, "judge", folder)
        compliance = json.loads((folder / "compliance.json").read_text())
    print("0/1 design      voxels   compliance   seconds of its optimisation")
    for name, (count, value) in compliance.items():
        print(f"{name:14s} {count:7d} {value:12.4f} {seconds[name]:10.1f}")
    ratio = compliance["ours"][1] / compliance["simp"][1]
    print(f"ours / SIMP: {ratio:.4f} (at most {ALLOWED})")
    sys.exit(ratio > ALLOWED)


def run_peer(python, row, folder):
    """Run a row by the peer's interpreter; returns its seconds."""
    began = time.perf_counter()
    command = [python, "-P", __file__, "--row", row, "--folder", folder, "--peers", folder]
    subprocess.run(command, check=True)
    return time.perf_counter() - began


# --- ours ------------------------------------------------------------------------------------


def our_design(folder, options):
    """Optimise on nested lattices and keep the voxels: ours.npy; returns the seconds."""
    from meshes.structured import bcc_box
    from topopt.levels import Levels, coarse_settings
    from topopt.optimize import OptimizationSettings, optimize

    problem = our_problem(options)
    across = [options.cells // 2**k for k in reversed(range(options.levels))]
    meshes = [bcc_box((0, 0, 0), CELLS, (n, n // 3, n // 3)) for n in across]
    levels = Levels(problem, meshes[0], len(meshes))
    final = OptimizationSettings(steps=300, tolerance=options.tolerance, stagnation=0.0)
    began, start = time.perf_counter(), levels.first()
    for k, mesh in enumerate(meshes):
        last = k == len(meshes) - 1
        result = optimize(mesh, problem, final if last else coarse_settings(final), start)
        if not last:
            start = levels.next(mesh, result.loop, meshes[k + 1])
    seconds = time.perf_counter() - began
    row = result.history[-1]
    print(
        f"phase field on {len(mesh.tets):,} tets: J = {row.objective_J:.4g}, F = "
        f"{row.compliance_J:.4g}, {row.iteration} steps, KKT residual {row.kkt_residual:.2g}"
    )
    np.save(folder / "ours.npy", densest(voxel_means(result.phase_field)))
    return seconds


def our_problem(options):
    """The cantilever; its edge load is a traction on a strip one sixteenth of a voxel wide."""
    from topopt.problem import Box, BoxDomain, Load, Material, Problem, Support

    young, poisson = 1.0, 0.3
    mu = young / (2.0 * (1.0 + poisson))
    lame = 2.0 * mu * poisson / (1.0 - 2.0 * poisson)
    wall = Box((0.0, -1.0, -1.0), (0.0, CELLS[1] + 1.0, CELLS[2] + 1.0))
    width = 1.0 / 16.0
    edge = Box((CELLS[0], 0.0, 0.0), (CELLS[0], CELLS[1], width))
    return Problem(
        BoxDomain((0.0, 0.0, 0.0), tuple(float(n) for n in CELLS)),
        supports=(Support("wall", wall),),
        loads=(Load("edge", edge, (0.0, 0.0, -1.0 / (CELLS[1] * width))),),
        volume_fraction=VOLUME,
        gamma=options.gamma,
        eps=options.eps,
        material=Material(lame_lambda=lame, lame_mu=mu),
    )


def voxel_means(field, samples=4):
    """Mean of phi in every voxel (nx, ny, nz), by sampling."""
    from topopt.transfer import TetLocator

    axes = [(np.arange(n * samples) + 0.5) / samples for n in CELLS]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    nodes, weights = TetLocator(field.mesh).weights(points)
    values = np.einsum("ka,ka->k", weights, field.values[nodes])
    shape = [size for n in CELLS for size in (n, samples)]
    return values.reshape(shape).mean(axis=(1, 3, 5))


def densest(values):
    """The 30 % of the voxels with the largest values, as booleans."""
    kept = np.zeros(values.size, bool)
    kept[np.argsort(-values.ravel(), kind="stable")[: round(VOLUME * values.size)]] = True
    return kept.reshape(values.shape)


# --- theirs, run by their own interpreter ----------------------------------------------------


def pymoto_model(density, filtered):
    """(domain, network parts): compliance of pyMOTO's cantilever as a function of a density."""
    import pymoto as pym

    domain = pym.VoxelDomain(*CELLS)
    across = np.meshgrid(0, range(CELLS[1] + 1), range(CELLS[2] + 1))
    wall = domain.get_nodenumber(*across).ravel()
    edge = domain.get_nodenumber(CELLS[0], np.arange(CELLS[1] + 1), 0)
    force = np.zeros(3 * domain.nnodes)
    force[3 * edge + 2] = -1.0 / len(edge)
    held = (3 * wall[:, None] + np.arange(3)).ravel()
    values = pym.DensityFilter(domain, radius=RADIUS)(density) if filtered else density
    stiffness = pym.MathExpression(f"{VOID} + (1 - {VOID})*inp0^{POWER}")(values)
    matrix = pym.AssembleStiffness(domain, bc=held, e_modulus=1.0, poisson_ratio=0.3)(stiffness)
    displacement = pym.LinSolve(hermitian=True, solver=multigrid(domain))(matrix, force)
    return domain, values, pym.EinSum("i,i->")(displacement, force)


def multigrid(domain):
    """pyMOTO's geometric multigrid down to 4 voxels across, in conjugate gradients."""
    import pymoto as pym

    levels = [pym.solvers.GeometricMultigrid(domain)]
    while levels[-1].sub_domain.nely % 2 == 0 and levels[-1].sub_domain.nely >= 8:
        levels.append(pym.solvers.GeometricMultigrid(levels[-1].sub_domain))
        levels[-2].inner_level = levels[-1]
    return pym.solvers.CG(preconditioner=levels[0], tol=1e-6, maxit=2000)


def in_their_order(design):
    """Values (nx, ny, nz) as pyMOTO numbers its voxels."""
    return design.transpose(2, 1, 0).ravel().astype(float)


def simp(folder):
    """Optimise the densities and keep the voxels: simp.npy."""
    import contextlib
    import io

    import pymoto as pym

    density = pym.Signal("x", state=np.full(int(np.prod(CELLS)), VOLUME))
    with pym.Network() as network:
        _, filtered, compliance = pymoto_model(density, filtered=True)
        objective = pym.Scaling(scaling=100.0)(compliance)
    with contextlib.redirect_stdout(io.StringIO()):
        pym.minimize_oc(density, objective, function=network, maxit=STEPS, tolx=0.0, tolf=0.0)
    values = np.asarray(filtered.state).reshape(CELLS[::-1]).transpose(2, 1, 0)
    np.save(folder / "simp.npy", densest(values))


def judge(folder):
    """Solve both 0/1 designs: compliance.json with their voxels and compliances."""
    import pymoto as pym

    found = {}
    for name in ("simp", "ours"):
        design = np.load(folder / f"{name}.npy")
        density = pym.Signal("x", state=in_their_order(design))
        with pym.Network():
            compliance = pymoto_model(density, filtered=False)[2]
        found[name] = (int(design.sum()), float(compliance.state))
    (folder / "compliance.json").write_text(json.dumps(found))


ROWS = {"simp": simp, "judge": judge}


if __name__ == "__main__":
    main()
