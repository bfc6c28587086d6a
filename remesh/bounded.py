"""As few triangles as an error bound allows, and the proof that it holds.

1. The original (`dense` makes one of an interpolant) is made coarser, as long as samples of it stay
   within the bound (`bounded_collapse`); vertices are moved and edges flipped so that more can go
   (`bounded_relax`).
2. Both surfaces are compared for every point, not for samples (`meshes.distance_bound`). Where the
   bound does not hold, points of the original are put into the triangles (`bounded_insert`), until
   it does.
3. Where triangles cross that did not in the original, samples get a smaller share of the bound,
   and it is done again.
4. If asked for, angles are bettered and sizes graded, the bound staying proved (`bounded_shape`).
"""

from dataclasses import dataclass, replace

import numpy as np

from meshes import TriMesh
from meshes.closest_point import ClosestPoint
from meshes.self_intersection import self_intersecting_faces
from remesh.bounded_collapse import collapse_within
from remesh.bounded_insert import insert_points
from remesh.bounded_mend import untangle
from remesh.bounded_mesh import FIXED, BoundedMesh
from remesh.bounded_proof import BoundProof, closest
from remesh.bounded_relax import relax_within
from remesh.bounded_shape import TIGHTER, ShapeAims, shape_within
from remesh.dense import dense_triangulation
from remesh.finish import on_plane
from remesh.prepare import surfaces_by_label
from remesh.triangle_surface import TriangleSurface

SAFETY = 0.97  # share of the bound that samples may use
DENSE_SHARE = 0.08  # of the bound: how far the triangulation of an interpolant may lie off
RELAXATIONS = 2
MOST_INSERTIONS = 30
RINGS = 1  # around missed faces, whose vertices move
FIRST_INSERTION = 2  # before, vertices and edges are moved alone
MOST_STUCK = 3  # turns that leave as many faces
LAST_MOVES = 9  # after, nothing moves any more
MOST_MENDED = 6
ATTEMPTS = 4
STRICTER = 0.8  # angle between normals that samples may have, where it did not hold
LESS = 0.1  # of the squared bound, where triangles crossed or the bound did not hold
LEAST_AGREEMENT = 0.2


@dataclass(frozen=True)
class BoundLimits:
    """What the triangles are held to.

    Parameters
    ----------
    error : float [unit of the points]
        Largest distance.
    normal_angle : float [degrees]
        Largest angle between normals; 180 for none.
    least_angle : float [degrees]
        No operation makes a smaller angle, unless there was one.
    min_length, max_length : float [unit of the points]
        Shorter edges are collapsed whatever the error; no longer ones are made.
    edge_length, sigma : float [unit of the points]
        No edges are made that are longer in the embedding (x, sigma n).
    """

    error: float
    normal_angle: float = 180.0
    least_angle: float = 1.0
    min_length: float = 0.0
    max_length: float = np.inf
    edge_length: float = np.inf
    sigma: float = 0.0

    def figures(self):
        """The tuple that the kernels take; see `bounded_collapse.sweep_collapses`."""
        held = self.normal_angle < 180.0
        return (
            (SAFETY * self.error) ** 2,
            float(np.tan(np.radians(self.least_angle))),
            LEAST_AGREEMENT,
            float(np.cos(np.radians(SAFETY * self.normal_angle))) if held else -1.0,
            min(float(self.max_length), 1e140) ** 2,
            min(float(self.edge_length), 1e140) ** 2,
            float(self.sigma) ** 2 if np.isfinite(self.edge_length) else 0.0,
            float(self.min_length) ** 2,
        )


@dataclass(frozen=True, eq=False)
class BoundedResult:
    """A surface and how far it is from its original, proved.

    Parameters
    ----------
    mesh : TriMesh
    distance : float [unit of the points]
        No point of either surface is farther from the other.
    normal_angle : float [degrees]
        Every point of each surface has a point of the other within the error asked for whose
        normal differs by no more.
    inserted : int
        Points that had to be put in at the end.
    crossing, inverted : int
        Triangles left that meet others, and that lie against the original's normals.
    """

    mesh: TriMesh
    distance: float
    normal_angle: float
    inserted: int
    crossing: int
    inverted: int


