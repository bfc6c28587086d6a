"""The tetrahedral mesh of a design domain with its named boundary."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from meshes.arrays import frozen
from meshes.patch import Patch, SymmetryPlane

# Faces of a positively oriented tetrahedron, each seen counter-clockwise from outside.
TET_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]], dtype=np.int32)


@dataclass(frozen=True, eq=False)
class TetMesh:
    """Tetrahedra, boundary facets, and the sets by which later stages know loads and supports.

    Parameters
    ----------
    points : (n, 3) float array [m]
    tets : (m, 4) int32 array
        Positively oriented: det(p1 - p0, p2 - p0, p3 - p0) > 0.
    facets : (b, 3) int32 array
        The boundary triangles, oriented outward.
    facet_patch : (b,) int32 array
        Index into `patches` of each boundary facet.
    patches : tuple of Patch
        The pieces of the domain's boundary (a box has "x-", "x+", ... "z+").
    facet_sets : mapping of str to (k,) int32 array
        Boundary facets by name, as indices into `facets`: "load:<name>", "support:<name>".
        A facet belongs to a load or support set if it overlaps its region with positive area.
    node_sets : mapping of str to (k,) int32 array
        Nodes by name ("support:<name>": the nodes that are held).
    symmetry : tuple of SymmetryPlane
        The planes about which the modelled part is mirrored; the facets on them are no
        boundary of the part.
    """

    points: np.ndarray
    tets: np.ndarray
    facets: np.ndarray
    facet_patch: np.ndarray
    patches: tuple[Patch, ...]
    facet_sets: Mapping[str, np.ndarray] = field(default_factory=dict)
    node_sets: Mapping[str, np.ndarray] = field(default_factory=dict)
    symmetry: tuple[SymmetryPlane, ...] = ()

    def __post_init__(self):
        put = object.__setattr__
        put(self, "points", frozen(self.points, np.float64, (None, 3), "points"))
        put(self, "tets", frozen(self.tets, np.int32, (None, 4), "tets"))
        put(self, "facets", frozen(self.facets, np.int32, (None, 3), "facets"))
        put(self, "facet_patch", frozen(self.facet_patch, np.int32, (len(self.facets),), "patches"))
        put(self, "patches", tuple(self.patches))
        put(self, "symmetry", tuple(self.symmetry))
        for name in ("facet_sets", "node_sets"):
            sets = {
                key: frozen(value, np.int32, (None,), f"{name}[{key!r}]")
                for key, value in getattr(self, name).items()
            }
            put(self, name, MappingProxyType(sets))

    def with_sets(self, facet_sets=None, node_sets=None, symmetry=None):
        """Return the same mesh with other named sets (those not given are kept)."""
        return replace(
            self,
            facet_sets=self.facet_sets if facet_sets is None else facet_sets,
            node_sets=self.node_sets if node_sets is None else node_sets,
            symmetry=self.symmetry if symmetry is None else symmetry,
        )


def tet_volumes(points, tets):
    """Signed volumes (m,) [m^3] of tetrahedra; positive if positively oriented."""
    a, b, c, d = (points[tets[:, k]] for k in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0


def boundary_facets(tets):
    """Return the triangles (b, 3) that belong to one tetrahedron only, oriented outward."""
    facets = tets[:, TET_FACES].reshape(-1, 3)
    low, middle, high = np.sort(facets, axis=1).astype(np.int64).T
    size = int(tets.max(initial=0)) + 1
    pair = np.unique(low * size + middle, return_inverse=True)[1]  # one number, however many nodes
    _, first, count = np.unique(pair * size + high, return_index=True, return_counts=True)
    return facets[np.sort(first[count == 1])]
