"""Tetrahedral meshes of a design domain: a box, or the inside of any closed surface.

`kind="pytetwild"` meshes any domain without structure; its result differs from run to run and is
therefore kept on disk. `kind="bcc"` is a lattice, for boxes only: at once, and always the same.
"""

import math
import time
from dataclasses import replace

import numpy as np

from meshes.errors import InvalidCase, NotConverged
from meshes.patch import Patch
from meshes.quality import area_vectors, signed_volume
from meshes.structured import bcc_box, box_patches
from meshes.tet_mesh import TetMesh
from topopt.boundary import attach_sets
from topopt.geometry import morton_order
from topopt.meshing_cache import cache_key, cached, default_cache, mesh_hash
from topopt.meshing_count import Size, mesh_by_count
from topopt.meshing_frame import DIGITS, frame_of, in_frame
from topopt.meshing_tetwild import (
    EPSILON,
    OutOfTime,
    mesh_frame,
    on_axis_planes,
    pytetwild_version,
)

__all__ = ["attach_sets", "default_cache", "estimated_edge_length", "mesh_domain", "mesh_hash"]

MESHING_VERSION = 1  # part of the cache's key: raise it when the meshing gives other meshes
MOST_TETS = 50_000_000
BCC_EDGE = 0.923  # mean edge of a body-centred cubic mesh, in units of its cells


def mesh_domain(
    problem,
    edge_length=None,
    tets=None,
    kind="pytetwild",
    cache=None,
    log=None,
    time_limit=None,
    sizing=None,
):
    """Mesh the domain of a problem.

    Parameters
    ----------
    problem : Problem
        Only its domain counts; `attach_sets` adds loads, supports and symmetry.
    edge_length : float [m], optional
    tets : int, optional
        Number of tets aimed at; give this or `edge_length`.
    kind : str
        "pytetwild" or "bcc" (boxes only; the count is as near as the lattice allows).
    cache : path-like or False, optional
        Folder in which pytetwild's meshes are kept; `default_cache()` if not given, none if False.
    log : callable taking a str, optional
        Told what happens.
    time_limit : float, optional [s]
        That pytetwild may take in all.
    sizing : Sizing, optional
        Edge lengths from place to place, in the stead of `edge_length` and `tets`; pytetwild's
        meshes only.

    Returns
    -------
    TetMesh
        With a patch for each face of a box ("x-" ... "z+"), each large flat part of a surface
        ("plane1" ...) and its curved rest ("surface" ...); without named sets.

    Raises
    ------
    InvalidCase
        Arguments that make no sense, or a surface that bounds no solid.
    NotConverged
        If no valid mesh, or none within 10 % of the count, was found, or not in time.
    """
    log = log or (lambda message: None)
    if sizing is not None:
        _check_sizing(edge_length, tets, kind)
        edge_length = float(sizing.edge_lengths.max())
    _check_arguments(edge_length, tets, kind)
    frame = frame_of(problem.domain)
    length = None if edge_length is None else in_frame(edge_length, frame)
    size = Size(signed_volume(frame.surface), _area(frame))
    _check_count(size, length, tets)
    if kind == "bcc":
        return _bcc_mesh(frame, length, tets, log)

    field = None if sizing is None else _sizing_in_frame(sizing, frame)

    def make():
        mesh_at = _Meshing(frame, log, time_limit, field)
        if tets is None:
            return mesh_at(length)
        return mesh_by_count(mesh_at, size, tets, log)

    settings = [MESHING_VERSION, pytetwild_version(), EPSILON, length, tets, frame.exact]
    folder = None if cache is False else cache or default_cache()
    key = cache_key(settings, frame.points, frame.faces, *(field or ()))
    mesh = cached(folder, key, make, log)
    return _in_metres(mesh, frame)


def _check_arguments(edge_length, tets, kind):
    """Raise InvalidCase for arguments that make no sense."""
    if (edge_length is None) == (tets is None):
        raise InvalidCase("a mesh needs either an edge length or a number of tets, not both.")
    wanted = edge_length if tets is None else tets
    if not (math.isfinite(wanted) and wanted > 0):
        name = "edge length" if tets is None else "number of tets"
        raise InvalidCase(f"the {name} of the mesh must be positive, got {wanted}.")
    if kind not in ("pytetwild", "bcc"):
        raise InvalidCase(f"there is no mesh of kind {kind!r}; choose 'pytetwild' or 'bcc'.")


def _check_sizing(edge_length, tets, kind):
    if edge_length is not None or tets is not None:
        raise InvalidCase("a sizing takes the place of the edge length and the number of tets.")
    if kind != "pytetwild":
        raise InvalidCase(f"a mesh of kind {kind!r} is uniform; a sizing needs 'pytetwild'.")


def _sizing_in_frame(sizing, frame):
    """Background points, tets and edge lengths of a Sizing in the frame, for pytetwild."""
    points = np.round((sizing.mesh.points - frame.lower) / frame.scale, DIGITS)
    return points, sizing.mesh.tets, np.round(sizing.edge_lengths / frame.scale, DIGITS)