def remesh_within(mesh, surfaces, settings, progress):
    """The surface with as few triangles as the settings' `max_error` allows.

    Parameters
    ----------
    mesh : TriMesh
        With all its feature edges.
    surfaces, settings, progress
        As of `remesh.remesh`.

    Returns
    -------
    BoundedResult
        Distances from implicit surfaces are those from a triangulation of them, and what that
        leaves at quadrature points.
    """
    error, gap = settings.max_error, 0.0
    if surfaces is not None and not isinstance(surfaces, TriangleSurface):
        by_label = surfaces_by_label(mesh, surfaces)
        mesh, gap = dense_triangulation(mesh, by_label, DENSE_SHARE * error)
        progress("dense", 1.0)
    elif surfaces is not None:
        mesh = surfaces.carrier.mesh
    limits = BoundLimits(
        max(error - gap, 0.5 * error),
        180.0 if settings.max_normal_angle is None else settings.max_normal_angle,
        settings.least_angle,
        settings.min_length,
        settings.max_length,
        np.inf if settings.edge_length is None else settings.edge_length,
        settings.sigma,
    )
    result = simplify_within(
        mesh, limits, settings.fix_boundary, settings.corner_angle,
        lambda share: progress("bound", share), shape_aims(settings),
    )  # fmt: skip
    return replace(result, distance=result.distance + gap)


def shape_aims(settings):
    """The ShapeAims of settings; None if they ask for nothing."""
    if settings.quality is None and settings.gradation is None:
        return None
    return ShapeAims(
        settings.quality is not None,
        settings.sigma if settings.quality == "6d" else 0.0,
        None if settings.gradation is None else settings.gradation - 1.0,
        settings.fix_boundary,
    )


def simplify_within(mesh, limits, fix_boundary=False, corner_angle=45.0, progress=None, aims=None):
    """Make a surface coarser within an error bound.

    Parameters
    ----------
    mesh : TriMesh
        Manifold and oriented, with all its feature edges.
    limits : BoundLimits
    fix_boundary : bool
    corner_angle : float [degrees]
    progress : callable, optional
        Called with the share done.
    aims : ShapeAims, optional
        What the shapes are to be; as few triangles as can be if not given.

    Returns
    -------
    BoundedResult
    """
    progress = (lambda share: None) if progress is None else progress
    share = np.ones(len(mesh.points))
    used = TIGHTER * limits.error if aims is not None and aims.quality else limits.error
    for attempt in range(ATTEMPTS):
        work = BoundedMesh(mesh, limits.error, fix_boundary, corner_angle)
        work.lower_shares(share)
        angle = limits.normal_angle
        stricter = angle * STRICTER**attempt if angle < 180.0 else angle
        coarsen(work, replace(limits, normal_angle=stricter, error=used), progress)
        inserted, missed, proof = make_sure(work, limits)
        progress(0.9)
        result, alive = proof.mesh, proof.alive
        if limits.min_length > 0.0:
            missed = missed[:0]  # which may be why: no reason to begin again
        crossing = self_intersecting_faces(result.points, result.faces)
        inverted = proof.inverted()
        if not (crossing.any() or len(missed) or inverted.any()) or attempt == ATTEMPTS - 1:
            break
        near = vertices_near(mesh, result, crossing)
        near[mesh.faces[work.crossed]] = False
        near |= vertices_near(mesh, result, np.isin(alive, missed) | inverted)
        if not near.any():
            break
        share[near] *= LESS
    if aims is not None:
        shape_within(work, proof, limits, aims, flatten)
        result = proof.mesh
        crossing = self_intersecting_faces(result.points, result.faces)
        inverted = proof.inverted()
    return BoundedResult(
        result, proof.proved, proof.normal_angle, inserted, int(crossing.sum()),
        int(inverted.sum()),
    )  # fmt: skip


