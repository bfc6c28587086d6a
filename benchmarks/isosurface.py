"""Accuracy and shape of extracted surfaces, as tables.

    python -m benchmarks.isosurface [--fields COARSE FINE]

The first table takes sine-profile fields of a ball and of an inclined round beam, on jittered BCC
meshes of three sizes: distance of the vertices and of the triangles' centroids from the exact
surface (root mean square, in units of the coarsest mesh's edge), error of the volume, and the
orders. "newton" moves the vertices of quadratic crossings by Newton's method. The second compares
the ways to triangles without slivers, on the middle mesh. With --fields, the folders of two runs of
one case at edge lengths h and h/2, same gamma and eps: distances from the surface of the fine run,
in h, of the coarse run's, and of the fine field sampled at the coarse mesh's nodes (so that they
differ by the extraction alone). `benchmarks.isosurface_runs` makes many such pairs.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

ROOT = Path(__file__).resolve().parents[1]
if __package__ in (None, ""):
    sys.path[0] = str(ROOT)

import isosurface as iso  # noqa: E402
from isosurface.crossing import CROSSINGS  # noqa: E402
from meshes import PhaseField, TetMesh  # noqa: E402
from meshes.closest_point import ClosestPoint, two_sided_distance  # noqa: E402
from meshes.io import load_tet_mesh  # noqa: E402
from meshes.quality import signed_volume, triangle_angles  # noqa: E402
from meshes.self_intersection import self_intersecting_faces  # noqa: E402
from meshes.structured import bcc_box  # noqa: E402
from meshes.tet_mesh import tet_volumes  # noqa: E402

CELLS = (12, 20, 34)
WIDTH = 0.35  # of the interface
METHODS = (*CROSSINGS, "newton")
AXIS = np.array([0.9, 0.36, 0.246])


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fields", nargs=2, metavar=("COARSE", "FINE"))
    options = parser.parse_args()
    for shape in SHAPES:
        for method in METHODS:
            print_orders(shape, method)
    for shape in SHAPES:
        print_shapes(shape)
    if options.fields:
        print_fields(*(design_of(Path(folder)) for folder in options.fields))


def ball(points):
    """Distance (n,) inside a ball."""
    return 0.6 - np.linalg.norm(points - [0.03, 0.02, 0.01], axis=1)


def beam(points):
    """Distance (n,) inside an inclined round beam from x = -1 to x = 1."""
    axis = AXIS / np.linalg.norm(AXIS)
    across = points - np.outer(points @ axis, axis)
    return 0.3 - np.linalg.norm(across, axis=1)


SHAPES = {
    "ball": (ball, 4.0 / 3.0 * np.pi * 0.6**3),
    "beam": (beam, 2.0 * np.pi * 0.3**2 * np.linalg.norm(AXIS) / AXIS[0]),
}


def sine_field(distance, cells):
    """The field of a shape on a jittered BCC mesh of [-1, 1]^3."""
    mesh = bcc_box((-1.0,) * 3, (1.0,) * 3, (cells,) * 3)
    points = np.array(mesh.points)
    inner = (np.abs(points) < 1.0 - 1e-9).all(axis=1)
    rng = np.random.default_rng(cells)
    points[inner] += rng.uniform(-0.15, 0.15, (np.count_nonzero(inner), 3)) * 2.0 / cells
    mesh = TetMesh(points, mesh.tets, mesh.facets, mesh.facet_patch, mesh.patches)
    angle = np.clip(np.pi * distance(points) / WIDTH, -0.5 * np.pi, 0.5 * np.pi)
    return PhaseField(mesh, 0.5 * (1.0 + np.sin(angle)))


def errors(surface, distance, volume):
    """Distances (rms) of the smooth part's vertices and centroids, relative error of the volume."""
    names = [patch.name for patch in surface.labels]
    faces = surface.faces[surface.face_labels == names.index("isosurface")]
    places = surface.points[np.unique(faces)], surface.points[faces].mean(axis=1)
    rms = [np.sqrt(np.mean(distance(place) ** 2)) for place in places]
    return [*rms, abs(signed_volume(surface) / volume - 1.0)]


def extracted(field, method):
    """The surface by one of METHODS."""
    return iso.extract_surface(field, crossing=method)


def print_orders(shape, method):
    """One line: errors on three meshes, and their fitted orders."""
    distance, volume = SHAPES[shape]
    rows = []
    for cells in CELLS:
        started = time.perf_counter()
        surface = extracted(sine_field(distance, cells), method)
        spent = time.perf_counter() - started
        rows.append(errors(surface, distance, volume))
    orders = -np.polyfit(np.log(CELLS), np.log(rows), 1)[0]
    unit = 2.0 / CELLS[0]
    parts = [f"{v / unit:.2e} {c / unit:.2e} {q:.2e}" for v, c, q in rows]
    orders = " ".join(f"{order:.1f}" for order in orders)
    print(f"{shape:5} {method:10} {' | '.join(parts)} | orders {orders} | {spent:.2f} s")


