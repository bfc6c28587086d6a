"""How the triangles of a surface hang together: edges, loops, genus, and what is wrong with them.

Half-edge 3 f + k of face f runs from its corner k to its corner k + 1 (modulo 3). All of this is
about vertex numbers alone, except `outward`, `feature_corners` and `require_valid`.
"""

from dataclasses import dataclass

import numpy as np

from meshes.errors import InvalidMesh
from meshes.topology_kernels import counting_sort, number_components, number_edges


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """The edges of a triangulation and the half-edges on each.

    Parameters
    ----------
    edges : (e, 2) int32 array
        The two vertices of every edge, the smaller number first; sorted.
    face_edges : (m, 3) int32 array
        The edge of each half-edge.
    half_edges : (3 m,) int64 array
        All half-edges, ordered by edge.
    start : (e + 1,) int64 array
        The half-edges of edge i are half_edges[start[i]:start[i + 1]].
    """

    edges: np.ndarray
    face_edges: np.ndarray
    half_edges: np.ndarray
    start: np.ndarray

    @property
    def count(self):
        """Number of faces at every edge (e,)."""
        return np.diff(self.start)

    def face_pairs(self):
        """Edges with exactly two faces (p,), and their faces (p, 2)."""
        inner = np.flatnonzero(self.count == 2)
        first = self.half_edges[self.start[inner]]
        second = self.half_edges[self.start[inner] + 1]
        return inner, np.stack([first // 3, second // 3], axis=1)


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


def edge_table(faces):
    """Return the EdgeTable of faces (m, 3)."""
    faces = np.asarray(faces, dtype=np.int32).reshape(-1, 3)
    after = faces[:, [1, 2, 0]]
    low, high = np.minimum(faces, after).ravel(), np.maximum(faces, after).ravel()
    room = int(faces.max(initial=-1)) + 2
    order, other = np.arange(low.size), np.empty(low.size, dtype=np.int64)
    counting_sort(high, order, np.zeros(room, dtype=np.int64), other)
    counting_sort(low, other, np.zeros(room, dtype=np.int64), order)
    edge_of, first = np.empty(low.size, dtype=np.int32), other
    count = number_edges(low, high, order, edge_of, first)
    start = np.append(first[:count], low.size)
    pick = order[start[:-1]]
    edges = np.stack([low[pick], high[pick]], axis=1)
    return EdgeTable(edges, edge_of.reshape(-1, 3), order, start)


def _corner_ends(faces, half_edges):
    """Corners (h,) of half-edges at the lower- and at the higher-numbered end of their edge."""
    corner = half_edges
    after = half_edges + np.where(half_edges % 3 == 2, -2, 1)
    flat = faces.ravel()
    forward = flat[corner] <= flat[after]
    return np.where(forward, corner, after), np.where(forward, after, corner)


def corner_groups(faces, joined=None, table=None):
    """Number the corners so that those joined across edges around one vertex share a number.

    Parameters
    ----------
    faces : (m, 3) int array
    joined : (e,) bool array, optional
        Edges across which corners are joined; all if not given.
    table : EdgeTable, optional

    Returns
    -------
    group : (m, 3) int array
        Without `joined` there is one group per vertex and fan of faces.
    count : int
    """
    faces = np.asarray(faces)
    table = edge_table(faces) if table is None else table
    half = table.half_edges
    edge = table.face_edges.ravel()[half]
    same = edge[1:] == edge[:-1]
    if joined is not None:
        same &= joined[edge[1:]]
    low, high = _corner_ends(faces, half)
    rows = np.concatenate([low[:-1][same], high[:-1][same]])
    columns = np.concatenate([low[1:][same], high[1:][same]])
    count, group = components(rows, columns, faces.size)
    return group.reshape(-1, 3), count


def components(rows, columns, size):
    """Connected components of the graph with edges (rows, columns) on `size` nodes.

    Returns
    -------
    count : int
    label : (size,) int32 array
        Components are numbered by their first nodes.
    """
    parent = np.arange(size, dtype=np.int32)
    label = np.empty(size, dtype=np.int32)
    rows, columns = (np.ascontiguousarray(side, dtype=np.int32) for side in (rows, columns))
    return number_components(rows, columns, parent, label), label


def face_components(faces):
    """Number the connected pieces (faces that share a vertex): count, label of each face (m,)."""
    faces = np.asarray(faces, dtype=np.int64)
    size = int(faces.max(initial=-1)) + 1
    rows, columns = faces[:, :2].ravel(), faces[:, 1:].ravel()
    _, label = components(rows, columns, size)
    of_face = label[faces[:, 0]]
    used = np.zeros(size, dtype=bool)
    used[of_face] = True
    return int(used.sum()), (np.cumsum(used) - 1)[of_face]


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
        duplicate_faces=_count_duplicates(faces),
        collapsed_faces=collapsed,
        boundary_loops=loops,
        euler=euler,
        components=pieces,
        genus=(2 * pieces - loops - euler) // 2 if manifold else None,
    )


def check_indices(faces, n_points):
    """Raise InvalidMesh if faces (m, 3) refer to points outside 0 ... n_points - 1."""
    bad = np.count_nonzero((faces < 0) | (faces >= n_points))
    if bad:
        raise InvalidMesh(
            f"{bad} face corners refer to points that do not exist (there are {n_points} points)"
        )


def _count_duplicates(faces):
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


def label_boundaries(mesh):
    """Return the edges (k, 2) between faces of different labels, and all edges not shared by two.

    Parameters
    ----------
    mesh : TriMesh
    """
    table = edge_table(mesh.faces)
    return table.edges[_label_change(table, mesh.face_labels)]


def _label_change(table, labels):
    """Edges (e,) bool whose faces differ in label, or that have not exactly two faces."""
    change = table.count != 2
    inner, pairs = table.face_pairs()
    change[inner] = labels[pairs[:, 0]] != labels[pairs[:, 1]]
    return change


def feature_mask(mesh, table):
    """Edges (e,) bool across which nothing is smooth: feature edges, label changes, boundaries."""
    mask = _label_change(table, mesh.face_labels)
    if len(mesh.feature_edges):
        size = int(table.edges.max(initial=0)) + 1
        key = table.edges[:, 0].astype(np.int64) * size + table.edges[:, 1]
        low = mesh.feature_edges.min(axis=1).astype(np.int64)
        high = mesh.feature_edges.max(axis=1)
        wanted = (low * size + high)[high < size]
        index = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
        mask[index[key[index] == wanted]] = True
    return mask


def feature_corners(mesh, angle=45.0):
    """Return the vertices (k,) where feature curves end, meet, or turn by more than `angle`.

    Parameters
    ----------
    mesh : TriMesh
    angle : float [degrees]
        A curve that runs on straight turns by 0.
    """
    edges = np.asarray(mesh.feature_edges, dtype=np.int64)
    if len(edges) == 0:
        return np.zeros(0, dtype=np.int32)
    ends = np.concatenate([edges[:, 0], edges[:, 1]])
    others = np.concatenate([edges[:, 1], edges[:, 0]])
    order = np.argsort(ends, kind="stable")
    ends, others = ends[order], others[order]
    vertices, first, degree = np.unique(ends, return_index=True, return_counts=True)
    corner = degree != 2
    through = np.flatnonzero(~corner)
    here = mesh.points[vertices[through]]
    before = here - mesh.points[others[first[through]]]
    after = mesh.points[others[first[through] + 1]] - here
    corner[through] = angle_between(before, after) > np.radians(angle)
    return vertices[corner].astype(np.int32)


def angle_between(a, b):
    """Angle (n,) [radians] between vectors a and b (n, 3), accurate for small angles too."""
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.arctan2(sine, np.einsum("...k,...k->...", a, b))


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
    corners = mesh.points[mesh.faces]
    pieces = [corners[label == k] for k in range(count)]
    boxes = [(p.min(axis=(0, 1)), p.max(axis=(0, 1))) for p in pieces]
    for k, piece in enumerate(pieces):
        point = piece[0, 0]
        depth = 0
        for other, (low, high) in enumerate(boxes):
            if other != k and np.all(point > low) and np.all(point < high):
                depth += abs(_winding_number(point, pieces[other])) > 0.5
        if _volume(piece) * (-1) ** depth <= 0:
            return False
    return True


def _volume(corners):
    """Signed volume inside triangles (m, 3, 3), taken about their own middle."""
    a, b, c = np.moveaxis(corners - corners.reshape(-1, 3).mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def _winding_number(point, corners):
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