def coarsen(work, limits, progress):
    """Collapse, relax and collapse again; points of planar labels come to lie in their planes."""
    collapse_within(work, limits)
    progress(0.5)
    for k in range(RELAXATIONS):
        relax_within(work, limits)
        collapse_within(work, limits)
        progress(0.5 + 0.3 * (k + 1) / RELAXATIONS)
    flatten(work)


def flatten(work):
    """Put the points of planar labels exactly into their planes; those that are fixed stay."""
    corner, _, _, label, _, kind, points, _, _ = work.state
    corners = corner[: 3 * work.counts[1]].reshape(-1, 3)
    for number, patch in enumerate(work.source.labels):
        if patch.plane is None:
            continue
        chosen = (corners[:, 0] >= 0) & (label[: len(corners)] == number)
        vertices = np.unique(corners[chosen])
        vertices = vertices[kind[vertices] != FIXED]
        points[vertices] = on_plane(points[vertices], patch.plane)


def make_sure(work, limits):
    """Insert points of the original until the bound is proved, and mend what is no surface.

    Returns
    -------
    inserted : int
    missed : int array
        Faces of the work mesh for which it is not proved.
    proof : BoundProof
        Of the work mesh as it is.
    """
    total, proof, before, stuck, mended = 0, BoundProof(work, limits), 0, 0, 0
    for turn in range(MOST_INSERTIONS + 1):
        proof.renew()
        faces, places, targets = proof.missed()
        stuck = stuck + 1 if len(faces) == before else 0
        before = len(faces)
        if turn == MOST_INSERTIONS:
            break
        if before == 0 or stuck == MOST_STUCK:
            changes = mend(work, limits, proof, faces, mended) if mended < MOST_MENDED else 0
            if changes == 0:
                break
            mended, stuck = mended + 1, 0
            continue
        work.add_samples(faces, targets)
        if turn >= FIRST_INSERTION:
            total += insert(work, faces, places, targets, limits, turn < LAST_MOVES)
        if turn < LAST_MOVES:
            relax_within(work, limits, 1, work.vertices_around(faces, RINGS))
        flatten(work)
    return total, np.unique(faces), proof


def insert(work, faces, places, targets, limits, may_move):
    """Put points of the original into faces; return how many."""
    curves = on_feature_edges(work.source, targets)
    return insert_points(work, faces, places, targets, curves, limits, may_move)


def mend(work, limits, proof, missed, turn):
    """Mend triangles that are inverted or stay missed, and put points into those that cross.

    The latter only where the original does not cross itself. Returns how many changes were made.
    """
    mesh, alive = proof.mesh, proof.alive
    wrong = np.union1d(alive[proof.against()], missed)
    changes = untangle(work, wrong, limits, turn % 2 == 1) if len(wrong) else 0
    places = proof.faces.place[alive]
    crossing = self_intersecting_faces(mesh.points, mesh.faces)
    if crossing.any() and work.crossed.any():
        crossing[:] = False
    places[crossing] = mesh.points[mesh.faces[crossing]].mean(axis=1)
    chosen = np.flatnonzero(crossing | proof.far_normals())
    if len(chosen):
        targets = closest(work.search, work.source, places[chosen])[1]
        changes += insert(work, alive[chosen], places[chosen], targets, limits, False)
    flatten(work)
    return changes


def on_feature_edges(mesh, points):
    """The points (k, 3) of a mesh's feature edges closest to points (k, 3); as they are if none."""
    edges = mesh.feature_edges
    if len(edges) == 0 or len(points) == 0:
        return np.ascontiguousarray(points)
    flat = np.column_stack([edges, edges[:, 1]])
    found, weights, _ = ClosestPoint(mesh.points, flat).query(points)
    return np.einsum("nk,nkd->nd", weights, mesh.points[flat[found]])


def vertices_near(mesh, result, crossing):
    """Vertices (n,) bool of the mesh that lie nearest to some of the result's faces or around."""
    touched = np.zeros(len(result.points), bool)
    touched[result.faces[crossing]] = True
    around = touched[result.faces].any(axis=1)
    found, _, _ = ClosestPoint(result.points, result.faces).query(mesh.points)
    return around[found]
