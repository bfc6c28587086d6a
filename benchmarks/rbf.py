"""Speed, memory and accuracy of rbf/, beside its peers, as one table.

    python benchmarks/rbf.py [--large] [--threads N] [--peers DIR]

--large adds the fit of a million vertices (about a minute and 2 GiB). --peers DIR makes a virtual
environment in DIR with treverhines-rbf (which is imported as `rbf` too) and runs it beside ours.
Each row is measured in a process of its own, after a small warm-up that compiles the kernels;
memory is the growth of the peak over that warm-up.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[0] = str(ROOT)  # this file is called rbf.py as well

DATA = ROOT.parent / "shared" / "data" / "beams_mt.ply"
PEER = "treverhines-rbf"


def main():
    """Run the rows one by one and print them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--large", action="store_true", help="with a million vertices")
    parser.add_argument("--threads", type=int, help="of numba; all cores if not given")
    parser.add_argument("--peers", type=Path, help="folder of a virtual environment for peers")
    parser.add_argument("--row", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.row:
        name, *arguments = options.row.split(":")
        print(json.dumps(ROWS[name](*arguments)))
        return
    environment = dict(os.environ, OPENBLAS_NUM_THREADS="1")
    if options.threads:
        environment["NUMBA_NUM_THREADS"] = str(options.threads)
    rows = ["beams", *(f"sphere:{n}" for n in (10_000, 42_000, 170_000))]
    rows += ["sphere:1000000"] if options.large else []
    rows += ["surface_ours", "surface_twin", "surface_scipy"]
    rows += ["values_local", "values_levels", "values_scipy"]
    commands = [(row, [sys.executable, __file__, "--row", row]) for row in rows]
    if options.peers:
        python = make_peer_environment(options.peers.resolve())
        for kind in ("surface", "values"):
            commands.append((f"{kind}_peer", [python, "-c", PEER_CODE, str(ROOT), kind]))
    for row, command in commands:
        # peers must not find our packages in the working directory
        folder = options.peers if row.endswith("peer") else ROOT
        run = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True)
        if run.returncode:
            print(f"{row:16} failed: {run.stderr.strip().splitlines()[-1]}")
            continue
        print_row(row, json.loads(run.stdout.splitlines()[-1]))


def print_row(row, result):
    """One line: the row's name, then its figures."""
    figures = "  ".join(f"{key} {format_figure(value)}" for key, value in result.items())
    print(f"{row:16} {figures}", flush=True)


def format_figure(value):
    """Four digits of a number."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def make_peer_environment(folder):
    """A virtual environment with the peer that shares our name; returns its interpreter."""
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    subprocess.run([python, "-m", "pip", "install", "-q", PEER], check=True)
    return str(python)


# --- shared problems -------------------------------------------------------------------------


def displaced_sphere(n):
    """n points and normals of the surface r = 1 + 0.1 sin(4 x) cos(3 y) z, evenly spread."""
    import numpy as np

    k = np.arange(n) + 0.5
    height, angle = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - height**2)
    unit = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)

    def radius(p):
        u = p / np.linalg.norm(p, axis=1)[:, None]
        return 1 + 0.1 * np.sin(4 * u[:, 0]) * np.cos(3 * u[:, 1]) * u[:, 2]

    points = unit * radius(unit)[:, None]
    level = lambda p: np.linalg.norm(p, axis=1) - radius(p)  # noqa: E731
    step = 1e-5 * np.eye(3)
    normals = np.stack([level(points + e) - level(points - e) for e in step], axis=1)
    return points, normals / np.linalg.norm(normals, axis=1)[:, None]


def torus_problem(queries=20_000):
    """Evenly spread torus vertices with normals; points near it with their exact distance."""
    import numpy as np

    u, v = np.meshgrid(np.arange(220) / 220, np.arange(88) / 88, indexing="ij")
    points, normals = torus_at(u.ravel(), v.ravel(), 0.0)
    rng = np.random.default_rng(0)
    u, v = rng.random((2, queries))
    return points, normals, torus_at(u, v, 0.0)[0], np.zeros(queries)


def torus_at(u, v, offset):
    """Points and normals of a torus (radii 1 and 0.4) with parameters in [0, 1)."""
    import numpy as np

    a, b = 2 * np.pi * u, 2 * np.pi * v
    normal = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=1)
    centre = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    return centre + (0.4 + offset) * normal, normal


def values_problem(n=20_000, queries=20_000):
    """Random points of the unit cube with values of a smooth function; queries with theirs."""
    import numpy as np

    rng = np.random.default_rng(0)
    points, at = rng.random((n, 3)), rng.random((queries, 3))

    def smooth(p):
        return np.sin(5 * p[:, 0]) * np.cos(4 * p[:, 1]) + np.exp(-p[:, 2]) * p[:, 0]

    return points, smooth(points), at, smooth(at)


def triples(points, normals, offset):
    """The thesis's data for a method that knows values only."""
    import numpy as np

    moved = [points, points + offset * normals, points - offset * normals]
    return np.vstack(moved), np.repeat([0.0, offset, -offset], len(points))


