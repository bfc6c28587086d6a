"""Creases, corners and patches of surfaces that come without labels.

Edges whose faces turn by more than an angle are candidates. On a CAD surface they form nets of
curves that hardly ever end; on a scan or a jagged isosurface they are scattered bits with ends
everywhere. So a candidate counts as a crease only

1. if the connected net of candidates it belongs to has at most one loose end for every
   `EDGES_PER_END` edges (an end on an open boundary is not loose); where most candidates fail
   this, in `NOISY_NETS` nets or more, also if its net is larger than all those that failed,
2. and if that net is no speck: fewer than `SPECK_EDGES` edges in the middle of a smooth patch,
   unless it bounds planar patches as a box or a prism does.

Loose spurs shorter than `SPUR_EDGES` edges are cut off the rest. A crease that ends inside a patch
is a feature edge, but separates nothing.
"""

import numpy as np

from meshes.patch import Patch, Plane
from meshes.quality import area_vectors, normalised
from meshes.topology import angle_between, components, edge_table, feature_mask
from meshes.tri_mesh import TriMesh

EDGES_PER_END = 15
NOISY_NETS = 10
SPECK_EDGES = 20
SPECK_RATIO = 10  # faces around a speck for every face inside
SPUR_EDGES = 3
BOX_PATCHES = 3  # planar patches with at least two faces each that make no speck
PLANAR = 1e-5  # of the diagonal: how far vertices of a planar patch may lie off


def find_features(mesh, angle=40.0):
    """Find feature edges and label the patches between them.

    Parameters
    ----------
    mesh : TriMesh
        Label boundaries, feature edges and open boundaries it already has are kept.
    angle : float [degrees]
        How far the normals turn across a crease at least.

    Returns
    -------
    TriMesh
        The same points and faces; one label per set of faces connected without crossing a
        feature edge, with its plane if all its vertices lie on one.
    """
    table = edge_table(mesh.faces)
    given = feature_mask(mesh, table)
    crease = _candidates(mesh, table, np.radians(angle)) & ~given
    crease = _connected_nets(crease, given, table.edges, len(mesh.points))
    crease = _without_spurs(crease, given, table.edges, len(mesh.points))
    label = _patches(table, given | crease, len(mesh.faces))
    crease = _without_specks(mesh, crease, given, table, label)
    feature = given | crease
    label = _patches(table, feature, len(mesh.faces))
    return TriMesh(mesh.points, mesh.faces, label, _named(mesh, label), table.edges[feature])


def _candidates(mesh, table, angle):
    """Edges (e,) bool between two faces with areas whose normals differ by more than `angle`."""
    inner, pairs = table.face_pairs()
    vectors = area_vectors(mesh.points, mesh.faces)
    solid = np.any(vectors != 0, axis=1)[pairs].all(axis=1)
    sharp = np.zeros(len(table.edges), dtype=bool)
    sharp[inner] = solid & (angle_between(*np.moveaxis(vectors[pairs], 1, 0)) > angle)
    return sharp


def _connected_nets(crease, given, edges, n_points):
    """The creases whose net has few loose ends."""
    chosen = edges[crease]
    _, net = components(chosen[:, 0], chosen[:, 1], n_points)
    loose = _loose_ends(crease, given, edges, n_points)
    ends = np.bincount(net, loose, minlength=n_points)
    size = np.bincount(net[chosen[:, 0]], minlength=n_points)
    clean = EDGES_PER_END * ends <= size
    failed = size[~clean]
    if len(failed) >= NOISY_NETS and 2 * failed.sum() > size.sum():
        clean &= size > failed.max()
    kept = crease.copy()
    kept[crease] = clean[net[chosen[:, 0]]]
    return kept


def _loose_ends(crease, given, edges, n_points):
    """Vertices (n,) bool where one crease and no given feature edge ends."""
    degree = np.bincount(edges[crease].ravel(), minlength=n_points)
    anchored = np.bincount(edges[given].ravel(), minlength=n_points) > 0
    return (degree == 1) & ~anchored


