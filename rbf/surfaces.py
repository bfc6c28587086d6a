"""Implicit surfaces of a mesh: one for the whole, or one for each of its labels."""

from dataclasses import replace

import numpy as np

from meshes import InvalidCase, InvalidMesh, PlaneSurface
from rbf.hermite import fit_hermite
from rbf.normals import weighted_normals
from rbf.offsets import fit_offsets
from rbf.spacing import SUPPORT_PER_SPACING, check_finite, point_spacing
from rbf.subdivide import split_length, split_long_edges

FORMS = {"hermite": fit_hermite, "offsets": fit_offsets}


def fit_surface(mesh, support_radius=None, form="hermite", faces=None, **options):
    """Interpolate a mesh through its vertices; long edges are split first.

    Parameters
    ----------
    mesh : TriMesh
    support_radius : float, optional
        In the unit of the points. If not given: six spacings of the vertices (a robust edge
        length), more if edges are so long that splitting them would add too many points.
    form : {"hermite", "offsets"}
    faces : (k,) int or bool array, optional
        Interpolate these faces only, with normals of these faces only.
    **options
        For `fit_hermite` or `fit_offsets`.

    Returns
    -------
    HermiteInterpolant or OffsetInterpolant
        Its report counts the points that were added on edges longer than 3 spacings, which
        take the flat triangles' position and normal.

    Raises
    ------
    InvalidMesh
        If there are no faces, or none has a normal.
    InvalidCase, NotConverged
        See `fit_hermite`.
    """
    if form not in FORMS:
        raise InvalidCase(f"form must be one of {', '.join(FORMS)}, got {form!r}")
    points, triangles = _used_part(mesh, faces)
    spacing = point_spacing(points) if support_radius is None else None
    if support_radius is not None:
        longest, _ = split_length(points, triangles, support_radius / SUPPORT_PER_SPACING)
    else:
        longest, spacing = split_length(points, triangles, spacing)
        support_radius = SUPPORT_PER_SPACING * spacing
    normals = weighted_normals(points, triangles)
    fine, fine_faces, _ = split_long_edges(points, triangles, longest)
    added = len(fine) - len(points)
    if added:
        normals = np.concatenate([normals, weighted_normals(fine, fine_faces)[len(points) :]])
    good = np.isfinite(normals).all(axis=1)
    if not good.any():
        raise InvalidMesh("no vertex has a normal, because all faces are degenerate: repair them")
    surface = FORMS[form](fine[good], normals[good], support_radius=support_radius, **options)
    surface.report = replace(surface.report, added=added)
    return surface


def fit_surfaces(mesh, support_radius=None, form="hermite", **options):
    """One implicit surface for each label of a mesh.

    Planar labels get a `PlaneSurface`. A smooth label is interpolated through the vertices of its
    own faces, with normals of its own faces, so that a crease between labels is not rounded.

    Parameters
    ----------
    mesh : TriMesh
    support_radius, form, **options
        See `fit_surface`. If no radius is given, one is chosen for each label.

    Returns
    -------
    surfaces : tuple of ImplicitSurface or None
        In the order of `mesh.labels`; None for a smooth label without faces.

    Raises
    ------
    InvalidMesh, InvalidCase, NotConverged
        See `fit_surface`.
    """
    surfaces = []
    for index, label in enumerate(mesh.labels):
        chosen = mesh.face_labels == index
        if label.plane is not None:
            surfaces.append(PlaneSurface(label.plane))
        elif chosen.any():
            surfaces.append(fit_surface(mesh, support_radius, form, chosen, **options))
        else:
            surfaces.append(None)
    return tuple(surfaces)


def _used_part(mesh, faces):
    """Points and triangles of the chosen faces, with vertices renumbered."""
    triangles = mesh.faces if faces is None else mesh.faces[faces]
    if not len(triangles):
        raise InvalidMesh("a surface to interpolate must have faces, and there are none")
    used, index = np.unique(triangles, return_inverse=True)
    points = check_finite(mesh.points[used], "points")
    return points, index.reshape(-1, 3)
