"""Vertices that an error bound takes, ours beside what peers need for the same measured error.

Part of `benchmarks/remesh.py --max-error`. A peer decimates by its own estimate of the error, or to
a number of faces; that is bisected for the fewest vertices whose measured two-sided distance
(100,000 samples a side and all vertices, the same for all) is within the bound. Peers run in a
process of their own, from a virtual environment of theirs.
"""

import json
import subprocess
import tempfile
import time
import venv
from pathlib import Path

import numpy as np

from meshes import TriMesh
from meshes.closest_point import two_sided_distance
from meshes.features import find_features
from meshes.io import read_surface
from remesh import RemeshSettings, remesh

CASES = (
    ("spot", 0.003, None), ("spot", 0.001, None), ("spot", 0.001, 30.0),
    ("fandisk", 0.003, None), ("fandisk", 0.001, None), ("fandisk", 0.001, 10.0),
    ("bunny_holes", 0.003, None), ("bunny_holes", 0.001, None),
    ("beams_mt", 0.003, None), ("beams_mt", 0.001, None),
)  # fmt: skip
PEERS = {
    "meshlib": "meshlib",
    "pymeshlab": "pymeshlab",
    "fast_simplification": "fast-simplification",
}
STEPS = 9
PEER_CODE = """
import json, sys, time
import numpy as np

kind, path = sys.argv[1:]
data = np.load(path)
points, faces = data["points"], data["faces"].astype(np.int32)


def meshlib(error):
    import meshlib.mrmeshnumpy as mn
    import meshlib.mrmeshpy as mm
    mesh = mn.meshFromFacesVerts(faces, points)
    settings = mm.DecimateSettings()
    settings.maxError, settings.packMesh = float(error), True
    start = time.process_time()
    mm.decimateMesh(mesh, settings)
    seconds = time.process_time() - start
    return mn.getNumpyVerts(mesh), mn.getNumpyFaces(mesh.topology), seconds


def pymeshlab(count):
    import pymeshlab
    work = pymeshlab.MeshSet()
    work.add_mesh(pymeshlab.Mesh(points, faces))
    start = time.process_time()
    work.meshing_decimation_quadric_edge_collapse(
        targetfacenum=int(count), preservenormal=True, preservetopology=True, preserveboundary=True)
    seconds = time.process_time() - start
    mesh = work.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix(), seconds


def fast_simplification(count):
    import fast_simplification
    start = time.process_time()
    found = fast_simplification.simplify(points, faces, target_count=int(count))
    return *found, time.process_time() - start


for line in sys.stdin:
    vertices, triangles, seconds = globals()[kind](float(line))
    np.savez(path + ".out.npz", points=vertices, faces=triangles)
    print(json.dumps(seconds), flush=True)
"""


def make_peer_environment(folder):
    """A virtual environment with the peers that can be had; returns its interpreter."""
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
    for package in PEERS.values():
        subprocess.run([python, "-m", "pip", "install", "-q", package], check=False)
    return python


def ours(mesh, error, angle):
    """Our result, and the CPU seconds of the second run."""
    settings = RemeshSettings(max_error=error, max_normal_angle=angle)
    for _ in range(2):
        start = time.process_time()
        result = remesh(find_features(mesh), None, settings)
        seconds = time.process_time() - start
    return result, seconds


def peers_best(python, kind, mesh, error):
    """Fewest vertices of a peer within the error: (vertices, measured error, CPU s), or None."""
    best = None
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "in.npz")
        np.savez(path, points=mesh.points, faces=mesh.faces)
        by_error = kind == "meshlib"
        low, high = (0.1 * error, 4.0 * error) if by_error else (8.0, float(len(mesh.faces)))
        with subprocess.Popen(
            [python, "-c", PEER_CODE, kind, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True, cwd=folder,
        ) as peer:  # fmt: skip
            for _ in range(STEPS):
                middle = (low * high) ** 0.5
                try:
                    print(middle, file=peer.stdin, flush=True)
                except BrokenPipeError:
                    return None
                answer = peer.stdout.readline()
                if not answer:
                    return None
                found = np.load(path + ".out.npz")
                result = TriMesh(found["points"], found["faces"])
                measured = two_sided_distance(mesh, result)[1]
                within = measured <= error
                used = len(np.unique(result.faces))
                if within and (best is None or used < best[0]):
                    best = used, measured, json.loads(answer)
                low, high = (middle, high) if within == by_error else (low, middle)
            peer.stdin.close()
    return best


def print_bounds(names, data, folder):
    """Print the table; folder: of the peers' environment, None for ours alone."""
    python = None if folder is None else make_peer_environment(folder.resolve())
    print("input        bound  normals   who                  vertices  of bound   ratio  CPU s  "
          "crossing inverted")  # fmt: skip
    for name, share, angle in CASES:
        if names and name not in names:
            continue
        plain = read_surface(data / f"{name}.ply")
        mesh, error = TriMesh(plain.points, plain.faces), share * plain.diagonal
        result, seconds = ours(mesh, error, angle)
        measured = two_sided_distance(mesh, result.mesh)[1]
        found, held = result.statistics, "-" if angle is None else f"{angle:g}"
        line = f"{name:12s} {share:5g} {held:>7s}   "
        print(f"{line}{'ours':20s} {found.vertices:8d} {measured / error:9.3f}"
              f" {'-':>7s} {seconds:6.2f}"
              f" {found.self_intersecting_faces:8d} {found.inverted_faces:8d}"
              f"   proved {found.proved_distance / error:.4f},"
              f" {found.proved_normal_angle:.1f} degrees", flush=True)  # fmt: skip
        for kind in PEERS if python is not None and angle is None else ():
            best = peers_best(python, kind, mesh, error)
            if best is None:
                print(f"{line}{kind:20s}  not to be had, or never within the bound", flush=True)
                continue
            print(f"{line}{kind:20s} {best[0]:8d} {best[1] / error:9.3f}"
                  f" {found.vertices / best[0]:7.2f} {best[2]:6.2f}", flush=True)  # fmt: skip
