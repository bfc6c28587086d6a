"""Marching tetrahedra with caps: the boundary of {phi >= level} in the domain.

Every vertex belongs to one edge of the tetrahedral mesh (or, inside a cap, to one node), and every
face to one tetrahedron or one boundary facet. So the surface is closed (but for the symmetry
planes, where the mirrored half follows), 2-manifold and free of intersections by construction.
"""

import numpy as np

from isosurface.clipping_tables import (
    FACET_QUADS,
    FACET_TRIANGLES,
    TET_EDGES,
    TET_QUADS,
    TET_TRIANGLES,
)
from isosurface.crossing import angle_fits, edge_crossings
from isosurface.newton import newton_vertices
from isosurface.spreading import check_spread, spread_crossings
from isosurface.structure import ISOSURFACE
from isosurface.symmetry import snapped_to_symmetry
from meshes import InvalidCase, InvalidMesh, TriMesh
from meshes.curves import label_boundaries
from meshes.self_intersection import self_intersecting_faces


def extract_surface(field, level=0.5, crossing="quadratic", clearance=0.01, spread=0.0):
    """Return the surface of the modelled part {phi >= level}, with caps, oriented outward.

    Parameters
    ----------
    field : PhaseField
    level : float
        A node exactly at the level is inside.
    crossing : "linear", "sine", "quadratic" or "newton"
        How the field runs along an edge, see `edge_crossings`; "newton" goes on from quadratic
        crossings, off their edges (see `newton`; it excludes spreading).
    clearance : float
        Share of an edge that a crossing stays away from its ends.
    spread : float
        Share of an edge by which crossings slide within the surface, away from its ends (see
        `spreading`); 0 leaves them on their edges.

    Returns
    -------
    TriMesh
        Faces carry the label "isosurface" or the domain's patch that they are a part of (caps).
        Facets on symmetry planes give no faces: there the surface is open. Feature edges are the
        label boundaries and the open boundary.

    Raises
    ------
    InvalidCase
        If the crossing, clearance or spread is none that there is.
    InvalidMesh
        If the field is not finite or nowhere reaches the level, or a symmetry plane has no facets.

    Notes
    -----
    Thesis section 2.2.6, which has no caps.
    """
    check_spread(spread)
    newton = crossing == "newton"
    if newton and spread > 0.0:
        raise InvalidCase("crossing newton moves vertices off their edges: spread must be 0")
    mesh = field.mesh
    inside = _inside_nodes(field, level)
    points, on_symmetry = snapped_to_symmetry(mesh)
    edges, cut_tets, tet_vertices = _cut_edges(mesh.tets, inside)
    kept = np.flatnonzero(~on_symmetry)
    facets = mesh.facets[kept]
    nodes, items = _facet_items(facets, inside, edges, len(points))
    fits = angle_fits(field, edges, level) if spread > 0.0 else None
    t = edge_crossings(field, edges, level, "quadratic" if newton else crossing, clearance, fits)
    # An edge within a plane x = c stays in it exactly: c + t * 0.
    crossings = points[edges[:, 0]] + t[:, None] * (points[edges[:, 1]] - points[edges[:, 0]])
    tet_pattern = inside[mesh.tets[cut_tets]] @ [1, 2, 4, 8]
    facet_pattern = inside[facets] @ [1, 2, 4]

    def build(vertices):
        surface, _ = _polygons(vertices, tet_vertices, tet_pattern, TET_TRIANGLES, TET_QUADS)
        caps, row = _polygons(vertices, items, facet_pattern, FACET_TRIANGLES, FACET_QUADS)
        labels = np.concatenate([np.zeros(len(surface), int), 1 + mesh.facet_patch[kept][row]])
        return np.concatenate([surface, caps]), labels

    vertices = np.concatenate([crossings, points[nodes]])
    if spread > 0.0:
        moved = spread_crossings(field, edges, t, spread, fits)
        vertices = _without_meeting_faces(vertices, moved, build)
    if newton:
        moved = newton_vertices(field, edges, crossings, level)
        vertices = _without_meeting_faces(vertices, moved, build)
    return labelled_surface(vertices, *build(vertices), (ISOSURFACE, *mesh.patches))