def angle_figures(surface):
    """Worst angle [degrees] and the share of triangles with one below 20 degrees."""
    smallest = np.degrees(triangle_angles(surface.points, surface.faces).min(axis=1))
    return smallest.min(), float(np.mean(smallest < 20.0))


def print_shapes(shape):
    """Lines: slivers with and without spread crossings, repair, smoothing, and second repair."""
    distance, volume = SHAPES[shape]
    field = sine_field(distance, CELLS[1])
    for spread in (0.0, 0.15, 0.3, 0.4):
        raw = iso.extract_surface(field, spread=spread)
        repaired, _ = iso.repair_slivers(raw)
        smooth, _ = iso.smooth(repaired)
        again, _ = iso.repair_slivers(smooth)
        stages = {"raw": raw, "repaired": repaired, "smoothed": smooth, "repaired again": again}
        for name, surface in stages.items():
            worst, share = angle_figures(surface)
            meeting = int(self_intersecting_faces(surface.points, surface.faces).sum())
            print(
                f"{shape:5} spread {spread:.2f} {name:14} {len(surface.faces):6} faces, worst "
                f"{worst:5.1f}, below 20: {100 * share:5.2f} %, meeting {meeting}, vertices' "
                f"distance {errors(surface, distance, volume)[0]:.2e}"
            )


# --- fields of real runs ---------------------------------------------------------------------


def design_of(folder):
    """The design that a run left in its folder."""
    with np.load(folder / "phase_field.npz") as arrays:
        return PhaseField(load_tet_mesh(folder / "mesh.npz"), arrays["values"])


def sampled(fine, mesh):
    """The fine field at another mesh's nodes, its profile's angle linear on tetrahedra."""
    angle = np.arcsin(np.clip(2.0 * fine.values - 1.0, -1.0, 1.0))
    corners = fine.mesh.points[fine.mesh.tets]
    _, near = cKDTree(corners.mean(axis=1)).query(mesh.points, k=40)
    values, best = np.zeros(len(mesh.points)), np.full(len(mesh.points), -np.inf)
    for tets in near.T:
        place = corners[tets]
        edges = (place[:, 1:] - place[:, :1]).transpose(0, 2, 1)
        tail = np.linalg.solve(edges, (mesh.points - place[:, 0])[:, :, None])[:, :, 0]
        weights = np.concatenate([1.0 - tail.sum(axis=1, keepdims=True), tail], axis=1)
        inside = weights.min(axis=1)
        weights = np.clip(weights, 0.0, 1.0)
        found = (weights * angle[fine.mesh.tets[tets]]).sum(axis=1) / weights.sum(axis=1)
        values, best = np.where(inside > best, found, values), np.maximum(inside, best)
    return PhaseField(mesh, 0.5 * (1.0 + np.sin(values)))


def print_fields(coarse, fine):
    """Lines: distances of surfaces of the coarse mesh from the fine run's."""
    symmetry = coarse.mesh.symmetry
    mean = tet_volumes(coarse.mesh.points, coarse.mesh.tets).mean()
    size = (6.0 * np.sqrt(2.0) * mean) ** (1.0 / 3.0)
    field = iso.drop_islands(fine)[0]
    reference = iso.mirror(iso.extract_surface(field), symmetry)
    nearest = ClosestPoint(reference.points, reference.faces)
    for name, whole in (("sampled", sampled(fine, coarse.mesh)), ("own run", coarse)):
        field = iso.drop_islands(whole)[0]
        for crossing in CROSSINGS:
            raw = iso.extract_surface(field, crossing=crossing)
            smooth, _ = iso.smooth(iso.repair_slivers(raw, symmetry)[0], None, symmetry)
            print_distances(f"{name} {crossing}", raw, smooth, symmetry, nearest, reference, size)
        for length in (0.5, 1.0, 1.5):
            blurred = iso.diffused(field, length * size)
            level = iso.surface_level(
                blurred,
                iso.modelled_volume(iso.extract_surface(field), symmetry),
                lambda at, f=blurred: iso.modelled_volume(iso.extract_surface(f, at), symmetry),
            )
            raw = iso.extract_surface(blurred, level)
            repaired = iso.repair_slivers(raw, symmetry)[0]
            label = f"{name} diffusion over {length} h"
            print_distances(label, raw, repaired, symmetry, nearest, reference, size)


def print_distances(label, raw, smooth, symmetry, nearest, reference, size):
    """One line: vertices' and two-sided distances of the raw and of the final surface, in h."""
    parts = []
    for surface in (raw, smooth):
        whole = iso.mirror(surface, symmetry)
        vertices = nearest.query(whole.points)[2]
        rms, largest = two_sided_distance(whole, reference, 50_000)
        parts.append(
            f"vertices {np.sqrt(np.mean(vertices**2)) / size:.4f}, two-sided {rms / size:.4f} "
            f"(max {largest / size:.2f})"
        )
    print(f"{label:26} raw: {parts[0]}; final: {parts[1]}", flush=True)


if __name__ == "__main__":
    main()
