"""How far two surfaces lie apart at most: proved for every point, not sampled."""

from dataclasses import dataclass

import numpy as np

from meshes.box_tree import in_chunks
from meshes.closest_point import ClosestPoint
from meshes.closest_point_kernels import STACK
from meshes.distance_bound_kernels import MOST_WAITING, bound_faces
from meshes.quality import face_normals

BLOCK = 32  # faces that are searched from the one before; the next block begins anew
SHARP = 0.97  # of the largest distance at vertices and centroids: bounds below need not be sharp


@dataclass(frozen=True, eq=False)
class FaceBounds:
    """Bounds for every face of a surface.

    Parameters
    ----------
    upper, lower : (m,) float arrays
        The largest distance of the face's points from the other surface lies between the two;
        `lower` is 0 where nothing had to be found out about it.
    angle : (m,) float array [degrees]
        Every point of the face has a point of the other surface within the limit whose normal
        differs by no more.
    place : (m, 3) float array
        A point of the face at least as far away as `lower` says; where that is below the floor,
        one where the angle is largest.
    """

    upper: np.ndarray
    lower: np.ndarray
    angle: np.ndarray
    place: np.ndarray


def face_bounds(mesh, search, limit=np.inf, floor=0.0, angle=90.0, chosen=None):
    """Bound the distance of every face of a mesh from another surface.

    Parameters
    ----------
    mesh : TriMesh
    search : ClosestPoint
        Of the other surface.
    limit : float [unit of the points]
        How far a point with a similar normal may be looked for.
    floor : float [unit of the points]
        Upper bounds below need not be sharp.
    angle : float [degrees]
        Normals that differ by less are similar enough: bounds below need not be sharp.
    chosen : (k,) int array, optional
        Faces to bound; all if not given.

    Returns
    -------
    FaceBounds
        Of the chosen faces.

    Notes
    -----
    Convexity of the distance from a triangle, and branch and bound: see the kernels. Exact but for
    rounding; upper and lower bound differ by 1 % where `upper` exceeds `floor`, unless a face
    would have to be cut into thousands of pieces.
    """
    faces = mesh.faces if chosen is None else mesh.faces[chosen]
    corners = np.ascontiguousarray(mesh.points[faces].reshape(-1, 9))
    normals = np.ascontiguousarray(face_normals(mesh.points, faces))
    limits = (float(floor), float(min(limit, 1e150)), float(np.cos(np.radians(angle))))
    bounds, places = np.zeros((len(corners), 3)), np.zeros((len(corners), 3))

    def work(first, last):
        nodes, squares = np.empty(STACK, dtype=np.int32), np.empty(STACK + 6)
        pieces = np.empty((MOST_WAITING + 4, 10))
        bound_faces(
            corners, normals, first * BLOCK, min(last * BLOCK, len(corners)), BLOCK, search.tree,
            search.neighbours, limits, nodes, squares, pieces, bounds, places,
        )  # fmt: skip

    in_chunks(work, -(-len(corners) // BLOCK), least=8)
    cosine = np.clip(bounds[:, 2], -1.0, 1.0)
    return FaceBounds(bounds[:, 0], bounds[:, 1], np.degrees(np.arccos(cosine)), places)


def largest_at_vertices(mesh, search):
    """Largest distance of a mesh's vertices and centroids from a surface: a lower bound."""
    points = np.concatenate([mesh.points, mesh.points[mesh.faces].mean(axis=1)])
    return float(search.query(points)[2].max())


def distance_bounds(a, b, limit=np.inf, angle=90.0):
    """Bounds for the faces of a from b, and of b from a, sharp where they are largest.

    Parameters
    ----------
    a, b : TriMesh
    limit, angle : float
        See `face_bounds`.

    Returns
    -------
    of_a, of_b : FaceBounds
        The largest of both `upper` bounds the Hausdorff distance of the two surfaces.
    """
    search = [ClosestPoint(mesh.points, mesh.faces) for mesh in (a, b)]
    floor = SHARP * max(largest_at_vertices(a, search[1]), largest_at_vertices(b, search[0]))
    return (
        face_bounds(a, search[1], limit, floor, angle),
        face_bounds(b, search[0], limit, floor, angle),
    )
