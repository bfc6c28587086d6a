"""Tetrahedra from pytetwild, made exact: planes snapped, patches named, everything checked.

pytetwild keeps the surface to within an envelope only. Each boundary facet that lies in the
envelope of a plane is put on it, so that planes, and the volume of a box, are exact to rounding.
The result differs from run to run; where it fails the checks, it is made again.
"""

import io
import os
import subprocess
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from meshes.closest_point import ClosestPoint
from meshes.errors import InvalidCase, InvalidMesh, NotConverged
from meshes.patch import Patch
from meshes.quality import area_vectors, normalised, signed_volume
from meshes.tet_mesh import TetMesh, boundary_facets, tet_volumes
from meshes.topology import angle_between, edge_table, topology
from topopt.geometry import morton_order
from topopt.meshing_flat import connected_faces

EPSILON = 1e-3  # envelope, in units of the bounding box's diagonal
STOP_ENERGIES = (15.0, 10.0, 10.0)  # of one try after the other. pytetwild's own 10 makes it refine
# again in some runs, at random: counts of 300,000 tets then spread by 6 % (standard deviation)
# instead of 2 to 4 %, the worst dihedral angle is 19 to 25 degrees instead of 15 to 20, the mean of
# the tets' smallest ones is the same. But with 15 some runs end before the edges are short enough.
TOO_LONG = 1.5  # mean edge length that shows it, in units of the length asked for
FLAT_VOLUME = 1e-6  # of the mean tet's volume: less is none
ON_PLANE = 1e-9  # distance in the frame from planes that nodes were snapped to
EXACT_VOLUME = 1e-12  # relative error of a box's volume
CREASE_ANGLE = np.radians(40.0)  # curved patches end where faces turn by more
NARROWEST = 0.5  # width of flat parts that are snapped, in edge lengths
MORTON_BITS = 21
WORKER = Path(__file__).with_name("meshing_worker.py")


class OutOfTime(NotConverged):
    """Meshing took longer than allowed."""


def pytetwild_version():
    """The installed version of pytetwild; InvalidCase if there is none."""
    try:
        return version("pytetwild")
    except PackageNotFoundError:
        raise InvalidCase(
            "pytetwild is not installed; install it, or mesh the box with kind 'bcc'."
        ) from None


def tetrahedralize(points, faces, seconds=None, **options):
    """Run pytetwild in a process and a folder of its own (it leaves files where it runs).

    Parameters
    ----------
    points : (n, 3) float array
    faces : (f, 3) int array
    seconds : float, optional
        The process is ended after that time.
    options
        Of pytetwild.tetrahedralize.

    Returns
    -------
    points : (k, 3) float array
    tets : (m, 4) int32 array

    Raises
    ------
    NotConverged
        If the process fails; says how it ended.
    OutOfTime
        If it takes longer than `seconds`.
    """
    surface = io.BytesIO()
    np.savez(surface, vertices=points, faces=faces.astype(np.int32), **options)
    search_path = os.pathsep.join(os.path.abspath(path) for path in sys.path if path)
    try:
        with tempfile.TemporaryDirectory(prefix="phasemesh-") as folder:
            done = subprocess.run(
                [sys.executable, "-P", str(WORKER)],
                input=surface.getvalue(),
                capture_output=True,
                env={**os.environ, "PYTHONPATH": search_path},
                cwd=folder,
                timeout=seconds,
            )
    except subprocess.TimeoutExpired:
        raise OutOfTime("pytetwild was still meshing when its time was up") from None
    if done.returncode or not done.stdout:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
        how = f"signal {-done.returncode}" if done.returncode < 0 else f"code {done.returncode}"
        raise NotConverged(
            f"pytetwild ended with {how}{' and the words: ' + last[0] if last else ''}; try "
            f"another edge length, or repair the domain's surface."
        )
    with np.load(io.BytesIO(done.stdout)) as archive:
        return archive["points"], archive["tets"].astype(np.int32)


