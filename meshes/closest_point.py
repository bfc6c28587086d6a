"""The closest point of a triangulation, and how far two surfaces lie apart."""

import numpy as np

from meshes.box_tree import build_tree, in_chunks
from meshes.closest_point_kernels import STACK, closest_points
from meshes.errors import InvalidMesh
from meshes.quality import face_areas
from meshes.topology import check_indices, edge_table


class ClosestPoint:
    """Finds the closest points of a triangulation.

    Parameters
    ----------
    points : (n, 3) float array
    faces : (m, 3) int array
        At least one; they need not be manifold, and may have no area.

    Raises
    ------
    InvalidMesh
        If there are no faces, or points of faces are missing, NaN or infinite.

    Notes
    -----
    A balanced tree of boxes: nothing is assumed about the sizes of triangles or of the domain.
    The kernels can be called from other kernels: see `tree`, `neighbours` and
    `meshes.closest_point_kernels`, which number the triangles as `order` says.
    """

    def __init__(self, points, faces):
        points = np.ascontiguousarray(points, dtype=float)
        faces = np.asarray(faces)
        if len(faces) == 0:
            raise InvalidMesh("a surface without faces has no closest point")
        check_indices(faces, len(points))
        if not np.isfinite(points[faces]).all():
            raise InvalidMesh("the surface has points with NaN or infinite coordinates")
        tree = build_tree(points, faces)
        self.order = tree.order
        self.position = np.empty_like(tree.order)
        self.position[tree.order] = np.arange(len(faces), dtype=np.int32)
        a, b, c = (points[faces[tree.order, k]] for k in range(3))
        triangles = np.concatenate([a, b - a, c - a, np.cross(b - a, c - a)], axis=1)
        self.tree = (tree.boxes, tree.begin, tree.end, triangles, tree.leaves)
        self.neighbours = self._neighbours(faces)

    def _neighbours(self, faces):
        """Neighbours (m, 3) across the edges, -1 where there is not just one; in tree order."""
        table = edge_table(faces)
        inner, pairs = table.face_pairs()
        total = np.full(len(table.edges), -1)
        total[inner] = pairs.sum(axis=1)
        other = total[table.face_edges] - np.arange(len(faces))[:, None]
        other = np.where(total[table.face_edges] >= 0, self.position[other], -1)
        return np.ascontiguousarray(other[self.order], dtype=np.int32)

    def query(self, points, hints=None):
        """Find the closest points of the surface to points (n, 3).

        Parameters
        ----------
        points : (n, 3) float array
        hints : (n,) int array, optional
            Faces near the points (-1: none known). They make it faster; which of several equally
            near faces is returned may depend on them.

        Returns
        -------
        faces : (n,) int32 array
            -1 for points with NaN or infinite coordinates.
        barycentric : (n, 3) float array
            Weights of the face's three corners (NaN for such points).
        distance : (n,) float array
        """
        points = np.ascontiguousarray(points, dtype=float).reshape(-1, 3)
        found = np.full(len(points), -1, dtype=np.int32)
        result = np.full((len(points), 3), np.nan)
        if hints is None:
            start = found
        else:
            hints = np.asarray(hints)
            start = np.where(hints >= 0, self.position[hints], -1).astype(np.int32)

        def work(first, last):
            nodes, squares = np.empty(STACK, dtype=np.int32), np.empty(STACK)
            closest_points(
                points,
                start,
                first,
                last,
                self.tree,
                self.neighbours,
                nodes,
                squares,
                found,
                result,
            )

        in_chunks(work, len(points))
        lost = found < 0
        result[lost] = np.nan
        v, w, square = result.T
        faces = np.where(lost, -1, self.order[found]).astype(np.int32)
        return faces, np.stack([1.0 - v - w, v, w], axis=1), np.sqrt(square)


def sample_surface(points, faces, count, rng):
    """Random points (count, 3) of a surface, evenly by area, and the faces they lie on.

    Stratified: one point in each of `count` equal shares of the area in the order of the faces.

    Parameters
    ----------
    rng : numpy.random.Generator
    """
    total = np.cumsum(face_areas(points, faces))
    place = (np.arange(count) + rng.random(count)) / count * total[-1]
    chosen = np.minimum(np.searchsorted(total, place, side="right"), len(faces) - 1)
    root, share = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1.0 - root, root * (1.0 - share), root * share], axis=1)
    return np.einsum("ij,ijk->ik", weights, points[faces[chosen]]), chosen


def two_sided_distance(a, b, samples=100_000, seed=0):
    """Distance between two surfaces, in the unit of their points.

    Parameters
    ----------
    a, b : TriMesh
    samples : int
        Random points on each surface.
    seed : int

    Returns
    -------
    rms : float
        Root mean square of the distances of all samples from the other surface.
    largest : float
        The largest distance, of samples and vertices.
    """
    rng = np.random.default_rng(seed)
    squares, largest = [], 0.0
    for here, there in ((a, b), (b, a)):
        search = ClosestPoint(there.points, there.faces)
        sampled, _ = sample_surface(here.points, here.faces, samples, rng)
        distance = search.query(sampled)[2]
        at_vertices = search.query(here.points[np.unique(here.faces)])[2]
        squares.append(np.mean(distance**2))
        largest = max(largest, float(distance.max()), float(at_vertices.max()))
    return float(np.sqrt(np.mean(squares))), largest
