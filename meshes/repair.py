"""Surfaces of others made proper: welded, cut, oriented and closed, and all of it counted."""

from dataclasses import asdict, dataclass, field

import numpy as np

from meshes.edges import check_indices, edge_table
from meshes.errors import InvalidMesh
from meshes.repair_crossings import separate
from meshes.repair_cut import cut
from meshes.repair_flat import flat_faces, remove_flat
from meshes.repair_holes import close_cracks, fill_holes
from meshes.repair_orient import orient_alike, orient_outward
from meshes.repair_union import overlapping_pieces, unite
from meshes.repair_weld import drop_pillows, drop_repeated, weld_equal, weld_near
from meshes.self_intersection import self_intersecting_faces
from meshes.soup import naming_a_vertex_twice, soup_of
from meshes.topology import topology
from meshes.tri_mesh import TriMesh


def _count(words):
    return field(default=0, metadata={"words": words})


@dataclass(frozen=True)
class RepairReport:
    """How often each kind of damage was found and mended; the last two could not be.

    Parameters
    ----------
    welded_vertices, welded_near : int
        Vertices of open edges that lay exactly, and nearly, on another one.
    collapsed_faces, repeated_faces, flat_faces : int
        Faces dropped or flipped away: a vertex twice, those of another face, no area.
    cut_edges, cut_vertices : int
        Edges with more than two faces, and vertices with separate fans, at which it was cut.
    dangling_faces : int
        Faces dropped that hung on such an edge.
    turned_faces, turned_pieces : int
        Faces oriented unlike their neighbours, and closed pieces that were inside out.
    closed_cracks, filled_holes : int
        Holes without area, and those that were to be filled.
    separated_faces : int
        Faces that crossed others, and were drawn apart.
    united_pieces : int
        Closed pieces that overlapped others, and became one with them.
    crossed_faces : int
        Faces that crossed others at first.
    holes, crossing_faces : int
        What is left: holes, and faces that cross others.
    """

    welded_vertices: int = _count("coincident vertices of open edges welded")
    welded_near: int = _count("nearly coincident vertices of open edges welded")
    collapsed_faces: int = _count("faces that named a vertex twice dropped")
    repeated_faces: int = _count("repeated faces dropped")
    flat_faces: int = _count("faces without area taken out")
    cut_edges: int = _count("edges with more than two faces cut")
    cut_vertices: int = _count("vertices where separate fans of faces met cut")
    dangling_faces: int = _count("faces that hung on such edges dropped")
    turned_faces: int = _count("faces turned to agree with their neighbours")
    turned_pieces: int = _count("closed pieces turned, for they were inside out")
    closed_cracks: int = _count("cracks closed")
    filled_holes: int = _count("holes filled")
    separated_faces: int = _count("faces that crossed others drawn apart")
    united_pieces: int = _count("overlapping closed pieces united")
    crossed_faces: int = 0
    holes: int = 0
    crossing_faces: int = 0

    def as_dict(self):
        """The counts by name."""
        return asdict(self)

    def lines(self):
        """What was mended: a few words each, and how often; empty if nothing was."""
        return [
            f"{entry.metadata['words']}: {getattr(self, name):,}"
            for name, entry in self.__dataclass_fields__.items()
            if "words" in entry.metadata and getattr(self, name)
        ]


def repair(mesh, fill=0.0, crossings=True, hold_boundary=False):
    """Make an oriented manifold of a surface, whatever is wrong with it.

    Parameters
    ----------
    mesh : TriMesh
    fill : float
        Holes up to this size are filled, in bounding-box diagonals; cracks (holes without area)
        always are.
    crossings : bool
        Whether faces that cross others are looked for, and drawn apart where smoothing does it;
        closed pieces that overlap are united.
    hold_boundary : bool
        Whether vertices of open edges stay where they are in that.

    Returns
    -------
    mesh : TriMesh
        The very same object if nothing was wrong. Labels are kept, and feature edges whose
        vertices are still there.
    report : RepairReport

    Raises
    ------
    InvalidMesh
        With counts, if there are no faces, or none with an area; if points of faces are missing,
        NaN or infinite; or if the surface has only one side.

    Notes
    -----
    Thesis appendix 5.1 names the problem. Vertices are welded on open edges only, so that sheets
    that touch stay apart; where more than two faces meet at an edge they are joined pairwise
    (`meshes.repair_cut`).
    """
    _check(mesh)
    counts = {}
    if fill > 0.0 or not _is_proper(mesh):
        soup = _cleaned(soup_of(mesh), counts)
        names = soup.origin
        soup = _oriented(soup, counts)
        if fill > 0.0:
            soup, counts["filled_holes"] = fill_holes(soup, fill * _diagonal(soup))
        if any(counts.values()):
            mesh = _finished(mesh, soup, names)
    if crossings:
        mesh = _uncrossed(mesh, counts, hold_boundary)
    return mesh, RepairReport(**counts, holes=_holes(mesh))


