"""Long edges split, so that the points of a coarse surface lie close enough for one support."""

import numpy as np

LARGEST_GROWTH = 4.0  # times as many vertices as the mesh has, or LEAST_GROWTH
LEAST_GROWTH = 20_000
MOST_ROUNDS = 40


def mesh_edges(faces):
    """Distinct edges (k, 2) of triangles, and the edge opposite each corner: (m, 3) indices."""
    ends = np.sort(faces[:, [1, 2, 2, 0, 0, 1]].reshape(-1, 2), axis=1).astype(np.int64)
    key = ends[:, 0] << 32 | ends[:, 1]
    unique, index = np.unique(key, return_inverse=True)
    edges = np.stack([unique >> 32, unique & 0xFFFFFFFF], axis=1)
    return edges, index.reshape(-1, 3)


def edge_lengths(points, faces):
    """Lengths (k,) of the distinct edges of triangles."""
    edges, _ = mesh_edges(faces)
    return np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)


def split_long_edges(points, faces, longest):
    """Split edges at their midpoints until none is longer than `longest`.

    Parameters
    ----------
    points : (n, 3) float array
    faces : (m, 3) int array
    longest : float

    Returns
    -------
    points, faces : arrays
        The given points come first. All triangles keep their plane.
    parent : (k,) int array
        The given face each new face is part of.
    """
    parent = np.arange(len(faces))
    for _round in range(MOST_ROUNDS):
        edges, edge_of = mesh_edges(faces)
        length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        split = length > longest
        if not split.any():
            break
        middle = np.full(len(edges), -1)
        middle[split] = len(points) + np.arange(split.sum())
        points = np.concatenate([points, points[edges[split]].mean(axis=1)])
        faces, origin = _split_faces(faces, middle[edge_of], length[edge_of])
        parent = parent[origin]
    return points, faces, parent


def _split_faces(faces, middle, length):
    """Cut faces (m, 3) at the midpoints opposite their corners (m, 3; -1: none)."""
    # turn each face so that its longest split edge is opposite corner 0
    first = np.where(middle >= 0, length, -1.0).argmax(axis=1)
    turn = (first[:, None] + np.arange(3)) % 3
    (a, b, c), (ma, mb, mc) = (np.take_along_axis(x, turn, axis=1).T for x in (faces, middle))
    has_b, has_c = mb >= 0, mc >= 0
    pieces, origin = [], []

    def add(where, *corners):
        pieces.append(np.stack([corner[where] for corner in corners], axis=1))
        origin.append(np.flatnonzero(where))

    add(ma < 0, a, b, c)
    cut = ma >= 0
    # every cut face is halved from corner a to the middle of b c; then each half where needed
    add(cut & ~has_c, a, b, ma)
    add(cut & has_c, a, mc, ma)
    add(cut & has_c, mc, b, ma)
    add(cut & ~has_b, a, ma, c)
    add(cut & has_b, a, ma, mb)
    add(cut & has_b, mb, ma, c)
    return np.concatenate(pieces), np.concatenate(origin)


def split_length(points, faces, spacing, per_spacing=3.0):
    """The longest edge allowed for a spacing, and the spacing, both enlarged where needed.

    A few tiny triangles next to huge ones would ask for endless points; the spacing is enlarged
    until splitting adds at most four times the vertices (or 20,000).

    Returns
    -------
    longest, spacing : float
    """
    corners = points[faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    allowed = max(LARGEST_GROWTH * len(points), LEAST_GROWTH)
    while _added_points(sides, per_spacing * spacing) > allowed:
        spacing *= 1.25
    return per_spacing * spacing, spacing


def _added_points(sides, longest):
    """About how many points a split adds to triangles with sides (m, 3)."""
    parts = np.ceil(np.maximum(sides / longest, 1.0))
    order = np.sort(parts, axis=1)
    return float(0.5 * (order[:, 2] * order[:, 1] - 1.0).sum())
