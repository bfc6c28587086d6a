"""Closed pieces that overlap united into one, with manifold3d (Apache licence)."""

import numpy as np
from manifold3d import Error, Manifold, Mesh64, OpType

from meshes.edges import edge_table, face_components
from meshes.self_intersection import self_intersecting_faces
from meshes.tri_mesh import TriMesh


def unite(mesh, crossing):
    """Unite the pieces of a surface that cross each other.

    Parameters
    ----------
    mesh : TriMesh
        Manifold and oriented.
    crossing : (m,) bool array
        Which of its faces cross others.

    Returns
    -------
    mesh : TriMesh
        Vertices away from where the pieces crossed stay where they are. Labels are kept, and
        feature edges between such vertices. The same object if nothing could be united: only
        closed pieces with their normals outside can. A piece that crosses itself goes on doing so.
    pieces : int
        How many were united.
    """
    piece, overlapping = overlapping_pieces(mesh, crossing)
    solids = {k: _solid(mesh, np.flatnonzero(piece == k)) for k in overlapping}
    solids = {k: solid for k, solid in solids.items() if solid is not None}
    if len(solids) < 2:
        return mesh, 0
    whole = Manifold.batch_boolean(list(solids.values()), OpType.Add)
    if whole.status() != Error.NoError or whole.is_empty():
        return mesh, 0
    return _joined(mesh, ~np.isin(piece, list(solids)), whole.to_mesh64()), len(solids)


def overlapping_pieces(mesh, crossing):
    """The piece of each face (m,), and those pieces that cross others.

    These have faces that cross others, but do not when the piece is alone.
    """
    _, piece = face_components(mesh.faces)
    candidates, found = np.unique(piece[crossing]), []
    if len(candidates) < 2:
        return piece, found
    for k in candidates:
        mine = piece == k
        alone = self_intersecting_faces(mesh.points, mesh.faces[mine])
        if (crossing[mine] & ~alone).any():
            found.append(k)
    return piece, found


def _solid(mesh, chosen):
    """The Manifold of some faces; None if they are none, or are inside out."""
    if (edge_table(mesh.faces[chosen]).count != 2).any():
        return None
    used, faces = np.unique(mesh.faces[chosen], return_inverse=True)
    solid = Manifold(
        Mesh64(
            np.ascontiguousarray(mesh.points[used]),
            faces.reshape(-1, 3).astype(np.uint64),
            face_id=chosen.astype(np.uint64),
        )
    )
    proper = solid.status() == Error.NoError and solid.volume() > 0.0
    return solid if proper else None


def _joined(mesh, kept, united):
    """The faces that took no part and the united ones as one TriMesh."""
    sources = np.asarray(united.face_id, dtype=np.int64)
    points = np.concatenate([mesh.points, np.asarray(united.vert_properties)[:, :3]])
    faces = np.asarray(united.tri_verts, dtype=np.int64) + len(mesh.points)
    faces = np.concatenate([mesh.faces[kept], faces])
    labels = np.concatenate([mesh.face_labels[kept], mesh.face_labels[sources]])
    used, index = np.unique(faces, return_inverse=True)
    faces = index.reshape(-1, 3)
    place = np.unique(points, axis=0, return_inverse=True)[1].ravel()
    wanted = {tuple(pair) for pair in np.sort(place[mesh.feature_edges], axis=1).tolist()}
    edges = edge_table(faces).edges
    found = [tuple(pair) in wanted for pair in np.sort(place[used][edges], axis=1).tolist()]
    return TriMesh(points[used], faces, labels, mesh.labels, edges[np.array(found, dtype=bool)])
