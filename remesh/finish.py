"""From the work mesh back to a TriMesh: planes exact, and a check against the exact normals."""

import numpy as np

from meshes.quality import face_normals

INVERTED = 0.0


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
