"""Needles and caps taken out of a raw isosurface, before it is smoothed and interpolated.

Marching tetrahedra leaves crossings arbitrarily close together: in the surface, along rims, and
along the curves on symmetry planes. Their edges are collapsed (on curves along the curve), and flat
triangles flipped away.
"""

from dataclasses import dataclass

import numpy as np

from isosurface.half_edge_kernels import CORNER, CURVE, FROZEN, INTERIOR, HalfEdges
from isosurface.normals import averaged_normals, worst_angle
from isosurface.sliver_kernels import Limits, collapse_sweep, flip_sweep
from isosurface.structure import surface_structure
from meshes import InvalidMesh, TriMesh
from meshes.curves import feature_mask, label_boundaries
from meshes.self_intersection import self_intersecting_faces

RAMP = 4  # sweeps in which the length below which edges are collapsed grows


@dataclass(frozen=True)
class RepairSettings:
    """When a triangle is a sliver.

    Parameters
    ----------
    short_edge : float
        Edges below this share of the edges around are collapsed.
    good_shape, bad_shape : float
        Shape of a triangle, 1 if equilateral and 0 without area: a collapse may leave no triangle
        that is worse than before and worse than `good_shape`; triangles worse than `bad_shape`
        are flipped.
    ear_shape : float
        A triangle between two edges of a curve is flipped if that leaves none worse than this.
    least_cosine : float
        A new triangle's normal must agree with the surface around by this cosine.
    sweeps : int
        Most rounds of collapses and flips.
    """

    short_edge: float = 0.4
    good_shape: float = 0.6
    bad_shape: float = 0.6
    ear_shape: float = 0.3
    least_cosine: float = 0.3
    sweeps: int = 20

    @property
    def limits(self):
        """The same for the kernels."""
        return Limits(*(getattr(self, name) for name in Limits._fields))


@dataclass(frozen=True)
class RepairReport:
    """What the repair did.

    Parameters
    ----------
    collapses, flips : int
        Operations done.
    min_angle_before, min_angle_after : float [degrees]
        Worst angle of the triangles.
    """

    collapses: int
    flips: int
    min_angle_before: float
    min_angle_after: float


def repair_slivers(surface, symmetry=(), settings=None):
    """Collapse short edges and flip flat triangles, as far as nothing else changes.

    Parameters
    ----------
    surface : TriMesh
        Manifold; open anywhere, and on symmetry planes if they are given.
    symmetry : sequence of SymmetryPlane
        Planes at which the surface will be mirrored.
    settings : RepairSettings, optional

    Returns
    -------
    surface : TriMesh
        Topology, labels, curves and corners are kept. Vertices of curves move along them, those of
        planar labels and symmetry planes within these, and no edge is made that would coincide
        with its own mirror image. Where faces would meet each other the surface is left as it is.
    report : RepairReport

    Raises
    ------
    InvalidMesh
        If an edge has more than two faces, or the two faces at an edge are not oriented alike.
    """
    settings = RepairSettings() if settings is None else settings
    structure = surface_structure(surface, symmetry)
    frozen = np.zeros(len(surface.points), dtype=bool)
    while True:
        mesh = half_edges(surface, structure)
        mesh.kind[frozen] = FROZEN
        collapses, flips = _sweep(mesh, settings)
        bad = _meeting(mesh)
        if not bad.any() or np.array_equal(frozen, frozen | bad):
            break
        frozen = _dilated(frozen | bad, structure.table.edges)
    repaired = _compact(surface, mesh)
    return repaired, RepairReport(collapses, flips, worst_angle(surface), worst_angle(repaired))


def _sweep(mesh, settings):
    """Collapse and flip in turn until nothing changes: numbers of collapses and flips."""
    collapses = flips = 0
    for sweep in range(settings.sweeps):
        ramp = min(1.0, (sweep + 1) / RAMP)  # the shortest edges first
        since = sweep - 1 if sweep >= RAMP else -1
        share = ramp * settings.short_edge
        collapsed = collapse_sweep(mesh, settings.limits, share, sweep, since)
        flipped = flip_sweep(mesh, settings.limits, sweep, since)
        collapses, flips = collapses + collapsed, flips + flipped
        if collapsed + flipped == 0 and sweep >= RAMP:
            break
    return collapses, flips