def _without_spurs(crease, given, edges, n_points):
    """The creases without loose branches of fewer than SPUR_EDGES edges."""
    trimmed = crease.copy()
    for _ in range(SPUR_EDGES - 1):
        loose = _loose_ends(trimmed, given, edges, n_points)
        trimmed &= ~loose[edges].any(axis=1)
    # What was cut from the end of a long branch grows back.
    for _ in range(SPUR_EDGES - 1):
        loose = _loose_ends(trimmed, given, edges, n_points)
        trimmed |= crease & loose[edges].any(axis=1)
    return trimmed


def _patches(table, feature, n_faces):
    """Number (m,) the sets of faces connected across edges that are no features."""
    inner, pairs = table.face_pairs()
    pairs = pairs[~feature[inner]]
    _, label = components(pairs[:, 0], pairs[:, 1], n_faces)
    return label


def _without_specks(mesh, crease, given, table, label):
    """The creases without small nets in the middle of a smooth patch."""
    edges = table.edges
    touched = crease | given
    chosen = edges[touched]
    _, net = components(chosen[:, 0], chosen[:, 1], len(mesh.points))
    size = np.bincount(net[chosen[:, 0]], minlength=len(mesh.points))
    small = np.flatnonzero((size > 0) & (size < SPECK_EDGES))
    if len(small) == 0:
        return crease
    inner, pairs = table.face_pairs()
    members_of = _Patches(mesh, label)
    kept = crease.copy()
    net_of_edge = np.where(touched, net[edges[:, 0]], -1)
    pair_of_edge = np.full((len(edges), 2), -1)
    pair_of_edge[inner] = pairs
    order = np.argsort(net_of_edge, kind="stable")
    ordered = net_of_edge[order]
    for number in small:
        members = order[slice(*np.searchsorted(ordered, [number, number + 1]))]
        sides = np.unique(label[pair_of_edge[members][pair_of_edge[members] >= 0]])
        if members_of.speck(sides):
            kept[members] = False
    return kept & crease


class _Patches:
    """The faces of every patch, and the planes of those that are asked for."""

    def __init__(self, mesh, label):
        self.mesh = mesh
        self.size = np.bincount(label)
        self._order = np.argsort(label, kind="stable")
        self._start = np.concatenate([[0], np.cumsum(self.size)])
        self._planes = {}

    def plane(self, patch):
        """The plane of a patch, or None."""
        if patch not in self._planes:
            chosen = self._order[self._start[patch] : self._start[patch + 1]]
            self._planes[patch] = _plane(self.mesh, chosen)
        return self._planes[patch]

    def speck(self, sides):
        """Whether the patches `sides` around a small net are one large one and specks in it."""
        if len(sides) == 0:
            return False
        largest = sides[np.argmax(self.size[sides])]
        inside = sides[sides != largest]
        if self.size[largest] <= SPECK_RATIO * (self.size[inside].sum() + 1):
            return False
        flat = sum(self.size[patch] > 1 and self.plane(patch) is not None for patch in inside)
        return flat < max(BOX_PATCHES, len(inside))


def _named(mesh, label):
    """A Patch for every label, planar ones with their plane."""
    patches = _Patches(mesh, label)
    return tuple(Patch(f"patch {k}", patches.plane(k)) for k in range(len(patches.size)))


def _plane(mesh, chosen):
    """The plane on which all vertices of the chosen faces lie, or None."""
    faces = mesh.faces[chosen]
    points = mesh.points[np.unique(faces)]
    normal = normalised(area_vectors(mesh.points, faces).sum(axis=0))
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    extent = np.linalg.norm(np.ptp(points, axis=0))
    distance = (points - middle) @ normal
    allowed = min(PLANAR * mesh.diagonal, 1e-3 * extent)
    if not np.any(normal) or np.ptp(distance) > 2.0 * allowed:
        return None
    axis = np.rint(normal) + 0.0  # planes across an axis can be met exactly, so they are preferred
    if np.abs(axis).sum() == 1.0 and np.ptp(points @ axis) <= 2.0 * allowed:
        normal, distance = axis, (points - middle) @ axis
    offset = float(middle @ normal + 0.5 * (distance.min() + distance.max()))
    return Plane(tuple(float(x) for x in normal), offset)