def _check(mesh):
    """Refuse what cannot be repaired."""
    check_indices(mesh.faces, len(mesh.points))
    if len(mesh.faces) == 0:
        raise InvalidMesh("the surface has no faces")
    bad = int((~np.isfinite(mesh.points[mesh.faces]).all(axis=(1, 2))).sum())
    if bad:
        raise InvalidMesh(
            f"{bad} of {len(mesh.faces)} faces have points with NaN or infinite coordinates: "
            "remove or replace these points"
        )


def _is_proper(mesh):
    """Whether a surface is closed, and nothing is to be mended but crossings."""
    found = topology(mesh.faces, len(mesh.points))
    if not (found.manifold and found.oriented and found.watertight) or found.duplicate_faces:
        return False
    if flat_faces(mesh.points, mesh.faces).any():
        return False
    return orient_outward(soup_of(mesh))[1] == 0


def _cleaned(soup, counts):
    """Welded, and without faces that are none."""
    before = len(soup.faces)
    soup = soup.keep(~naming_a_vertex_twice(soup.faces))
    soup, counts["welded_vertices"] = weld_equal(soup)
    soup, counts["welded_near"] = weld_near(soup)
    counts["collapsed_faces"] = before - len(soup.faces)
    soup, counts["repeated_faces"] = drop_repeated(soup)
    return _some(soup)


def _some(soup):
    """The same, unless nothing is left of it."""
    if len(soup.faces) == 0:
        raise InvalidMesh("the surface has no face with an area")
    return soup


def _oriented(soup, counts):
    """Manifold and oriented, cracks closed, flat faces gone, normals outside."""
    soup = orient_alike(soup, strict=False)
    soup, counts["cut_edges"], counts["cut_vertices"], counts["dangling_faces"] = cut(soup)
    soup = orient_alike(soup)
    counts["turned_faces"] = int(soup.turned.sum())
    soup, counts["closed_cracks"] = close_cracks(soup)
    soup, counts["flat_faces"], left = remove_flat(soup)
    if left:
        soup = soup.keep(~flat_faces(soup.points, soup.faces))
        counts["flat_faces"] += left
    if counts["flat_faces"]:
        soup, *_ = cut(_some(soup))  # what it left may touch in a vertex only
    soup, pillows = drop_pillows(soup)
    counts["repeated_faces"] += pillows
    soup, counts["turned_pieces"] = orient_outward(_some(soup))
    return soup


def _diagonal(soup):
    return float(np.linalg.norm(np.ptp(soup.points[soup.faces].reshape(-1, 3), axis=0)))


def _finished(mesh, soup, names):
    """The TriMesh of what is left, without unused vertices.

    Parameters
    ----------
    mesh : TriMesh
        The input.
    soup : Soup
    names : (n,) int array
        The name that each vertex of the input has in `soup.origin`.
    """
    used, index = np.unique(soup.faces, return_inverse=True)
    faces = index.reshape(-1, 3)
    edges = edge_table(faces).edges
    wanted = {tuple(sorted(pair)) for pair in names[mesh.feature_edges].tolist()}
    if wanted:
        pairs = np.sort(soup.origin[used][edges], axis=1).tolist()
        edges = edges[[tuple(pair) in wanted for pair in pairs]]
    else:
        edges = edges[:0]
    return TriMesh(soup.points[used], faces, soup.labels, mesh.labels, edges)


def _uncrossed(mesh, counts, hold_boundary):
    """With overlapping pieces united, and other faces that cross drawn apart."""
    crossing = self_intersecting_faces(mesh.points, mesh.faces)
    counts["crossed_faces"] = int(crossing.sum())
    if counts["crossed_faces"] == 0:
        return mesh
    mesh, counts["united_pieces"] = unite(mesh, crossing)
    if counts["united_pieces"]:
        crossing = self_intersecting_faces(mesh.points, mesh.faces)
    held = _held(mesh, crossing, hold_boundary)
    points, before, after = separate(mesh.points, mesh.faces, crossing, held)
    counts["separated_faces"], counts["crossing_faces"] = before - after, after
    return mesh if points is mesh.points else mesh.with_points(points)


def _held(mesh, crossing, hold_boundary):
    """Vertices (n,) that must not be smoothed: of features, planes and pieces that overlap."""
    held = np.zeros(len(mesh.points), dtype=bool)
    held[mesh.feature_edges] = True
    if hold_boundary:
        table = edge_table(mesh.faces)
        held[table.edges[table.count == 1]] = True
    planar = np.array([patch.plane is not None for patch in mesh.labels])
    piece, overlapping = overlapping_pieces(mesh, crossing)
    held[mesh.faces[planar[mesh.face_labels] | np.isin(piece, overlapping)]] = True
    return held


def _holes(mesh):
    return topology(mesh.faces, len(mesh.points)).boundary_loops
