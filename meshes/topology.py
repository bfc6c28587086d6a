"""What kind of surface it is: watertight, manifold, oriented, its loops and handles.

The edge table and the feature curves are to be had from here too.
"""

from dataclasses import dataclass

import numpy as np

from meshes.curves import angle_between, feature_corners, feature_mask, label_boundaries
from meshes.edges import (
    EdgeTable,
    check_indices,
    components,
    corner_groups,
    edge_table,
    face_components,
)
from meshes.errors import InvalidMesh

__all__ = [
    "EdgeTable",
    "Topology",
    "angle_between",
    "boundary_edges",
    "boundary_loops",
    "check_indices",
    "components",
    "corner_groups",
    "edge_table",
    "face_components",
    "feature_corners",
    "feature_mask",
    "label_boundaries",
    "outward",
    "require_valid",
    "topology",
]


@dataclass(frozen=True)
class Topology:
    """Counts that say what kind of surface it is.

    Parameters
    ----------
    vertices, edges, faces : int
        Vertices that belong to a face, edges, faces.
    watertight : bool
        Every edge has exactly two faces.
    oriented : bool
        The faces at every edge run through it in opposite directions.
    boundary_edges, nonmanifold_edges : int
        Edges with one face, and with more than two.
    nonmanifold_vertices : int
        Vertices whose faces form more than one fan (pinched).
    duplicate_faces : int
        Faces that repeat the three vertices of another, in whatever order.
    collapsed_faces : int
        Faces that name a vertex twice.
    boundary_loops : int
        Connected pieces of the boundary.
    euler : int
        vertices - edges + faces.
    components : int
        Connected pieces of the surface.
    genus : int or None
        Number of handles, summed over the components; None if the surface is not manifold.
    """

    vertices: int
    edges: int
    faces: int
    watertight: bool
    oriented: bool
    boundary_edges: int
    nonmanifold_edges: int
    nonmanifold_vertices: int
    duplicate_faces: int
    collapsed_faces: int
    boundary_loops: int
    euler: int
    components: int
    genus: int | None

    @property
    def manifold(self):
        """Every point has a neighbourhood like a disc, or a half-disc on the boundary."""
        return self.nonmanifold_edges == self.nonmanifold_vertices == self.collapsed_faces == 0


def topology(faces, n_points):
    """Count vertices, edges, faces, holes and handles, and everything that is not manifold.

    Parameters
    ----------
    faces : (m, 3) int array
    n_points : int
        Number of points the faces may refer to; points of no face do not count.

    Raises
    ------
    InvalidMesh
        If a face refers to a point that does not exist.
    """
    faces = np.asarray(faces).reshape(-1, 3)
    check_indices(faces, n_points)
    table = edge_table(faces)
    count = table.count
    fans, number = corner_groups(faces, table=table)
    vertex_of_fan = np.empty(number, dtype=np.int64)
    vertex_of_fan[fans.ravel()] = faces.ravel()
    fans_at = np.bincount(vertex_of_fan, minlength=n_points)
    vertices = int(np.count_nonzero(fans_at))
    nonmanifold_edges = int(np.count_nonzero(count > 2))
    nonmanifold_vertices = int(np.count_nonzero(fans_at > 1))
    collapsed = int(np.count_nonzero(_collapsed(faces)))
    pieces, _ = face_components(faces)
    loops = _count_loops(table.edges[count == 1])
    euler = vertices - len(table.edges) + len(faces)
    manifold = nonmanifold_edges == nonmanifold_vertices == collapsed == 0
    return Topology(
        vertices=vertices,
        edges=len(table.edges),
        faces=len(faces),
        watertight=bool(np.all(count == 2)) and len(faces) > 0,
        oriented=_consistent(faces, table),
        boundary_edges=int(np.count_nonzero(count == 1)),
        nonmanifold_edges=nonmanifold_edges,
        nonmanifold_vertices=nonmanifold_vertices,
        duplicate_faces=count_repeated(faces),
        collapsed_faces=collapsed,
        boundary_loops=loops,
        euler=euler,
        components=pieces,
        genus=(2 * pieces - loops - euler) // 2 if manifold else None,
    )


def count_repeated(faces):
    """Faces that repeat the vertices of an earlier one."""
    low, high = faces.min(axis=1), faces.max(axis=1)
    middle = faces.sum(axis=1, dtype=np.int64) - low - high
    size = np.int64(faces.max(initial=0)) + 1
    pair = low * size + middle
    if size <= 2**21:  # the three numbers fit one key
        return int(np.count_nonzero(np.diff(np.sort(pair * size + high)) == 0))
    order = np.lexsort((high, pair))
    return int(np.count_nonzero((np.diff(pair[order]) == 0) & (np.diff(high[order]) == 0)))


