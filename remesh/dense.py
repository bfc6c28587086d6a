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
LONG, HIDDEN, UNEXPLAINED = 1.5, 0.1, 3.0  # edges; of an edge; times the sagitta
REST = 0.2  # of an edge: the shortest that are cut where something was hidden
MOST_HALVINGS, SLACKER = 40, 1.25
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
        gap = edge_gaps(mesh, surfaces, table)
        gap[feature_mask(mesh, table)] = 0.0
        far = gap > tolerance
        if not far.any() or turn == ROUNDS or len(mesh.faces) > MOST_FACES:
            break
        before = len(mesh.points)
        mesh = halved(mesh, table, far)
        mesh = on_surfaces(mesh, surfaces, np.arange(before, len(mesh.points)))
    return mesh, float(gap.max(initial=0.0))


def with_hidden_shapes(mesh, normals, surfaces, length):
    """The mesh with more vertices where surfaces rise or sink unseen between those it has.

    Something is hidden where the quadrature points of an edge are farther off than a good part of
    `length`, and than three times what the normals at its ends explain. It is looked for where the
    result is to be finer than the mesh, at faces all of whose edges are longer than those aimed
    at: what others hide is smaller than the result's triangles, or noise.

    Parameters
    ----------
    mesh : TriMesh
        With all its feature edges, which are kept as they are.
    normals : (m, 3, 3) float array
        Unit normals at the corners of the faces.
    surfaces : sequence of ImplicitSurface, one per label
    length : float [unit of the points]
        Of the edges aimed at.

    Returns
    -------
    TriMesh
        The same object if nothing is hidden.
    """
    table = edge_table(mesh.faces)
    ends = mesh.points[table.edges]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    if lengths.mean() <= length:
        return mesh
    turn = np.linalg.norm(np.roll(normals, -1, axis=1) - normals, axis=2)
    turns = np.zeros(len(table.edges))
    np.maximum.at(turns, table.face_edges.ravel(), turn.ravel())
    coarse = lengths[table.face_edges].min(axis=1) > length
    gap = edge_gaps(mesh, surfaces, table, LONG * length, coarse)
    far = gap > np.maximum(HIDDEN * length, UNEXPLAINED * turns * lengths / 8.0)
    before = len(mesh.points)
    for _ in range(ROUNDS):
        far &= ~feature_mask(mesh, table)
        if not far.any():
            break
        known = len(mesh.points)
        mesh = on_surfaces(halved(mesh, table, far), surfaces, np.arange(known, known + far.sum()))
        table = edge_table(mesh.faces)
        near = (mesh.faces >= before).any(axis=1)
        far = edge_gaps(mesh, surfaces, table, REST * length, near) > HIDDEN * length
    return mesh


def edge_gaps(mesh, surfaces, table, least_edge=0.0, near=True):
    """Largest distance (e,) from its surface of an edge's points and of those in its faces.

    0 for edges no longer than `least_edge`, and away from the faces (m,) that are `near`. A face's
    points count for its longest edge.
    """
    corners = mesh.points[mesh.faces]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    per_face = np.zeros((len(mesh.faces), 3))
    for label in np.unique(mesh.face_labels):
        chosen = np.flatnonzero(
            (mesh.face_labels == label) & (lengths.max(axis=1) > least_edge) & near
        )
        own = corners[chosen]
        longest = lengths[chosen].argmax(axis=1)
        for weights in FACE_POINTS:
            gap = distance_from(surfaces[label], np.einsum("k,mkd->md", np.array(weights), own))
            np.maximum.at(per_face, (chosen, longest), gap)
        face, k = np.nonzero(lengths[chosen] > least_edge)
        starts, ends = own[face, k], own[face, (k + 1) % 3]
        for s in EDGE_POINTS:
            gap = distance_from(surfaces[label], (1.0 - s) * starts + s * ends)
            np.maximum.at(per_face, (chosen[face], k), gap)
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


def refined(mesh, longest, fix_boundary=False):
    """The mesh with its faces cut until no edge is longer; the same surface, and the same mesh if
    none is.

    Parameters
    ----------
    mesh : TriMesh
    longest : float [unit of the points]
    fix_boundary : bool
        Leave the edges of open boundaries as they are; their faces' others may be as long.
    """
    return refined_with(mesh, longest, fix_boundary, mesh.points)[0]


def refined_with(mesh, longest, fix_boundary, values):
    """See `refined`; also values (n, k) of the points, halfway between ends at the new ones."""
    for turn in range(MOST_HALVINGS):
        table = edge_table(mesh.faces)
        ends = mesh.points[table.edges]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        far = lengths > longest
        if fix_boundary and (table.count == 1).any():  # beside held edges it would not end
            far &= (table.count == 2) & (lengths > longest * SLACKER**turn)
        if not far.any() or len(mesh.faces) > MOST_FACES:
            break
        mesh = halved(mesh, table, far)
        values = np.concatenate([values, values[table.edges[far]].mean(axis=1)])
    return mesh, values


def halved_features(mesh, table, number):
    """The feature edges (k, 2) once edges (e,) have the new vertex `number` (-1: none) on them."""
    crease = feature_mask(mesh, table) if len(mesh.feature_edges) else np.zeros(len(number), bool)
    kept, cut = table.edges[crease & (number < 0)], np.flatnonzero(crease & (number >= 0))
    halves = [np.stack([table.edges[cut, k], number[cut]], axis=1) for k in (0, 1)]
    return np.concatenate([kept, *halves])


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
        points, np.concatenate(faces), np.concatenate(labels), mesh.labels,
        halved_features(mesh, table, number),
    )  # fmt: skip
