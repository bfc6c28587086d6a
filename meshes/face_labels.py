"""Labels of foreign files: numbers or names of faces that say which part they belong to."""

import re

import numpy as np

from meshes.patch import Patch

NAMES = frozenset(
    ("label", "region", "material", "part", "patch", "segment", "group", "object", "block",
     "surface", "solid", "zone", "domain", "boundary")
)  # fmt: skip
MOST = 1024  # more labels, and more than half as many as faces, are no labels but face numbers


def is_label_name(name):
    """Whether a face array of this name holds labels: "label", "RegionId", "material_index" ..."""
    word = re.sub(r"[^a-z]", "", name.lower())
    word = re.sub(r"^(face|cell)", "", word)
    return re.sub(r"(ids?|index|indices|number|s)$", "", word) in NAMES


def numbered_labels(values):
    """Labels and their numbers (m,) for whole numbers (m,) of the faces.

    The number of a label is its value where that is possible (no negative and no huge ones).

    Returns
    -------
    (tuple of Patch, (m,) int array) or None
        None if the values are no labels: not whole, all the same, or as many as faces.
    """
    values = np.asarray(values)
    if values.ndim != 1 or len(values) == 0 or not np.all(np.abs(values) < 2.0**53):
        return None
    whole = values.astype(np.int64)
    distinct, index = np.unique(whole, return_inverse=True)
    if np.any(whole != values) or not _plausible(len(distinct), len(values)):
        return None
    if distinct[0] >= 0 and distinct[-1] < MOST:
        return tuple(Patch(str(k)) for k in range(distinct[-1] + 1)), whole
    return tuple(Patch(str(value)) for value in distinct), index.ravel()


def named_labels(names, index):
    """Labels and their numbers (m,) for names and the name of each face (m,).

    Returns
    -------
    (tuple of Patch, (m,) int array) or None
    """
    used, number = np.unique(np.asarray(index, dtype=np.int64), return_inverse=True)
    if not _plausible(len(used), len(number)):
        return None
    return tuple(Patch(names[k]) for k in used), number.ravel()


def _plausible(count, faces):
    return count > 1 and (count <= MOST or 2 * count <= faces) and (count < faces or faces < 8)
