"""Faces of a surface that meet where they should not.

Two faces may share a vertex or an edge, by number; whatever else they have in common is an
intersection: crossing, touching, overlapping in a plane, folding back onto a neighbour, or being
the same face twice. Decided exactly for the given coordinates (`meshes.predicates`), so that a
touch is a touch and a gap of one rounding is a gap. Faces without area (collinear corners) are
left out: `meshes.quality.degenerate_faces` counts them.
"""

import numpy as np

from meshes.box_tree import build_tree, in_chunks
from meshes.errors import InvalidMesh
from meshes.self_intersection_kernels import STACK, find_axes, mark_meeting
from meshes.topology import check_indices

FINEST = 300  # coordinates are multiples of 2**-FINEST of the largest


def self_intersecting_faces(points, faces):
    """Mark the faces that meet another face elsewhere than in common vertices or edges.

    Parameters
    ----------
    points : (n, 3) float array
    faces : (m, 3) int array

    Returns
    -------
    (m,) bool array

    Raises
    ------
    InvalidMesh
        If points of faces are missing, NaN or infinite.
    """
    points = np.ascontiguousarray(points, dtype=float)
    faces = np.asarray(faces).reshape(-1, 3)
    check_indices(faces, len(points))
    if len(faces) == 0:
        return np.zeros(0, dtype=bool)
    if not np.isfinite(points[faces]).all():
        raise InvalidMesh("the surface has points with NaN or infinite coordinates")
    points = normalised_coordinates(np.where(np.isfinite(points), points, 0.0))
    tree = build_tree(points, faces)
    ordered = np.ascontiguousarray(faces[tree.order], dtype=np.int64)
    corners = points[ordered]
    boxes = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
    axes = np.empty(len(faces), dtype=np.int64)
    find_axes(points, ordered, axes)
    layout = (tree.boxes, tree.begin, tree.end, tree.leaves)

    def work(first, last):
        marked = np.zeros(len(faces), dtype=bool)
        nodes, room = np.empty(STACK, dtype=np.int32), np.empty((2, 3), dtype=np.int64)
        mark_meeting(points, ordered, axes, boxes, layout, first, last, nodes, room, marked)
        return marked

    result = np.empty(len(faces), dtype=bool)
    result[tree.order] = np.logical_or.reduce(in_chunks(work, len(faces)))
    return result


def normalised_coordinates(points):
    """Points scaled by a power of two to at most 1, and rounded to multiples of 2**-FINEST.

    Changes nothing but coordinates below 1e-74 of the largest, and keeps every product of three
    of them, and its rounding error, far from underflow.
    """
    largest = np.abs(points).max(initial=0.0)
    if largest == 0.0:
        return points
    scaled = np.ldexp(points, -np.frexp(largest)[1])
    tiny = np.abs(scaled) < 2.0 ** (53 - FINEST)
    scaled[tiny] = np.ldexp(np.rint(np.ldexp(scaled[tiny], FINEST)), -FINEST)
    return scaled
