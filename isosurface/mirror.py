"""The whole part from the modelled part: reflected at the symmetry planes and welded there."""

import numpy as np

from isosurface.marching_tets import labelled_surface
from isosurface.symmetry import on_symmetry_planes
from meshes import InvalidMesh, Patch, Plane, TriMesh
from meshes.edges import edge_table


def mirror(surface, symmetry):
    """Reflect a surface at its symmetry planes, one after the other.

    Parameters
    ----------
    surface : TriMesh
        On one side of each plane, and open there.
    symmetry : sequence of SymmetryPlane

    Returns
    -------
    TriMesh
        Vertices of the open boundary on a plane are set exactly onto it and shared by both halves;
        all others have an image that differs in one coordinate alone (exactly, for planes through
        the origin). Smooth labels, and planar ones that their own reflection continues, are
        shared; other planar ones get an image named like "x+|x=0". Feature edges are the label
        boundaries, open edges, and the input's own that do not lie on a plane.

    Raises
    ------
    InvalidMesh
        If vertices lie beyond a plane, or an edge within a plane has two faces, so that the two
        halves would overlap.
    """
    for plane in symmetry:
        surface = _mirror_once(surface, plane)
    return surface


def _mirror_once(surface, plane):
    """Reflect at one plane."""
    table = edge_table(surface.faces)
    on = _welded(surface, plane, table)
    points = np.array(surface.points)
    points[on, plane.axis] = plane.offset
    moved = np.flatnonzero(~on)
    image = np.arange(len(points))
    image[moved] = len(points) + np.arange(len(moved))
    labels, image_label = _mirrored_labels(surface.labels, plane)
    whole = labelled_surface(
        np.concatenate([points, plane.reflect(points[moved])]),
        np.concatenate([surface.faces, image[surface.faces[:, ::-1]]]),
        np.concatenate([surface.face_labels, image_label[surface.face_labels]]),
        labels,
    )
    inner = surface.feature_edges[~on[surface.feature_edges].all(axis=1)]
    edges = np.concatenate([whole.feature_edges, inner, image[inner]])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    return TriMesh(whole.points, whole.faces, whole.face_labels, whole.labels, edges)


def _welded(surface, plane, table):
    """Vertices (n,) bool of the open boundary that lie on the plane."""
    on = on_symmetry_planes(surface.points, (plane,))[:, 0]
    within = on[table.edges].all(axis=1)
    double = int(np.count_nonzero(within & (table.count > 1)))
    if double:
        raise InvalidMesh(
            f"{double} edges lie within the symmetry plane {plane.name} but are not open: "
            "the two halves would share them; extract the surface open on that plane"
        )
    side = surface.points[:, plane.axis] - plane.offset
    beyond = min(np.count_nonzero(~on & (side > 0)), np.count_nonzero(~on & (side < 0)))
    if beyond:
        raise InvalidMesh(
            f"{beyond} vertices lie beyond the symmetry plane {plane.name}: "
            "the two halves would overlap; mirror a surface that stays on one side"
        )
    welded = np.zeros(len(on), dtype=bool)
    welded[table.edges[within].ravel()] = True
    return welded


def _mirrored_labels(labels, plane):
    """Labels with the images that are new, and the label (l,) of every label's image."""
    labels = list(labels)
    image = np.arange(len(labels))
    for k, patch in enumerate(tuple(labels)):
        if patch.plane is not None and patch.plane.normal[plane.axis] != 0.0:
            image[k] = len(labels)
            labels.append(Patch(f"{patch.name}|{plane.name}", _mirrored_plane(patch.plane, plane)))
    return tuple(labels), image


def _mirrored_plane(cap, plane):
    """The reflection of a cap's plane (normal stays outward)."""
    normal = list(cap.normal)
    normal[plane.axis] = -normal[plane.axis]
    return Plane(tuple(normal), cap.offset - 2.0 * plane.offset * cap.normal[plane.axis])
