"""Where a mesh should be fine: edge lengths that follow the interface of a coarse design.

Tets are spent where phi changes. Edges are short in the tets that the coarse design's interface
crosses, and grow with the distance from those: the state of the void, and of the inside of thick
members, varies slowly. They are half as long at the edges of rigid supports: those hold nodes, and
so end where the mesh has some (on the table 2 % of the compliance).
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from meshes.errors import InvalidCase
from meshes.tet_mesh import TetMesh
from topopt.parameters import LOCAL_EDGES

CROSSED = 0.02  # a tet is of the interface if phi leaves [0, CROSSED] and [1 - CROSSED, 1] in it
GROWTH = 0.5  # of the edge length, per distance from the interface
COARSEST = 4.0  # longest edge, in units of the shortest
AT_SUPPORTS = 0.5  # edge length at the edges of supports, in units of that at the interface
SHORTER = 0.92  # what pytetwild is asked for where a uniform mesh would be asked for 1: measured


@dataclass(frozen=True, eq=False)
class Sizing:
    """Edge lengths wanted, given at the nodes of a background mesh.

    Parameters
    ----------
    mesh : TetMesh
        Of the domain to be meshed.
    edge_lengths : (n,) float array [m]
        Positive.

    Raises
    ------
    InvalidCase
    """

    mesh: TetMesh
    edge_lengths: np.ndarray

    def __post_init__(self):
        lengths = np.array(self.edge_lengths, dtype=float)
        if lengths.shape != (len(self.mesh.points),) or not (0 < lengths.min() < np.inf):
            raise InvalidCase("a sizing needs one positive edge length for each node of its mesh.")
        lengths.flags.writeable = False
        object.__setattr__(self, "edge_lengths", lengths)


def interface_sizing(design, edge_length):
    """The edge lengths that resolve a coarse design's interface.

    Parameters
    ----------
    design : PhaseField
        On a mesh of about twice the edge length.
    edge_length : float [m]
        In the tets that the interface crosses, so in about two of its own to either side: as it
        would be given for a uniform mesh.

    Returns
    -------
    Sizing
        On the design's mesh.
    """
    edge_length *= SHORTER
    lengths = np.full(len(design.values), COARSEST * edge_length)
    places = {1.0: interface_nodes(design), AT_SUPPORTS: support_edges(design.mesh)}
    for share, nodes in places.items():
        growing = share * edge_length + GROWTH * distance_along_edges(design.mesh, nodes)
        lengths = np.minimum(lengths, growing)
    return Sizing(design.mesh, lengths)


def interface_nodes(design):
    """Which nodes (n,) belong to a tet in which phi is neither 0 nor 1 throughout."""
    corners = design.values[design.mesh.tets]
    crossed = (corners.max(axis=1) > CROSSED) & (corners.min(axis=1) < 1.0 - CROSSED)
    nodes = np.zeros(len(design.values), dtype=bool)
    nodes[design.mesh.tets[crossed]] = True
    return nodes


def support_edges(mesh):
    """Which nodes (n,) belong to a boundary facet that a support covers but does not hold whole."""
    found = np.zeros(len(mesh.points), dtype=bool)
    for name, nodes in mesh.node_sets.items():
        held = np.zeros(len(mesh.points), dtype=bool)
        held[nodes] = True
        covered = mesh.facets[mesh.facet_sets.get(name, [])]
        found[covered[~held[covered].all(axis=1)]] = True
    return found


def distance_along_edges(mesh, nodes):
    """Length (n,) [m] of the shortest path along edges to one of `nodes` (n,) bool; inf if none."""
    if not nodes.any():
        return np.full(len(nodes), np.inf)
    pairs = np.concatenate([mesh.tets[:, pair] for pair in LOCAL_EDGES])
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    lengths = np.linalg.norm(mesh.points[pairs[:, 0]] - mesh.points[pairs[:, 1]], axis=1)
    graph = coo_matrix((lengths, pairs.T), (len(nodes), len(nodes))).tocsr()
    return dijkstra(graph, directed=False, indices=np.flatnonzero(nodes), min_only=True)
