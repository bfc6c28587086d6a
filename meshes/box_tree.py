"""A tree of bounding boxes over triangles: finds what is near in whatever shape of mesh."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np

from meshes.box_tree_kernels import fill_boxes, split_nodes

LEAF_SIZE = 4


@dataclass(frozen=True, eq=False)
class BoxTree:
    """See `meshes.box_tree_kernels` for the layout.

    Parameters
    ----------
    boxes : (nodes, 6) float64 array
    begin, end : (nodes,) int32 array
    order : (m,) int32 array
    leaves : int
    """

    boxes: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    order: np.ndarray
    leaves: int


def build_tree(points, faces, leaf_size=LEAF_SIZE):
    """Return the BoxTree over faces (m, 3), m > 0, with at most `leaf_size` faces a leaf."""
    corners = points[faces]
    face_boxes = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
    centres = np.ascontiguousarray(0.5 * (face_boxes[:, :3] + face_boxes[:, 3:]).T)
    leaves = 1
    while leaves * leaf_size < len(faces):
        leaves *= 2
    order = np.arange(len(faces), dtype=np.int32)
    begin, end = (np.empty(2 * leaves - 1, dtype=np.int32) for _ in range(2))
    boxes = np.empty((2 * leaves - 1, 6))
    split_nodes(centres, leaves, order, begin, end)
    fill_boxes(face_boxes, order, begin, end, leaves, boxes)
    return BoxTree(boxes, begin, end, order, leaves)


def in_chunks(work, count, least=4096):
    """Call work(first, last) over ranges that cover 0 ... count, on as many threads as numba has.

    `work` must release the GIL and write only to its own range; then the result does not depend
    on the number of threads. Returns the results in order.
    """
    threads = min(numba.get_num_threads(), count // least) if count >= 2 * least else 1
    if threads == 1:
        return [work(0, count)]
    bounds = [count * k // threads for k in range(threads + 1)]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, bounds[:-1], bounds[1:]))