def estimated_edge_length(problem, tets):
    """Edge length [m] at which the domain's mesh has roughly so many tets (within a factor of 2).

    For meshes whose count does not matter much: nothing is tried.
    """
    frame = frame_of(problem.domain)
    size = Size(signed_volume(frame.surface), _area(frame))
    return size.edge_length(tets) * frame.scale


def _check_count(size, length, tets):
    """Raise InvalidCase if a mesh would have more tets than anybody can use."""
    expected = size.count(length) if tets is None else tets
    if expected > MOST_TETS:
        raise InvalidCase(
            f"the mesh would have about {expected:.2g} tets, and {MOST_TETS:,} are the limit; "
            f"raise the edge length (it is in metres) or lower the count."
        )


def _area(frame):
    return float(np.linalg.norm(area_vectors(frame.points, frame.faces), axis=1).sum())


class _Meshing:
    """Meshes a frame at one edge length after another, until its time is up."""

    def __init__(self, frame, log, time_limit, sizing=None):
        self._frame, self._log, self._limit, self._sizing = frame, log, time_limit, sizing
        self._began, self._counts = time.monotonic(), []

    def __call__(self, length):
        """The mesh of an edge length of the frame; tells what came out."""
        metres = length * self._frame.scale
        what = "edge length" if self._sizing is None else "longest edge length"
        self._log(f"pytetwild meshes with the {what} {metres:.4g} m ...")
        left = None
        if self._limit is not None:
            left = max(self._limit - (time.monotonic() - self._began), 1e-3)
        try:
            mesh = mesh_frame(self._frame, length, self._log, left, self._sizing)
        except OutOfTime as error:
            raise NotConverged(self._out_of_time(metres), tuple(self._counts)) from error
        self._counts.append(len(mesh.tets))
        self._log(f"... and gives {len(mesh.tets):,} tets")
        return mesh

    def _out_of_time(self, metres):
        so_far = ", ".join(f"{count:,}" for count in sorted(set(self._counts)))
        advice = f"ask for one of the counts that came out ({so_far}), " if so_far else ""
        return (
            f"the domain was not meshed within {self._limit:g} s (at an edge length of "
            f"{metres:.3g} m); {advice}use a longer edge or fewer tets, simplify the domain's "
            f"surface (fine detail and jags cost the most), or raise mesh.time_limit."
        )


def _in_metres(mesh, frame):
    """A mesh of the frame as one of the domain itself, its planes exact."""
    patches = tuple(
        Patch(p.name, None if p.plane is None else frame.plane_in_metres(p.plane))
        for p in mesh.patches
    )
    points = frame.to_metres(mesh.points)
    for k, patch in enumerate(patches):
        nodes = np.unique(mesh.facets[mesh.facet_patch == k])
        if patch.plane is not None and len(nodes):
            normals = np.broadcast_to(patch.plane.normal, (len(nodes), 3))
            on_axis_planes(points, nodes, normals, np.full(len(nodes), patch.plane.offset))
    return replace(mesh, points=points, patches=patches)


def _bcc_mesh(frame, length, tets, log):
    """A lattice of a box by edge length or count, in metres."""
    if not frame.exact:
        raise InvalidCase("a mesh of kind 'bcc' fills a box only; choose 'pytetwild'.")
    sides = frame.points.max(axis=0)
    if tets is None:
        cells = np.maximum(np.round(np.round(sides * BCC_EDGE / length, 9)), 1).astype(int)
    else:
        cells = _bcc_cells(sides, tets)
    lattice = bcc_box((0, 0, 0), tuple(cells), tuple(cells))
    order = morton_order(lattice.points, 21)
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    points = lattice.points[order]
    by_place = morton_order(lattice.points[lattice.tets].mean(axis=1), 21)
    points = frame.lower + points / cells * (frame.upper - frame.lower)
    for axis in range(3):
        points[lattice.points[order, axis] == cells[axis], axis] = frame.upper[axis]
    mesh = TetMesh(
        points,
        rank[lattice.tets[by_place]],
        rank[lattice.facets],
        lattice.facet_patch,
        box_patches(frame.lower, frame.upper),
    )
    log(f"lattice of {cells[0]} x {cells[1]} x {cells[2]} cells: {len(mesh.tets):,} tets")
    return mesh


def _bcc_cells(sides, tets):
    """Numbers of cells (3,) that give nearly a wanted number of tets with nearly cubic cells."""
    best = None
    for scale in np.geomspace(0.5, 2.0, 121):
        ideal = sides * scale * (tets / 12.0 / np.prod(sides)) ** (1.0 / 3.0)
        for up in np.ndindex(2, 2, 2):
            cells = np.maximum(np.floor(ideal) + up, 1).astype(int)
            error = abs(math.log(bcc_count(cells) / tets))
            ratio = cells / sides
            stretch = ratio.max() / ratio.min()
            rank = (max(error, 0.03), stretch, error)
            if best is None or rank < best[0]:
                best = (rank, cells)
    return best[1]


def bcc_count(cells):
    """Number of tets of a lattice of cells (nx, ny, nz)."""
    nx, ny, nz = (int(n) for n in cells)
    return 12 * nx * ny * nz + 4 * (nx * ny + ny * nz + nz * nx)