def mesh_frame(frame, edge_length, log, seconds=None, sizing=None):
    """Mesh the domain of a frame, in the frame.

    Parameters
    ----------
    frame : topopt.meshing_frame.Frame
    edge_length : float
        In units of the domain's longest side.
    log : callable taking a str
    seconds : float, optional
        Time that all tries may take together.
    sizing : (points, tets, edge lengths), optional
        A background mesh in the frame, with edge lengths at its points: `edge_length` then holds
        only where it does not reach.

    Returns
    -------
    TetMesh
        Nodes, tets and facets ordered along a Morton curve.

    Raises
    ------
    NotConverged
        If no mesh passed the checks.
    OutOfTime
        If the time was up before.
    """
    reasons, began, background, shortest = [], time.monotonic(), {}, edge_length
    if sizing is not None:
        background = dict(zip(("bg_vertices", "bg_tets", "bg_values"), sizing))
        shortest = float(sizing[2].min())
    for stop_energy in STOP_ENERGIES:
        left = None if seconds is None else max(seconds - (time.monotonic() - began), 1e-3)
        points, tets = tetrahedralize(
            frame.points,
            frame.faces,
            seconds=left,
            edge_length_abs=edge_length,
            epsilon=EPSILON,
            stop_energy=stop_energy,
            num_threads=1,
            vtk_ordering=True,
            **background,
        )
        try:
            mesh = finish(frame, shortest, points, tets)
            if sizing is None:
                _check_edges(mesh, edge_length)
            return mesh
        except InvalidMesh as error:
            reasons.append(str(error))
            log(f"pytetwild's mesh is not used, because {error}")
    raise NotConverged(
        f"pytetwild gave no valid mesh in {len(reasons)} tries (the last one: {reasons[-1]}); try "
        f"another edge length, below the thickness of the thinnest part."
    )


def finish(frame, edge_length, points, tets):
    """Turn pytetwild's output into a checked TetMesh; InvalidMesh says why it cannot be used.

    `edge_length` is the shortest aimed at: flat parts narrower than half of it are not snapped.
    """
    wide = [k for k, width in enumerate(frame.widths) if width >= NARROWEST * edge_length]
    planes = [frame.planes[k] for k in wide]
    envelope = 2.0 * EPSILON * float(np.linalg.norm(np.ptp(frame.points, axis=0)))
    points, tets, facets, plane_of = on_planes(points, tets, planes, envelope)
    if frame.exact and (plane_of < 0).any():
        raise InvalidMesh(f"{(plane_of < 0).sum()} of its boundary facets lie on no face")
    patches = [Patch(frame.names[k], frame.planes[k]) for k in wide]
    if (plane_of < 0).any():
        curved = ~np.isin(frame.face_plane, wide)
        plane_of, names = curved_patches(points, facets, plane_of, len(wide), frame, curved)
        patches += [Patch(name) for name in names]
    used, facet_patch = np.unique(plane_of, return_inverse=True)
    patches = tuple(patches) if frame.exact else tuple(patches[k] for k in used)
    mesh = TetMesh(points, tets, facets, plane_of if frame.exact else facet_patch, patches)
    _check(mesh, frame, envelope)
    return mesh


def on_planes(points, tets, planes, envelope):
    """Snap the boundary to planes; tets that this makes flat are left out, and it is done again.

    Such a tet lies on a plane with all its corners: without it the boundary there has the other
    diagonal, or another number of triangles.

    Returns
    -------
    points, tets
        Ordered.
    facets : (b, 3) int32 array
    plane_of : (b,) int array
        See `facets_on_planes`.
    """
    while True:
        points, tets = ordered(points, tets)
        facets = boundary_facets(tets)
        facets = facets[morton_order(points[facets].mean(axis=1), MORTON_BITS)]
        plane_of = facets_on_planes(points, facets, planes, envelope)
        on_them = snapped(points, facets, plane_of, planes)
        flat = flat_tets(on_them, tets, planes)
        if not flat.any():
            return on_them, tets, facets, plane_of
        tets = tets[~flat]


def flat_tets(points, tets, planes):
    """Which tets (m,) have no volume to speak of and lie on one of the planes."""
    volumes = tet_volumes(points, tets)
    thin = np.flatnonzero(volumes < FLAT_VOLUME * np.abs(volumes).mean())
    flat = np.zeros(len(tets), dtype=bool)
    for plane in planes:
        near = np.abs(plane.signed_distance(points[tets[thin].ravel()])) <= ON_PLANE
        flat[thin[near.reshape(-1, 4).all(axis=1)]] = True
    return flat


def ordered(points, tets):
    """The used points and the tets, both along a Morton curve."""
    used = np.unique(tets)
    used = used[morton_order(points[used], MORTON_BITS)]
    rank = np.full(len(points), -1, np.int32)
    rank[used] = np.arange(len(used), dtype=np.int32)
    points, tets = points[used], rank[tets]
    return points, tets[morton_order(points[tets].mean(axis=1), MORTON_BITS)]


