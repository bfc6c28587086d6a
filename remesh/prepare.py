"""From the input and its surfaces to the carrier that vertices move on."""

import numpy as np
from scipy.sparse import coo_matrix

from meshes import PlaneSurface
from meshes.quality import corner_normals, normalised
from meshes.topology import edge_table, feature_mask
from remesh.carrier import make_carrier
from remesh.collapse import collapse_short_edges
from remesh.connectivity import HINT, INTERIOR, KIND, OFFSET, ORIGIN, ROWS
from remesh.flip import DELAUNAY, flip_edges
from remesh.halfedge import WorkMesh
from remesh.triangle_surface import averaged, sectors

TAUBIN_LAMBDA, TAUBIN_MU = 0.4, -0.42
GUARD_AGREEMENT = 0.3
NORMAL_ROUNDS, GUARD_ROUNDS = 1, 2


def surfaces_by_label(mesh, surfaces):
    """One surface per label: those given, or the single one given and planes for planar labels."""
    if isinstance(surfaces, (list, tuple)):
        if len(surfaces) == 1 and len(mesh.labels) > 1:
            return surfaces_by_label(mesh, surfaces[0])
        if len(surfaces) != len(mesh.labels):
            raise ValueError(
                f"{len(mesh.labels)} labels need as many surfaces, got {len(surfaces)}"
            )
        return tuple(surfaces)
    return tuple(
        surfaces if patch.plane is None else PlaneSurface(patch.plane) for patch in mesh.labels
    )


def implicit_carrier(mesh, surfaces, corner_angle):
    """Carrier whose vertices lie on implicit surfaces, with their exact normals.

    Parameters
    ----------
    mesh : TriMesh
    surfaces : sequence of ImplicitSurface, one per label
    corner_angle : float [degrees]
    """
    table = edge_table(mesh.faces)
    mask = feature_mask(mesh, table)
    held = np.zeros(len(mesh.points), bool)
    held[table.edges[mask]] = True
    points = mesh.points.copy()
    normals = corner_normals(mesh)
    for label, patch in enumerate(mesh.labels):
        faces = mesh.faces[mesh.face_labels == label]
        if patch.plane is not None or len(faces) == 0:
            continue
        vertices = np.unique(faces)
        inside = vertices[~held[vertices]]
        moved, _ = surfaces[label].project(points[inside])
        known = np.isfinite(moved).all(axis=1)
        points[inside[known]] = moved[known]
        gradient = np.full_like(points, np.nan)
        gradient[vertices] = surfaces[label].gradient(points[vertices])
        exact = normalised(gradient)[faces]
        usual = normals[mesh.face_labels == label]
        agree = np.einsum("mkd,mkd->mk", exact, usual) > 0.0
        normals[mesh.face_labels == label] = np.where(agree[..., None], exact, usual)
    return make_carrier(mesh.with_points(points), normals, corner_angle)


def smoothed_carrier(surface, pairs, fraction, blend, corner_angle):
    """A sliver-free, slightly smoothed copy of a jagged surface.

    Edges shorter than `fraction` of the mean are collapsed, guarded by averaged normals, and the
    rest flipped for angles; then come pairs of Taubin smoothing. Vertices on features stay.

    Parameters
    ----------
    surface : TriangleSurface
    pairs : int
    fraction : float
    blend : float
        Share of the surface's own (averaged) normals in the carrier's normals.
    corner_angle : float [degrees]

    Returns
    -------
    carrier : Carrier
    hints : (m,) int array
        For each of its triangles one of the surface nearby.
    """
    source = surface.carrier.mesh
    group, count = sectors(source)
    averages = averaged(surface.carrier.normals, group, count, NORMAL_ROUNDS)
    guarded = make_carrier(source, averaged(averages, group, count, GUARD_ROUNDS), corner_angle)
    work = WorkMesh(guarded)
    of_row = np.empty((int(work.counts[ROWS]), 3))
    of_row[work.halves[: source.faces.size, ORIGIN]] = averages.reshape(-1, 3)
    work.rows[: len(of_row), OFFSET] = np.arange(len(of_row))  # which row it was, from here on
    mean = input_edge_length(source)
    limits = (0.0, 0.0, GUARD_AGREEMENT)
    for _ in range(2):
        collapse_short_edges(work, fraction * mean, 3.0 * mean, 0.0, limits)
        work.compact()
        flip_edges(work, 0.0, limits, DELAUNAY, 4)
    mesh, bases = work.to_mesh()
    corners, _ = work.corner_rows()
    face_hints = work.links[corners[:, 0], HINT]
    free = work.links[bases, KIND] == INTERIOR
    smooth = mesh.with_points(taubin(mesh, pairs, free))
    averages = of_row[work.rows[corners, OFFSET].astype(int)]
    normals = normalised((1.0 - blend) * corner_normals(smooth) + blend * averages)
    carrier = make_carrier(smooth, normals, corner_angle)
    return carrier, face_hints[carrier.order]


def taubin(mesh, pairs, free):
    """Points (n, 3) after pairs of umbrella steps (Taubin 1995) on the free vertices."""
    edges = edge_table(mesh.faces).edges
    ends = np.concatenate([edges, edges[:, ::-1]])
    count = len(mesh.points)
    degree = np.bincount(ends[:, 0], minlength=count)
    mean = coo_matrix((1.0 / degree[ends[:, 0]], (ends[:, 0], ends[:, 1])), (count, count)).tocsr()
    points = mesh.points.copy()
    for _ in range(pairs):
        for factor in (TAUBIN_LAMBDA, TAUBIN_MU):
            points[free] += factor * (mean @ points - points)[free]
    return points


def input_edge_length(mesh):
    """Mean edge length of a mesh."""
    edges = edge_table(mesh.faces).edges
    return float(np.linalg.norm(mesh.points[edges[:, 0]] - mesh.points[edges[:, 1]], axis=1).mean())