def _without_meeting_faces(vertices, moved, build):
    """Vertices (n, 3), the first of them moved, but not those whose faces would meet others."""
    result = np.array(vertices)
    result[: len(moved)] = moved
    while True:
        faces, _ = build(result)
        bad = np.unique(faces[self_intersecting_faces(result, faces)])
        bad = bad[(result[bad] != vertices[bad]).any(axis=1)]
        if not len(bad):
            return result
        result[bad] = vertices[bad]


def labelled_surface(points, faces, face_labels, labels):
    """A TriMesh with the labels that occur, and its label boundaries as feature edges."""
    used, face_labels = np.unique(face_labels, return_inverse=True)
    labels = tuple(labels[k] for k in used)
    mesh = TriMesh(points, faces, face_labels.reshape(-1), labels)
    return TriMesh(points, faces, face_labels.reshape(-1), labels, label_boundaries(mesh))


def _inside_nodes(field, level):
    """Nodes (n,) bool at or above the level."""
    bad = int(np.count_nonzero(~np.isfinite(field.values)))
    if bad:
        raise InvalidMesh(f"the phase field is not finite at {bad} nodes: no surface can be found")
    inside = field.values >= level
    if not inside.any():
        raise InvalidMesh(
            f"the phase field nowhere reaches {level:g} (largest value {field.values.max():g}): "
            "there is no solid; lower the level or raise the volume fraction"
        )
    return inside


def _cut_edges(tets, inside):
    """Edges with one end inside: (k, 2), and for each cut tet its number and six edge ids."""
    count = inside[tets].sum(axis=1)
    cut_tets = np.flatnonzero((count > 0) & (count < 4))
    ends = np.sort(tets[cut_tets][:, TET_EDGES], axis=2).astype(np.int64)
    cut = inside[ends[..., 0]] != inside[ends[..., 1]]
    key = ends[..., 0] * len(inside) + ends[..., 1]
    unique, index = np.unique(key[cut], return_inverse=True)
    tet_vertices = np.full(cut.shape, -1)
    tet_vertices[cut] = index.reshape(-1)
    return np.stack(np.divmod(unique, len(inside)), axis=1), cut_tets, tet_vertices


def _facet_items(facets, inside, edges, n_points):
    """Nodes that become vertices (c,), and the six items (b, 6) of every facet as vertex ids."""
    nodes = np.unique(facets[inside[facets]])
    vertex_of_node = np.full(n_points, -1)
    vertex_of_node[nodes] = len(edges) + np.arange(len(nodes))
    ends = np.sort(facets[:, [[0, 1], [1, 2], [2, 0]]], axis=2).astype(np.int64)
    cut = inside[ends[..., 0]] != inside[ends[..., 1]]
    key = edges[:, 0] * n_points + edges[:, 1]
    wanted = (ends[..., 0] * n_points + ends[..., 1])[cut]
    edge_items = np.full(cut.shape, -1)
    edge_items[cut] = np.searchsorted(key, wanted)
    return nodes, np.concatenate([vertex_of_node[facets], edge_items], axis=1)


def _polygons(points, items, pattern, triangles, quads):
    """Faces (m, 3) that the tables give for rows of items (b, i), and the row of each face."""
    rows = np.flatnonzero(triangles[pattern, 0] >= 0)
    faces = np.take_along_axis(items[rows], triangles[pattern[rows]], axis=1)
    quad_rows = np.flatnonzero(quads[pattern, 0] >= 0)
    corners = np.take_along_axis(items[quad_rows], quads[pattern[quad_rows]], axis=1)
    split = _split_quads(points, corners)
    return np.concatenate([faces, split]), np.concatenate([rows, np.repeat(quad_rows, 2)])


def _split_quads(points, quads):
    """Triangles (2 q, 3) of convex quads (q, 4), cut along the diagonal of the better shapes.

    Where both diagonals are equally good the one at the smallest vertex number is taken.
    """
    lowest = quads.argmin(axis=1)[:, None]
    turned = np.take_along_axis(quads, (lowest + np.arange(4)) % 4, axis=1)
    first = turned[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 2, 3)
    second = turned[:, [1, 2, 3, 1, 3, 0]].reshape(-1, 2, 3)
    worst_first, worst_second = (
        _shape(points, pair.reshape(-1, 3)).reshape(-1, 2).min(axis=1) for pair in (first, second)
    )
    better = worst_second > worst_first * (1.0 + 1e-9)
    return np.where(better[:, None, None], second, first).reshape(-1, 3)


def _shape(points, faces):
    """Area over the sum of the squared edges (m,): the larger, the better shaped."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return twice_area / sum(((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a)))
