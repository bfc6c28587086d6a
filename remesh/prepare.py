"""From the input and its surfaces to the carrier that vertices move on."""

from dataclasses import replace

import numpy as np

from meshes import PlaneSurface
from meshes.quality import normalised
from remesh.carrier import carrier_on, curves_of
from remesh.collapse import collapse_short_edges
from remesh.connectivity import HINT, INTERIOR, KIND, OFFSET, TWIN
from remesh.flip import DELAUNAY, flip_edges
from remesh.halfedge import WorkMesh
from remesh.layout import averaged, make_layout, row_normals
from remesh.shape_kernels import umbrella_step

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


def implicit_carrier(layout, surfaces, corner_angle):
    """Carrier whose vertices lie on implicit surfaces, with their exact normals.

    Parameters
    ----------
    layout : Layout
    surfaces : sequence of ImplicitSurface, one per label
    corner_angle : float [degrees]
    """
    mesh = layout.mesh
    held = np.zeros(len(mesh.points), bool)
    held[mesh.feature_edges] = True
    points = mesh.points.copy()
    normals = row_normals(layout)[layout.group]
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
    return carrier_on(replace(layout, mesh=mesh.with_points(points)), normals, corner_angle)


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
    layout = surface.carrier.layout
    averages = averaged(layout.group, surface.row_normals, NORMAL_ROUNDS)
    guard = averaged(layout.group, averages, GUARD_ROUNDS)[layout.group]
    curves = curves_of(layout, guard, corner_angle)
    work = WorkMesh(replace(surface.carrier, normals=guard, curves=curves))
    work.rows[: len(averages), OFFSET] = np.arange(len(averages))  # which row it was, from here on
    mean = float(layout.edge_lengths().mean())
    limits = (0.0, 0.0, GUARD_AGREEMENT)
    for _ in range(2):
        collapse_short_edges(work, fraction * mean, 3.0 * mean, 0.0, limits)
        work.compact()
        flip_edges(work, 0.0, limits, DELAUNAY, 4)
    mesh, bases = work.to_mesh()
    corners, _ = work.corner_rows()
    points = taubin(mesh, work.halves[: corners.size, TWIN], pairs, work.links[bases, KIND])
    layout = make_layout(mesh.with_points(points))
    order = layout.order
    averages = averages[work.rows[corners, OFFSET].astype(int)][order]
    normals = normalised((1.0 - blend) * row_normals(layout)[layout.group] + blend * averages)
    hints = work.links[corners[:, 0], HINT]
    return carrier_on(layout, normals, corner_angle), hints[order]


def taubin(mesh, twins, pairs, kinds):
    """Points (n, 3) after pairs of umbrella steps (Taubin 1995) on the vertices inside patches."""
    points = mesh.points.copy()
    free = kinds == INTERIOR
    total, degree = np.empty_like(points), np.empty(len(points))
    for _ in range(pairs):
        for factor in (TAUBIN_LAMBDA, TAUBIN_MU):
            umbrella_step(mesh.faces, twins, factor, free, points, total, degree)
    return points