def facets_on_planes(points, facets, planes, envelope):
    """The plane each facet belongs to (b,): of those whose envelope holds it, the one whose
    normal is nearest to its own; -1 for none."""
    normals = normalised(area_vectors(points, facets))
    best = np.full(len(facets), 0.5)  # the cosine of 60 degrees
    plane_of = np.full(len(facets), -1)
    for k, plane in enumerate(planes):
        near = np.abs(plane.signed_distance(points)) <= envelope
        candidates = np.flatnonzero(near[facets].all(axis=1))
        cosine = normals[candidates] @ np.asarray(plane.normal)
        better = cosine > best[candidates]
        candidates = candidates[better]
        best[candidates], plane_of[candidates] = cosine[better], k
    return plane_of


def snapped(points, facets, plane_of, planes):
    """The points with every node moved by the least distance onto the planes of its facets."""
    points = points.copy()
    pairs = np.stack([facets.ravel(), np.repeat(plane_of, 3)], axis=1)
    pairs = np.unique(pairs[pairs[:, 1] >= 0], axis=0)
    if not len(pairs):
        return points
    normal = np.array([plane.normal for plane in planes])
    offset = np.array([plane.offset for plane in planes])
    nodes, first, count = np.unique(pairs[:, 0], return_index=True, return_counts=True)
    for number in np.unique(count):
        here = np.flatnonzero(count == number)
        mine = pairs[first[here, None] + np.arange(number), 1]
        x = points[nodes[here]]
        gap = offset[mine] - np.einsum("nkd,nd->nk", normal[mine], x)
        move = np.linalg.pinv(normal[mine], rcond=0.05) @ gap[..., None]
        points[nodes[here]] = x + move[..., 0]
    return on_axis_planes(points, pairs[:, 0], normal[pairs[:, 1]], offset[pairs[:, 1]])


def on_axis_planes(points, nodes, normals, offsets):
    """Set the coordinates of nodes on planes normal to an axis exactly, in place."""
    aligned = np.abs(normals).max(axis=1) == 1.0
    axis = np.abs(normals[aligned]).argmax(axis=1)
    sign = normals[aligned, axis]
    points[nodes[aligned], axis] = sign * offsets[aligned]
    return points


def curved_patches(points, facets, plane_of, first, frame, curved):
    """Number the facets that lie on no plane by the curved patch of the surface next to them.

    Returns
    -------
    patch_of : (b,) int array
        `plane_of` with the facets on curved patches numbered from `first`.
    names : list of str
        Of the curved patches: "surface", or "surface1", "surface2" ... where creases part them.
    """
    loose = np.flatnonzero(plane_of < 0)
    if not curved.any():
        curved = np.ones(len(frame.faces), dtype=bool)
    faces = frame.faces[curved]
    _, pairs = edge_table(faces).face_pairs()
    vectors = area_vectors(frame.points, faces)
    turn = angle_between(vectors[pairs[:, 0]], vectors[pairs[:, 1]])
    _, part = connected_faces(pairs[turn < CREASE_ANGLE], len(faces))
    middle = points[facets[loose]].mean(axis=1)
    nearest = ClosestPoint(frame.points, faces).query(middle)[0]
    parts, number = np.unique(part[nearest], return_inverse=True)
    patch_of = plane_of.copy()
    patch_of[loose] = first + number
    single = len(parts) == 1
    return patch_of, ["surface" if single else f"surface{k + 1}" for k in range(len(parts))]


def _check_edges(mesh, edge_length):
    """Raise InvalidMesh if the edges are much longer than asked for."""
    corners = mesh.points[mesh.tets]
    starts, ends = np.triu_indices(4, 1)
    mean = np.linalg.norm(corners[:, starts] - corners[:, ends], axis=2).mean()
    if mean > TOO_LONG * edge_length:
        raise InvalidMesh(f"its edges are {mean / edge_length:.2g} times as long as asked for")


def _check(mesh, frame, envelope):
    """Raise InvalidMesh unless the mesh is a valid one of the domain."""
    volumes = tet_volumes(mesh.points, mesh.tets)
    if not volumes.min() > 0:
        raise InvalidMesh(f"{(volumes <= 0).sum()} of its tets have no positive volume")
    found = topology(mesh.facets, len(mesh.points))
    if found.nonmanifold_edges or found.nonmanifold_vertices or not found.watertight:
        raise InvalidMesh("its boundary is not a closed manifold surface")
    surface = frame.surface
    wanted = signed_volume(surface)
    area = np.linalg.norm(area_vectors(surface.points, surface.faces), axis=1).sum()
    allowed = EXACT_VOLUME * wanted if frame.exact else envelope * area
    error = volumes.sum() - wanted
    if not abs(error) <= allowed:
        raise InvalidMesh(f"its volume is off by {error / wanted:.2g} of the domain's")
