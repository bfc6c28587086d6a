"""Pieces of the solid that carry nothing, and cavities that nothing can leave."""

from dataclasses import dataclass

import numpy as np

from isosurface.clipping_tables import TET_EDGES
from isosurface.solid_volume import solid_volumes
from isosurface.symmetry import snapped_to_symmetry
from meshes import InvalidMesh, PhaseField
from meshes.edges import components
from meshes.tet_mesh import tet_volumes


@dataclass(frozen=True)
class IslandReport:
    """What was found in the solid {phi >= level} of the modelled part.

    Parameters
    ----------
    components : int
        Connected pieces of the solid before islands are dropped.
    island_volumes : tuple of float [m^3]
        Volume of every piece that was dropped, largest first.
    cavity_volumes : tuple of float [m^3]
        Volume of every closed cavity of the solid that is left; they are not filled.
    """

    components: int
    island_volumes: tuple[float, ...]
    cavity_volumes: tuple[float, ...]

    @property
    def islands(self):
        """Number of pieces that were dropped."""
        return len(self.island_volumes)

    @property
    def cavities(self):
        """Number of closed cavities."""
        return len(self.cavity_volumes)


def drop_islands(field, level=0.5):
    """Lower the field below the level in pieces of the solid that touch no load or no support.

    Parameters
    ----------
    field : PhaseField
        Loads and supports are the facet and node sets "load:*" and "support:*" of its mesh (a knife
        edge or a point holds nodes, but has no facet). If the mesh has no set of a kind, that kind
        is not asked for; a symmetry plane is neither.
    level : float

    Returns
    -------
    field : PhaseField
        Unchanged except at the nodes of islands: mirrored at the level, so just below it. No edge
        joins two pieces, so the surface of the others stays as it is, bit for bit.
    report : IslandReport

    Raises
    ------
    InvalidMesh
        If no piece of the solid touches both a load and a support.
    """
    mesh = field.mesh
    inside = field.values >= level
    count, piece = _pieces(mesh.tets, inside)
    kept = np.ones(count, dtype=bool)
    for kind in ("load:", "support:"):
        kept &= _touched(mesh, piece, count, kind)
    if count and not kept.any():
        raise InvalidMesh(
            f"none of the {count} pieces of the solid joins a load to a support: the design is not "
            "connected; use a finer mesh, more iterations or a larger volume fraction"
        )
    dropped = np.append(~kept, False)[piece]
    volumes = solid_volumes(field, level)
    values = np.where(dropped, _lowered(field.values, level), field.values)
    cleaned = PhaseField(mesh, values)
    report = IslandReport(
        components=count,
        island_volumes=_descending(_volumes(mesh.tets, piece, count, volumes)[~kept]),
        cavity_volumes=_cavity_volumes(cleaned, level),
    )
    return cleaned, report


def _pieces(tets, chosen):
    """Connect chosen nodes along edges: number of pieces, piece (n,) of each node or -1."""
    edges = tets[:, TET_EDGES].reshape(-1, 2)
    edges = edges[chosen[edges].all(axis=1)]
    _, label = components(edges[:, 0], edges[:, 1], len(chosen))
    names, number = np.unique(label[chosen], return_inverse=True)
    piece = np.full(len(chosen), -1)
    piece[chosen] = number
    return len(names), piece


def _touched(mesh, piece, count, kind):
    """Pieces (count,) bool with a node in some set of the kind, or on a facet of one; all pieces if
    there is no such set."""
    facets = [mesh.facets[of] for name, of in mesh.facet_sets.items() if name.startswith(kind)]
    nodes = [of for name, of in mesh.node_sets.items() if name.startswith(kind)]
    if not facets and not nodes:
        return np.ones(count, dtype=bool)
    found = piece[np.concatenate([of.ravel() for of in (*facets, *nodes)])]
    touched = np.zeros(count, dtype=bool)
    touched[found[found >= 0]] = True
    return touched


def _lowered(values, level):
    """Values mirrored at the level, below it and not below the field's least value or zero."""
    mirrored = np.maximum(2.0 * level - values, min(0.0, values.min()))
    return np.minimum(mirrored, np.nextafter(level, -np.inf))


def _volumes(tets, piece, count, volumes):
    """Sum of tetrahedral volumes (m,) over the pieces (all nodes of a tet in a piece share it)."""
    of_tet = piece[tets].max(axis=1)
    return np.bincount(of_tet[of_tet >= 0], volumes[of_tet >= 0], minlength=count)


def _cavity_volumes(field, level):
    """Volumes of the void's pieces that do not reach the domain's boundary (symmetry aside)."""
    mesh = field.mesh
    count, piece = _pieces(mesh.tets, field.values < level)
    _, on_symmetry = snapped_to_symmetry(mesh)
    outer = piece[mesh.facets[~on_symmetry]]
    closed = np.ones(count, dtype=bool)
    closed[outer[outer >= 0]] = False
    void = tet_volumes(mesh.points, mesh.tets) - solid_volumes(field, level)
    return _descending(_volumes(mesh.tets, piece, count, void)[closed])


def _descending(values):
    """Values as a tuple of floats, largest first."""
    return tuple(sorted(values.tolist(), reverse=True))
