"""From the work mesh back to a TriMesh: planes exact, and a check against the exact normals."""

from functools import partial

import numpy as np

from meshes.quality import face_normals
from meshes.self_intersection import self_intersecting_faces
from remesh.adjust import free_rows, take_steps
from remesh.collapse import collapse_short_edges
from remesh.connectivity import BASE, OFFSET, ROWS
from remesh.flip import DELAUNAY, flip_edges
from remesh.smooth import UNIFORM, smooth_vertices

INVERTED = 0.0
REPAIR_ROUNDS = 4
REPAIR_LIMITS = (0.0, 8.0, 0.3)
COLLAPSE_LIMITS = (0.0, 1.0, 0.0)


def finished_mesh(work, source):
    """The work mesh as TriMesh, with the points of planar labels exactly in their planes.

    Parameters
    ----------
    work : WorkMesh
        Compacted here.
    source : TriMesh
        Whose labels and planes hold.
    """
    work.compact()
    mesh, _ = work.to_mesh()
    points = mesh.points.copy()
    for label, patch in enumerate(source.labels):
        if patch.plane is not None:
            vertices = np.unique(mesh.faces[mesh.face_labels == label])
            points[vertices] = on_plane(points[vertices], patch.plane)
    return mesh.with_points(points)


def on_plane(points, plane):
    """Points (n, 3) moved onto a plane; exact for planes across a coordinate axis."""
    normal = np.asarray(plane.normal, float)
    axis = int(np.abs(normal).argmax())
    points = np.array(points)
    if np.count_nonzero(normal) == 1:
        points[:, axis] = plane.offset / normal[axis]
        return points
    return points - plane.signed_distance(points)[:, None] * normal


def inverted_faces(mesh, work, gaps):
    """Faces (m,) bool whose normal points against the surface's exact normal at a corner."""
    exact = gaps.exact_normals(mesh, work)
    cosine = np.einsum("md,mkd->mk", face_normals(mesh.points, mesh.faces), exact)
    return cosine.min(axis=1) <= INVERTED


def repair(work, gaps):
    """Undo moves around intersecting and inverted triangles until there are none.

    First the vertices of such triangles, and one more ring around them each time, go back to the
    carrier they were offset from, and are smoothed and flipped on it. Where that does not help,
    the triangles' short edges are collapsed. What leaves no fewer such triangles is taken back.

    Parameters
    ----------
    work : WorkMesh
        Compact, and so again at the end.
    gaps : TriangleFidelity or ImplicitFidelity
        Knows the exact normals.

    Returns
    -------
    intersecting, inverted : int
        Faces that are left so.
    rounds : int
        How often vertices were moved or taken out.
    """
    attempts = [partial(_moved_back, rings=rings) for rings in range(REPAIR_ROUNDS)]
    attempts += [partial(_collapsed, rings=rings) for rings in (0, 0, 1, 1, 2, 3)]
    crossing, inverted = wrong_faces(work, gaps)
    rounds = 0
    for attempt in attempts:
        bad = crossing | inverted
        if not bad.any():
            break
        before = work.saved()
        attempt(work, bad)
        work.compact()
        after = wrong_faces(work, gaps)
        if (after[0] | after[1]).sum() < bad.sum():
            (crossing, inverted), rounds = after, rounds + 1
        else:
            work.restore(before)
    return int(crossing.sum()), int(inverted.sum()), rounds


def wrong_faces(work, gaps):
    """Which faces (m,) intersect others, and which are inverted."""
    mesh, _ = work.to_mesh()
    crossing = self_intersecting_faces(mesh.points, mesh.faces)
    return crossing, inverted_faces(mesh, work, gaps)


def _moved_back(work, faces, rings):
    """Vertices of the faces, and some rings around, back on the carrier, smoothed and flipped."""
    chosen = rows_around(work, faces, rings)
    free = free_rows(work) & chosen
    step = -work.rows[: len(free), OFFSET, None] * work.rows[: len(free), 3:6]
    take_steps(work, free, step, 0.0, REPAIR_LIMITS)
    padded = np.zeros(len(work.links), bool)
    padded[: len(chosen)] = chosen
    flip_edges(work, 0.0, REPAIR_LIMITS, DELAUNAY, 3, chosen=padded)
    for _ in range(2):
        smooth_vertices(work, 0.0, REPAIR_LIMITS, UNIFORM, 0.5, chosen=padded)


def _collapsed(work, faces, rings):
    """Collapse short edges of the faces, and of some rings around them.

    Short is no longer than the shortest edge of any of the faces, with rings than the longest.
    """
    corners, _ = work.corner_rows()
    points = work.rows[corners[faces], :3]
    lengths = np.linalg.norm(points - np.roll(points, -1, axis=1), axis=2)
    shortest = (lengths.max(axis=1) if rings else lengths.min(axis=1)).max()
    chosen = faces
    if rings > 1:
        vertex = work.links[corners, BASE]
        chosen = rows_around(work, faces, rings - 2)[vertex].any(axis=1)
    collapse_short_edges(work, 1.001 * shortest, np.inf, 0.0, COLLAPSE_LIMITS, chosen=chosen)


def rows_around(work, faces, rings):
    """Rows (n,) bool of the vertices of some faces, and of as many rings around them."""
    corners, _ = work.corner_rows()
    vertex = work.links[corners, BASE]
    chosen = np.zeros(int(work.counts[ROWS]), bool)
    chosen[vertex[faces]] = True
    for _ in range(rings):
        touched = chosen[vertex].any(axis=1)
        chosen[vertex[touched]] = True
    return chosen