def _meeting(mesh):
    """Vertices (n,) bool of faces that meet other faces, and all that were merged into these."""
    faces = mesh.faces[mesh.alive]
    bad = np.zeros(len(mesh.points), dtype=bool)
    bad[faces[self_intersecting_faces(mesh.points, faces)]] = True
    root = mesh.merged
    while np.any(root != root[root]):
        root = root[root]
    return bad[root]


def _dilated(chosen, edges):
    """Chosen vertices (n,) bool and their neighbours."""
    result = chosen.copy()
    result[edges[chosen[edges].any(axis=1)]] = True
    return result


def half_edges(surface, structure):
    """The kernels' arrays of a surface."""
    table = structure.table
    if (table.count > 2).any():
        raise InvalidMesh(
            f"{np.count_nonzero(table.count > 2)} edges have more than two faces: "
            "slivers can only be repaired on a manifold surface"
        )
    faces = np.array(surface.faces)
    on_symmetry = structure.on_symmetry
    symmetry_count = on_symmetry.shape[1]
    planes = structure.on_plane @ (1 << np.arange(structure.on_plane.shape[1], dtype=np.int64))
    planar = [k for k, patch in enumerate(surface.labels) if patch.plane is not None]
    plane_of_label = np.full(len(surface.labels), -1)
    plane_of_label[planar] = np.arange(len(planar))
    curve = feature_mask(surface, table)
    out = np.zeros(len(surface.points), dtype=np.int64)
    out[faces.ravel()] = np.arange(faces.size)
    return HalfEdges(
        faces=faces,
        twin=_twins(faces, table),
        out=out,
        curve=curve[table.face_edges].ravel(),
        alive=np.ones(len(faces), dtype=bool),
        points=np.array(surface.points),
        kind=_kinds(table.edges[curve], on_symmetry),
        planes=planes.astype(np.int64),
        symmetry=((1 << symmetry_count) - 1) << len(planar),
        face_plane=plane_of_label[surface.face_labels],
        plane_normals=structure.normals,
        normals=averaged_normals(surface, structure),
        size=_sizes(surface, structure),
        changed=np.zeros(len(surface.points), dtype=np.int64),
        merged=np.arange(len(surface.points)),
    )


def _twins(faces, table):
    """The half-edge on the other side of each half-edge (3 m,), -1 where there is none."""
    twin = np.full(faces.size, -1, dtype=np.int64)
    pair = table.start[:-1][table.count == 2]
    first, second = table.half_edges[pair], table.half_edges[pair + 1]
    twin[first], twin[second] = second, first
    flat = faces.ravel()
    if (flat[first] == flat[second]).any():
        raise InvalidMesh("faces of different orientation lie side by side: orient them alike")
    return twin


def _kinds(curve_edges, on_symmetry):
    """INTERIOR, CURVE or CORNER for every vertex (n,); a corner too where symmetry planes meet."""
    degree = np.bincount(curve_edges.ravel(), minlength=len(on_symmetry))
    corner = (degree != 2) | (on_symmetry.sum(axis=1) > 1)
    return np.where(degree == 0, INTERIOR, np.where(corner, CORNER, CURVE))


def _sizes(surface, structure, rounds=5):
    """Mean edge length around every vertex (n,), averaged over the neighbours."""
    edges = structure.table.edges
    length = np.linalg.norm(surface.points[edges[:, 0]] - surface.points[edges[:, 1]], axis=1)
    count = len(surface.points)
    valence = np.maximum(np.bincount(edges.ravel(), minlength=count), 1)
    size = np.bincount(edges.ravel(), np.repeat(length, 2), minlength=count) / valence
    ends = np.concatenate([edges[:, 0], edges[:, 1]])
    others = np.concatenate([edges[:, 1], edges[:, 0]])
    for _ in range(rounds):
        size = 0.5 * (size + np.bincount(ends, size[others], minlength=count) / valence)
    return size


def _compact(surface, mesh):
    """The TriMesh of the faces that are left."""
    faces = mesh.faces[mesh.alive]
    used, index = np.unique(faces, return_inverse=True)
    faces = index.reshape(-1, 3)
    labels = surface.face_labels[mesh.alive]
    curves = mesh.curve.reshape(-1, 3)[mesh.alive]
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)[curves]
    repaired = TriMesh(mesh.points[used], faces, labels, surface.labels)
    edges = np.concatenate([edges, label_boundaries(repaired)])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    return TriMesh(repaired.points, faces, labels, surface.labels, edges)