# --- our rows --------------------------------------------------------------------------------


def warm_up():
    """Compile what the rows use; returns the peak memory after it, in MiB."""
    import rbf

    points, normals = displaced_sphere(3000)
    surface = rbf.fit_hermite(points, normals)
    surface.value_and_gradient(points)
    surface.project(points)
    rbf.fit_levels(points, points[:, 0]).value(points)
    rbf.fit_local(points, points[:, 0]).value(points)
    return peak_mib()


def peak_mib():
    """Peak memory of this process in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def timed(call, repeats=1):
    """(result, wall seconds, CPU seconds) of the fastest of some calls."""
    best = None
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        result = call()
        spent = time.perf_counter() - wall, time.process_time() - cpu
        best = spent if best is None or spent[0] < best[0] else best
    return result, *best


def fit_row(fit, count, repeats):
    """Figures of a fit."""
    before = warm_up()
    surface, wall, cpu = timed(fit, repeats)
    return surface, {
        "vertices": count,
        "fit_s": wall,
        "fit_cpu_s": cpu,
        "us_per_vertex": 1e6 * wall / count,
        "MiB": peak_mib() - before,
        "iterations": surface.iterations,
        "residual": surface.residual,
        "bad_pivots": surface.report.bad_pivots,
    }


def beams():
    """Fit and evaluation on the jagged marching-tetrahedra surface (long edges split, welded)."""
    import meshio
    import numpy as np

    import rbf
    from meshes import TriMesh

    data = meshio.read(DATA)
    mesh = TriMesh(data.points, data.cells_dict["triangle"])
    surface, figures = fit_row(lambda: rbf.fit_surface(mesh), len(mesh.points), 3)
    queries = mesh.points[mesh.faces].mean(axis=1)
    queries = np.concatenate([queries, mesh.points[mesh.faces[:, :2]].mean(axis=1)])[:100_000]
    _, wall, _ = timed(lambda: surface.value_and_gradient(queries), 20)
    figures["eval_Mpts_per_s"] = 1e-6 * len(queries) / wall
    limit = kernel_limit(surface, queries)
    figures |= {"limit_Mpts_per_s": 1e-6 * len(queries) / limit, "share_of_limit": limit / wall}
    (points, _, steps), wall, _ = timed(lambda: surface.project_with_steps(queries), 3)
    figures["project_Mpts_per_s"] = 1e-6 * len(queries) / wall
    figures["steps"] = float(steps.mean())
    figures["unprojected"] = int(np.isnan(points[:, 0]).sum())
    return figures


def kernel_limit(surface, queries):
    """Seconds the innermost loop alone takes for the pairs within the support, on all threads."""
    import numba
    import numpy as np
    from scipy.spatial import cKDTree

    from rbf.sum_kernels import line_start, value_and_gradient

    @numba.njit
    def repeat(form, times, centres):
        total, begin = 0.0, line_start(centres)
        for k in range(times):
            total += value_and_gradient(form, centres, begin, begin + 160, 1e-4 * k, 0.5, 0.5)[0]
        return total

    centres = np.random.default_rng(0).random((7, 184))
    repeat(surface._form, 1, centres)
    _, wall, _ = timed(lambda: repeat(surface._form, 100_000, centres), 3)
    pairs = cKDTree(queries).count_neighbors(cKDTree(surface.points), surface.support_radius)
    return pairs * wall / (100_000 * 160) / numba.get_num_threads()


def sphere(count):
    """Fit of an evenly spread surface of any size."""
    import rbf

    points, normals = displaced_sphere(int(count))
    repeats = 3 if len(points) < 100_000 else 1
    return fit_row(lambda: rbf.fit_hermite(points, normals), len(points), repeats)[1]


def accuracy_row(evaluate, queries, exact):
    """Points per second and error of an evaluation."""
    import numpy as np

    values, wall, _ = timed(lambda: evaluate(queries), 3)
    return {"kpts_per_s": 1e-3 * len(queries) / wall, "rms": float(np.std(values - exact))}


def surface_ours():
    """Value on a torus between its vertices (exactly 0), our Hermite form."""
    import rbf

    warm_up()
    points, normals, queries, exact = torus_problem(100_000)
    return accuracy_row(rbf.fit_hermite(points, normals).value, queries, exact)


def surface_twin():
    """The same coefficients, summed over cKDTree neighbours in a plain compiled loop."""
    import numba
    import numpy as np
    from scipy.spatial import cKDTree

    import rbf

    points, normals, queries, exact = torus_problem(100_000)
    surface = rbf.fit_hermite(points, normals)
    centres = np.ascontiguousarray(surface._centres[:, : len(surface.points)].T)
    tree, radius = cKDTree(centres[:, :3]), surface.support_radius

    @numba.njit(parallel=True, error_model="numpy")
    def add_up(x, starts, neighbours, centres, out):
        for q in numba.prange(len(x)):
            value = gx = gy = gz = 0.0
            for k in range(starts[q], starts[q + 1]):
                c = centres[neighbours[k]]
                dx, dy, dz = x[q, 0] - c[0], x[q, 1] - c[1], x[q, 2] - c[2]
                r = np.sqrt(dx * dx + dy * dy + dz * dz)
                t = 1.0 - r
                f1, f2 = -20.0 * t**3, 60.0 * t * t / max(r, 1e-30)
                nd = c[4] * dx + c[5] * dy + c[6] * dz
                value += c[3] * t**4 * (4.0 * r + 1.0) + f1 * nd
                w = c[3] * f1 + f2 * nd
                gx += w * dx + f1 * c[4]
                gy += w * dy + f1 * c[5]
                gz += w * dz + f1 * c[6]
            out[q, 0], out[q, 1], out[q, 2], out[q, 3] = value, gx, gy, gz

    def evaluate(at):
        x = (at - surface._origin) / radius
        lists = tree.query_ball_point(x, 1.0, workers=-1)
        starts = np.concatenate([[0], np.cumsum([len(found) for found in lists])])
        neighbours = np.concatenate([np.asarray(found, np.int64) for found in lists])
        out = np.empty((len(x), 4))
        add_up(x, starts, neighbours, centres, out)
        return radius * out[:, 0]

    evaluate(queries[:100])
    return accuracy_row(evaluate, queries, exact)


def surface_scipy():
    """scipy's local interpolator of the offset triples."""
    from scipy.interpolate import RBFInterpolator

    from rbf.spacing import point_spacing

    points, normals, queries, exact = torus_problem()
    data, values = triples(points, normals, 0.1 * point_spacing(points))
    peer = RBFInterpolator(data, values, neighbors=50)
    return accuracy_row(peer, queries[:4000], exact[:4000])


