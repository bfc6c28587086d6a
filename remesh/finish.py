"""From the work mesh back to a TriMesh: planes exact, and a check against the exact normals."""

import numpy as np

from meshes.quality import face_normals
from meshes.self_intersection import self_intersecting_faces
from remesh.adjust import free_rows, take_steps
from remesh.connectivity import BASE, OFFSET, ROWS
from remesh.smooth import UNIFORM, smooth_vertices

INVERTED = 0.0
REPAIR_ROUNDS = 6


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


def separate(work, limits):
    """Undo moves around self-intersections until there are none; return how many faces are left.

    The vertices of intersecting triangles, and in each round one more ring around them, go back
    to the carrier they were offset from, and are smoothed on it.

    Parameters
    ----------
    work : WorkMesh
        Compacted here.
    limits : (angle6, angle3, agreement)
    """
    work.compact()
    bad = intersecting(work)
    for rings in range(REPAIR_ROUNDS):
        if not bad.any():
            break
        chosen = rows_around(work, bad, rings)
        free = free_rows(work) & chosen
        step = -work.rows[: len(free), OFFSET, None] * work.rows[: len(free), 3:6]
        take_steps(work, free, step, 0.0, limits)
        padded = np.zeros(len(work.links), bool)
        padded[: len(chosen)] = chosen
        smooth_vertices(work, 0.0, limits, UNIFORM, 0.5, chosen=padded)
        bad = intersecting(work)
    return int(bad.sum())


def intersecting(work):
    """Self-intersecting faces (m,) bool of a compact work mesh."""
    mesh, _ = work.to_mesh()
    return self_intersecting_faces(mesh.points, mesh.faces)


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
