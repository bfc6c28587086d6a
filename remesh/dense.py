"""A triangulation as close to an interpolant as asked, from the interpolant's own values.

An edge is halved where the interpolant says that it leaves the surface: at the quadrature points
of the edge or of a face beside it, S over the length of its gradient is the distance. Normals
alone cannot tell: where both ends of a long edge lie on a crest, their normals agree, whatever
lies between (the thesis's section 4.2.1, and its outlook).
"""

import numpy as np

from meshes import TriMesh
from meshes.topology import edge_table, feature_mask

EDGE_POINTS = (0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0), 0.5)  # Gauss's two, and one
FACE_POINTS = ((1 / 6, 1 / 6, 2 / 3), (1 / 6, 2 / 3, 1 / 6), (2 / 3, 1 / 6, 1 / 6))
ROUNDS = 8
MOST_FACES = 4_000_000


def dense_triangulation(mesh, surfaces, tolerance):
    """Triangulate implicit surfaces.

    Parameters
    ----------
    mesh : TriMesh
        With all its feature edges, which are kept as they are.
    surfaces : sequence of ImplicitSurface, one per label
    tolerance : float [unit of the points]
        How far quadrature points of edges and faces may lie off.

    Returns
    -------
    mesh : TriMesh
    gap : float [unit of the points]
        The largest distance left at a quadrature point.
    """
    mesh = on_surfaces(mesh, surfaces, np.arange(len(mesh.points)))
    for turn in range(ROUNDS + 1):
        table = edge_table(mesh.faces)
        crease = feature_mask(mesh, table)
        gap = edge_gaps(mesh, surfaces, table)
        gap[crease] = 0.0
        far = gap > tolerance
        if not far.any() or turn == ROUNDS or len(mesh.faces) > MOST_FACES:
            break
        before = len(mesh.points)
        mesh = halved(mesh, table, far)
        mesh = on_surfaces(mesh, surfaces, np.arange(before, len(mesh.points)))
    return mesh, float(gap.max(initial=0.0))


def edge_gaps(mesh, surfaces, table):
    """Largest distance (e,) from its surface of an edge's points and of those in its faces."""
    corners = mesh.points[mesh.faces]
    per_face = np.zeros((len(mesh.faces), 3))
    for label in np.unique(mesh.face_labels):
        chosen = np.flatnonzero(mesh.face_labels == label)
        own = corners[chosen]
        for weights in FACE_POINTS:
            place = np.einsum("k,mkd->md", np.array(weights), own)
            gap = distance_from(surfaces[label], place)
            longest = np.linalg.norm(np.roll(own, -1, axis=1) - own, axis=2).argmax(axis=1)
            np.maximum.at(per_face, (chosen, longest), gap)
        for s in EDGE_POINTS:
            place = (1.0 - s) * own + s * np.roll(own, -1, axis=1)
            gap = distance_from(surfaces[label], place.reshape(-1, 3)).reshape(-1, 3)
            per_face[chosen] = np.maximum(per_face[chosen], gap)
    result = np.zeros(len(table.edges))
    np.maximum.at(result, table.face_edges.ravel(), per_face.ravel())
    return result


def distance_from(surface, points):
    """|S| over the length of its gradient (n,); 0 where S is undefined."""
    value, gradient = surface.value_and_gradient(points)
    size = np.linalg.norm(gradient, axis=1)
    known = np.isfinite(value) & (size > 0.0)
    return np.where(known, np.abs(value) / np.where(known, size, 1.0), 0.0)


def on_surfaces(mesh, surfaces, chosen):
    """The mesh with the chosen vertices on their surfaces, but for those on feature edges."""
    free = np.zeros(len(mesh.points), bool)
    free[chosen] = True
    free[mesh.feature_edges.ravel()] = False
    points = mesh.points.copy()
    for label in np.unique(mesh.face_labels):
        vertices = np.unique(mesh.faces[mesh.face_labels == label])
        vertices = vertices[free[vertices]]
        moved, _ = surfaces[label].project(points[vertices])
        known = np.isfinite(moved).all(axis=1)
        points[vertices[known]] = moved[known]
    return mesh.with_points(points)


def halved(mesh, table, chosen):
    """The mesh with the chosen edges (e,) halved, and their faces cut into two, three or four."""
    number = np.full(len(table.edges), -1)
    number[chosen] = len(mesh.points) + np.arange(chosen.sum())
    points = np.concatenate([mesh.points, mesh.points[table.edges[chosen]].mean(axis=1)])
    middle = number[table.face_edges]
    marked = middle >= 0
    count = marked.sum(axis=1)
    # turn every face so that its first edge is marked and, with two, the last one is not
    turn = np.where(count == 1, marked.argmax(axis=1), 0)
    turn = np.where(count == 2, (marked.argmin(axis=1) + 1) % 3, turn)
    index = (np.arange(3) + turn[:, None]) % 3
    corner = np.take_along_axis(mesh.faces.astype(np.int64), index, axis=1)
    middle = np.take_along_axis(middle, index, axis=1)
    (a, b, c), (p, q, r) = corner.T, middle.T
    parts = {
        0: ((a, b, c),),
        1: ((a, p, c), (p, b, c)),
        2: ((p, b, q), (a, p, q), (a, q, c)),
        3: ((a, p, r), (p, b, q), (r, q, c), (p, q, r)),
    }
    faces, labels = [], []
    for k, triangles in parts.items():
        for triangle in triangles:
            faces.append(np.stack(triangle, axis=1)[count == k])
            labels.append(mesh.face_labels[count == k])
    return TriMesh(
        points, np.concatenate(faces), np.concatenate(labels), mesh.labels, mesh.feature_edges
    )