def values_local():
    """Scattered values of a smooth function in a cube, blended from local interpolants."""
    import rbf

    warm_up()
    points, values, queries, exact = values_problem(queries=200_000)
    interpolant, wall, _ = timed(lambda: rbf.fit_local(points, values))
    return {"fit_s": wall} | accuracy_row(interpolant.value, queries, exact)


def values_levels():
    """The same on several levels."""
    import rbf

    warm_up()
    points, values, queries, exact = values_problem(queries=200_000)

    def fit():
        return rbf.fit_levels(points, values, 4, 6.0, kernel="wendland_c4", tolerance=1e-6)

    interpolant, wall, _ = timed(fit)
    return {"fit_s": wall} | accuracy_row(interpolant.value, queries, exact)


def values_scipy():
    """scipy's local interpolator of the same values."""
    from scipy.interpolate import RBFInterpolator

    points, values, queries, exact = values_problem()
    peer = RBFInterpolator(points, values, neighbors=50)
    return accuracy_row(peer, queries[:4000], exact[:4000])


ROWS = {
    "beams": beams,
    "sphere": sphere,
    "surface_ours": surface_ours,
    "surface_twin": surface_twin,
    "surface_scipy": surface_scipy,
    "values_local": values_local,
    "values_levels": values_levels,
    "values_scipy": values_scipy,
}

PEER_CODE = """
import importlib.util, json, sys
from rbf.interpolate import KNearestRBFInterpolant
spec = importlib.util.spec_from_file_location("bench", sys.argv[1] + "/benchmarks/rbf.py")
bench = importlib.util.module_from_spec(spec)
place = list(sys.path)
spec.loader.exec_module(bench)
sys.path[:] = place
if sys.argv[2] == "surface":
    points, normals, queries, exact = bench.torus_problem()
    data, values = bench.triples(points, normals, 0.1 * 0.0283)
else:
    data, values, queries, exact = bench.values_problem()
peer = KNearestRBFInterpolant(data, values, k=50, phi="phs3", order=1)
print(json.dumps(bench.accuracy_row(peer, queries[:4000], exact[:4000])))
"""

if __name__ == "__main__":
    main()