def _collapsed(faces):
    """Faces that name a vertex twice (m,) bool."""
    return (
        (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    )


def _consistent(faces, table):
    """Whether no edge has more than two faces, and two faces always run through it oppositely."""
    if np.any(table.count > 2):
        return False
    inner = table.start[:-1][table.count == 2]
    first, second = table.half_edges[inner], table.half_edges[inner + 1]
    flat = faces.ravel()
    after = second + np.where(second % 3 == 2, -2, 1)
    return bool(np.all(flat[first] == flat[after])) and not np.any(_collapsed(faces))


def _count_loops(edges):
    """Connected pieces of the graph of edges (k, 2)."""
    if len(edges) == 0:
        return 0
    used, index = np.unique(edges, return_inverse=True)
    index = index.reshape(-1, 2)
    return int(components(index[:, 0], index[:, 1], len(used))[0])


def boundary_edges(faces):
    """Return the edges (k, 2) with one face, directed as that face runs through them."""
    faces = np.asarray(faces)
    table = edge_table(faces)
    half = table.half_edges[table.start[:-1][table.count == 1]]
    after = half + np.where(half % 3 == 2, -2, 1)
    flat = faces.ravel()
    return np.stack([flat[half], flat[after]], axis=1)


def boundary_loops(faces):
    """Return the boundary's closed curves: a list of vertex arrays, each in the faces' direction.

    The first vertex is not repeated at the end. Where a vertex is pinched, curves are cut so that
    none passes it twice.

    Raises
    ------
    InvalidMesh
        If the faces are not consistently oriented, so that the curves have no direction.
    """
    following = {}
    for a, b in boundary_edges(faces).tolist():
        following.setdefault(a, []).append(b)
    loops = []
    for start in sorted(following):
        while following[start]:
            loops.extend(_walk(following, start))
    return [np.array(loop, dtype=np.int32) for loop in loops]


def _walk(following, start):
    """Take one closed walk out of `following`, cut into simple loops."""
    path, place, loops = [start], {start: 0}, []
    while True:
        successors = following.get(path[-1])
        if not successors:
            raise InvalidMesh(
                f"the boundary does not close at vertex {path[-1]}: orient the faces alike first"
            )
        vertex = successors.pop()
        if vertex not in place:
            place[vertex] = len(path)
            path.append(vertex)
            continue
        cut = place[vertex]
        loops.append(path[cut:])
        for passed in path[cut + 1 :]:
            del place[passed]
        del path[cut + 1 :]
        if cut == 0:
            return loops


def outward(mesh):
    """Whether every closed component has its normals outside, cavities inside.

    A component inside an odd number of others is the wall of a cavity: its volume must be
    negative, that of all others positive.

    Parameters
    ----------
    mesh : TriMesh
        Closed and consistently oriented (see `require_valid`).
    """
    count, label = face_components(mesh.faces)
    order = np.argsort(label, kind="stable")
    bounds = np.searchsorted(label[order], np.arange(1, count))
    pieces = np.split(mesh.points[mesh.faces[order]], bounds)
    low = np.array([piece.min(axis=(0, 1)) for piece in pieces])
    high = np.array([piece.max(axis=(0, 1)) for piece in pieces])
    for number, piece in enumerate(pieces):
        point = piece[0, 0]
        around = np.flatnonzero(np.all((point > low) & (point < high), axis=1))
        depth = sum(
            abs(winding_number(point, pieces[other])) > 0.5 for other in around[around != number]
        )
        if volume_sign(piece) * (-1) ** depth <= 0:
            return False
    return True


def volume_sign(corners):
    """1 if the normals of a closed piece, given by its triangles (m, 3, 3), point outside, else -1.

    0 if it has no volume.
    """
    centred = corners - corners.reshape(-1, 3).mean(axis=0)
    scaled = np.ldexp(centred, -np.frexp(np.abs(centred).max(initial=0.0))[1])
    a, b, c = np.moveaxis(scaled, 1, 0)
    return int(np.sign(np.einsum("ij,ij->", a, np.cross(b, c))))


def winding_number(point, corners):
    """How often triangles (m, 3, 3) wind about a point (3,) (Van Oosterom & Strackee 1983)."""
    a, b, c = np.moveaxis(corners - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a)))
    below = la * lb * lc + ab * lc + bc * la + ca * lb
    return float(np.arctan2(triple, below).sum() / (2.0 * np.pi))


def require_valid(mesh, closed=True, name="the surface"):
    """Raise InvalidMesh, with counts of all that is wrong, unless the mesh is a proper surface.

    Proper: some faces, finite points, no collapsed or repeated face, edges and vertices manifold,
    consistently oriented, and if `closed`: no open edge, and normals outside. Intersections are
    not looked for (see `meshes.self_intersection`).

    Parameters
    ----------
    mesh : TriMesh
    closed : bool
    name : str
        What the surface is called in the message.

    Returns
    -------
    Topology
    """
    check_indices(mesh.faces, len(mesh.points))
    if len(mesh.faces) == 0:
        raise InvalidMesh(f"{name} has no faces")
    bad = int(np.count_nonzero(~np.isfinite(mesh.points).all(axis=1)))
    if bad:
        raise InvalidMesh(f"{name} has {bad} points with NaN or infinite coordinates")
    found = topology(mesh.faces, len(mesh.points))
    counts = [
        (found.collapsed_faces, "faces that name a vertex twice"),
        (found.duplicate_faces, "repeated faces"),
        (found.nonmanifold_edges, "edges with more than two faces"),
        (found.nonmanifold_vertices, "vertices where separate fans of faces meet"),
        (found.boundary_edges if closed else 0, "open edges"),
    ]
    wrong = [f"{number} {what}" for number, what in counts if number]
    if not wrong and not found.oriented:
        wrong = ["faces of different orientation side by side"]
    if not wrong and closed and not outward(mesh):
        wrong = ["normals that point inward"]
    if wrong:
        kind = "closed manifold" if closed else "manifold"
        raise InvalidMesh(
            f"{name} is no {kind} surface: it has {', '.join(wrong)}; repair it first"
        )
    return found
