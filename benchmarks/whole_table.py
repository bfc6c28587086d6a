"""The whole table, 1.12 million tets, optimised on nested meshes: seconds and memory.

    python benchmarks/whole_table.py [--levels 2] [--tolerance 0.02] [--threads N]

The quarter of the case `table`, preset `certified`, is meshed (or taken from the cache) and
mirrored at x = 0 and y = 0, on every level. The feet of the whole table slide, which would leave
it free to move in its plane; so the boundary's nodes on x = 0 and y = 0 are held across them, where
symmetry keeps them anyway. Printed are the figures of each level, and the peak memory.
"""

import argparse
import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cases.load import load_case  # noqa: E402
from cases.problem import to_problem  # noqa: E402
from meshes.structured import box_patches  # noqa: E402
from meshes.tet_mesh import TetMesh, boundary_facets  # noqa: E402
from topopt.domain import attach_sets, estimated_edge_length, mesh_domain  # noqa: E402
from topopt.levels import Levels, coarse_settings  # noqa: E402
from topopt.optimize import OptimizationSettings, optimize  # noqa: E402
from topopt.problem import Box, BoxDomain, Support  # noqa: E402


def main():
    """Mesh, mirror, optimise level by level, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--levels", type=int, default=2)
    parser.add_argument("--tolerance", type=float, default=0.02)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    if options.threads:
        numba.set_num_threads(options.threads)
    case = load_case(ROOT / "cases" / "table.yaml", "certified")
    quarter, tets = to_problem(case), case.case.mesh.tets
    problem = whole_problem(quarter)
    meshes = whole_meshes(quarter, problem, tets, options.levels)
    warm_up(meshes[0], problem)
    levels = Levels(problem, meshes[0], len(meshes))
    final = OptimizationSettings(steps=options.steps, tolerance=options.tolerance, stagnation=0.0)
    print("level      tets   steps            J  KKT residual  seconds", flush=True)
    began, start, taken = time.perf_counter(), levels.first(), 0
    for k, mesh in enumerate(meshes):
        last = k == len(meshes) - 1
        result = optimize(mesh, problem, final if last else coarse_settings(final), start)
        row = result.history[-1]
        print(
            f"{k + 1:5d} {len(mesh.tets):9,d} {row.iteration - taken:7d} {row.objective_J:12.6g} "
            f"{row.kkt_residual:13.3g} {time.perf_counter() - began:8.1f}",
            flush=True,
        )
        taken = row.iteration
        if not last:
            start = levels.next(mesh, result.loop, meshes[k + 1])
    print(f"a quarter of J: {result.history[-1].objective_J / 4:.6g}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"{time.perf_counter() - began:.1f} s, peak memory {peak:.2f} GiB")


def warm_up(mesh, problem):
    """Compile or load the kernels."""
    optimize(mesh, problem, OptimizationSettings(steps=1, check_resolution=False))


def whole_meshes(quarter, problem, tets, levels):
    """The whole's meshes, coarse to fine, each made of four mirrored quarters."""
    sizes = [{"edge_length": estimated_edge_length(quarter, tets) * 2.0**k}
             for k in range(levels - 1, 0, -1)]  # fmt: skip
    meshes = (mesh_domain(quarter, log=print, **size) for size in [*sizes, {"tets": tets}])
    return [attach_sets(mirrored(mesh), problem) for mesh in meshes]


def mirrored(mesh):
    """A mesh of a box with corners at x = 0 and y = 0, and its images at both planes."""
    points, tets = mesh.points, mesh.tets
    for axis in (0, 1):
        on_plane = points[:, axis] == 0.0
        image = np.where(on_plane, np.arange(len(points)), len(points) + np.cumsum(~on_plane) - 1)
        flipped = points[~on_plane] * np.where(np.arange(3) == axis, -1.0, 1.0)
        points = np.concatenate([points, flipped])
        tets = np.concatenate([tets, image[tets][:, [0, 2, 1, 3]]])
    facets = boundary_facets(tets)
    lower, upper = points.min(axis=0), points.max(axis=0)
    corners, patch = points[facets], np.empty(len(facets), int)
    for k in range(6):  # x-, x+, y-, ...
        side = (upper if k % 2 else lower)[k // 2]
        patch[np.all(corners[:, :, k // 2] == side, axis=1)] = k
    return TetMesh(points, tets, facets, patch, box_patches(lower, upper))


def whole_problem(quarter):
    """The problem of the whole table, without symmetry planes."""
    lower, upper = np.array(quarter.domain.lower), np.array(quarter.domain.upper)
    lower[:2] = -upper[:2]
    held = [mirrored_supports(support) for support in quarter.supports]
    pins = [
        Support(f"middle_{'xy'[axis]}", open_box(axis, 0.0, 0.0), fixed=(axis,)) for axis in (0, 1)
    ]
    loads = [replace(load, region=symmetric(load.region)) for load in quarter.loads]
    return replace(
        quarter,
        domain=BoxDomain(tuple(lower), tuple(upper)),
        supports=(*(one for four in held for one in four), *pins),
        loads=tuple(loads),
        symmetry=(),
        load_cases=(),
    )


def mirrored_supports(support):
    """A box support and its images at x = 0 and y = 0."""
    found = []
    for x in (1, -1):
        for y in (1, -1):
            ends = np.sort(
                np.array([support.region.lower, support.region.upper]) * (x, y, 1), axis=0
            )
            region = Box(tuple(ends[0]), tuple(ends[1]))
            found.append(replace(support, name=f"{support.name}{len(found)}", region=region))
    return found


def symmetric(box):
    """The box over its own image: one that begins at x = 0 and y = 0."""
    lower, upper = np.array(box.lower), np.array(box.upper)
    lower[:2] = -upper[:2]
    return Box(tuple(lower), tuple(upper))


def open_box(axis, low, high):
    """All points whose coordinate `axis` lies in [low, high]."""
    lower, upper = np.full(3, -np.inf), np.full(3, np.inf)
    lower[axis], upper[axis] = low, high
    return Box(tuple(lower), tuple(upper))


if __name__ == "__main__":
    main()
