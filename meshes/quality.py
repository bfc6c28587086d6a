"""How well shaped triangles and tetrahedra are; normals, areas, volumes."""

from dataclasses import asdict, dataclass

import numpy as np

from meshes.self_intersection import self_intersecting_faces
from meshes.topology import corner_groups, edge_table, feature_mask, topology

DEGENERATE_AREA = 1e-14  # of the squared bounding-box diagonal


@dataclass(frozen=True)
class SurfaceQuality:
    """Counts and shapes of a surface, as they go into a report.

    Parameters
    ----------
    vertices, faces, watertight, nonmanifold_edges, nonmanifold_vertices, euler, components, genus
        See `meshes.topology.Topology`.
    self_intersecting_faces : int or None
        Faces that meet another one elsewhere than in shared vertices or edges.
    degenerate_faces : int
        Faces with an area below 1e-14 of the squared diagonal, or with a vertex named twice.
    volume : float [unit of the points, cubed]
        Signed volume; only of meaning if watertight.
    min_angle_worst, min_angle_mean : float [degrees]
        Least and mean of the triangles' smallest angles.
    pct_below_20, pct_below_30 : float [%]
        Share of the triangles whose smallest angle is below 20 or 30 degrees.
    edge_ratio : float
        Longest edge over shortest edge.
    min_angle_6d_mean : float or None [degrees]
        Mean of the smallest angles measured in the embedding (x, sigma n).
    """

    vertices: int
    faces: int
    watertight: bool
    nonmanifold_edges: int
    nonmanifold_vertices: int
    self_intersecting_faces: int | None
    degenerate_faces: int
    euler: int
    components: int
    genus: int | None
    volume: float
    min_angle_worst: float
    min_angle_mean: float
    pct_below_20: float
    pct_below_30: float
    edge_ratio: float
    min_angle_6d_mean: float | None

    def as_dict(self):
        """The figures by name, ready for JSON."""
        return asdict(self)


def area_vectors(points, faces):
    """Normals of faces (m, 3) with the length of their area (m, 3)."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def face_areas(points, faces):
    """Areas (m,) of faces (m, 3)."""
    return np.linalg.norm(area_vectors(points, faces), axis=1)


def normalised(vectors):
    """Vectors (..., 3) at length 1; zero vectors stay zero. Safe for very small and large ones."""
    vectors = np.asarray(vectors, dtype=float)
    largest = np.abs(vectors).max(axis=-1, keepdims=True)
    scaled = vectors / np.where(largest > 0, largest, 1.0)
    length = np.linalg.norm(scaled, axis=-1, keepdims=True)
    return scaled / np.where(length > 0, length, 1.0)


def face_normals(points, faces):
    """Unit normals (m, 3) of faces; zero where a face has no area."""
    return normalised(area_vectors(points, faces))


def corner_angles(corners):
    """Angles (m, 3) [radians] at the corners (m, 3, d) of triangles in d dimensions.

    Accurate for needles, in any dimension: the sine comes from the height over one side, not from
    lengths alone.
    """
    corners = np.asarray(corners, dtype=float)
    angles = np.empty(corners.shape[:2])
    for k in range(3):
        first = corners[:, (k + 1) % 3] - corners[:, k]
        second = corners[:, (k + 2) % 3] - corners[:, k]
        angles[:, k] = _angle(first, second)
    return angles


def _angle(first, second):
    """Angle (m,) [radians] between vectors (m, d); pi / 2 where one is zero."""
    square = np.einsum("ij,ij->i", first, first)
    dot = np.einsum("ij,ij->i", first, second)
    share = dot / np.where(square > 0, square, 1.0)
    height = np.linalg.norm(second - share[:, None] * first, axis=1)
    return np.where(
        (square > 0) & np.any(second != 0, axis=1),
        np.arctan2(height * np.sqrt(square), dot),
        0.5 * np.pi,
    )


def triangle_angles(points, faces):
    """Angles (m, 3) [radians] of faces (m, 3) at their corners."""
    return corner_angles(points[faces])


def vertex_normals(points, faces):
    """Unit normals (n, 3) of the vertices, weighted by the angles of their faces."""
    return _gathered_normals(points, faces, faces, len(points))


def corner_normals(mesh):
    """Unit normals (m, 3, 3) at the corners of every face, one per smooth patch at creases.

    Angle-weighted normals of the faces around the vertex that no feature edge, label boundary or
    open boundary separates; on a planar label the normal of its plane.

    Parameters
    ----------
    mesh : TriMesh
    """
    table = edge_table(mesh.faces)
    group, count = corner_groups(mesh.faces, ~feature_mask(mesh, table), table)
    normals = _gathered_normals(mesh.points, mesh.faces, group, count)[group]
    for label, patch in enumerate(mesh.labels):
        if patch.plane is not None:
            normals[mesh.face_labels == label] = patch.plane.normal
    return normals


def _gathered_normals(points, faces, group, count):
    """Unit sums (count, 3) of face normals times corner angles over the corners of each group."""
    weight = triangle_angles(points, faces).ravel()
    contribution = np.repeat(face_normals(points, faces), 3, axis=0) * weight[:, None]
    index = np.asarray(group).ravel()
    total = [np.bincount(index, contribution[:, k], minlength=count) for k in range(3)]
    return normalised(np.stack(total, axis=1))


def signed_volume(mesh):
    """Volume inside a closed surface [unit of the points, cubed]; negative if inside out.

    Parameters
    ----------
    mesh : TriMesh
    """
    if len(mesh.faces) == 0:
        return 0.0
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    middle = a.mean(axis=0)
    triple = np.einsum("ij,ij->i", a - middle, np.cross(b - middle, c - middle))
    return float(triple.sum() / 6.0)


def degenerate_faces(mesh):
    """Faces (m,) bool without area: below 1e-14 of the squared diagonal, or a vertex twice."""
    faces = mesh.faces
    twice = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    used = mesh.points[faces].reshape(-1, 3)
    diagonal = np.linalg.norm(np.ptp(used, axis=0)) if len(used) else 0.0
    return twice | (face_areas(mesh.points, faces) <= DEGENERATE_AREA * diagonal**2)


def min_angles_6d(mesh, sigma, normals=None):
    """Smallest angles (m,) [radians] of the faces in the embedding (x, sigma n).

    Parameters
    ----------
    mesh : TriMesh
    sigma : float [unit of the points]
        Weight of the normals. On planar labels it is 0.
    normals : (n, 3) or (m, 3, 3) float array, optional
        Unit normals of the vertices, or of the corners of every face; `corner_normals` if not
        given.

    Notes
    -----
    The 6D embedding of Levy & Bonneel (2013).
    """
    normals = corner_normals(mesh) if normals is None else np.asarray(normals, dtype=float)
    if normals.ndim == 2:
        normals = normals[mesh.faces]
    planar = np.array([patch.plane is not None for patch in mesh.labels])
    weight = np.where(planar[mesh.face_labels], 0.0, sigma)
    corners = np.concatenate([mesh.points[mesh.faces], weight[:, None, None] * normals], axis=2)
    return corner_angles(corners).min(axis=1)


def surface_quality(mesh, sigma=None, normals=None, intersections=True):
    """Measure a surface.

    Parameters
    ----------
    mesh : TriMesh
    sigma : float, optional [unit of the points]
        With it the 6D angles are measured too.
    normals : (n, 3) or (m, 3, 3) float array, optional
        Unit normals for the 6D angles (see `min_angles_6d`).
    intersections : bool
        Whether to look for self-intersections (None is reported if not).

    Returns
    -------
    SurfaceQuality
    """
    found = topology(mesh.faces, len(mesh.points))
    smallest = np.degrees(triangle_angles(mesh.points, mesh.faces).min(axis=1, initial=np.pi))
    edges = edge_table(mesh.faces).edges
    lengths = np.linalg.norm(mesh.points[edges[:, 0]] - mesh.points[edges[:, 1]], axis=1)
    shortest = lengths.min(initial=np.inf)
    six = None
    if sigma is not None and len(mesh.faces):
        six = float(np.degrees(min_angles_6d(mesh, sigma, normals)).mean())
    crossing = self_intersecting_faces(mesh.points, mesh.faces) if intersections else None
    some = len(mesh.faces) > 0
    return SurfaceQuality(
        vertices=found.vertices,
        faces=found.faces,
        watertight=found.watertight,
        nonmanifold_edges=found.nonmanifold_edges,
        nonmanifold_vertices=found.nonmanifold_vertices,
        self_intersecting_faces=int(crossing.sum()) if intersections else None,
        degenerate_faces=int(degenerate_faces(mesh).sum()),
        euler=found.euler,
        components=found.components,
        genus=found.genus,
        volume=signed_volume(mesh),
        min_angle_worst=float(smallest.min()) if some else 0.0,
        min_angle_mean=float(smallest.mean()) if some else 0.0,
        pct_below_20=100.0 * float(np.mean(smallest < 20.0)) if some else 0.0,
        pct_below_30=100.0 * float(np.mean(smallest < 30.0)) if some else 0.0,
        edge_ratio=float(lengths.max() / shortest) if some and shortest > 0 else float("inf"),
        min_angle_6d_mean=six,
    )


def dihedral_angles(points, tets):
    """Dihedral angles (m, 6) [radians] of tetrahedra, one per edge.

    The edges are (0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3) of each tetrahedron.
    """
    corner = points[tets]
    angles = []
    for i, j, k, l in ((0, 1, 2, 3), (0, 2, 3, 1), (0, 3, 1, 2), (1, 2, 0, 3), (1, 3, 2, 0),
                       (2, 3, 0, 1)):  # fmt: skip
        axis = normalised(corner[:, j] - corner[:, i])
        first = corner[:, k] - corner[:, i]
        second = corner[:, l] - corner[:, i]
        first = first - np.einsum("ij,ij->i", first, axis)[:, None] * axis
        second = second - np.einsum("ij,ij->i", second, axis)[:, None] * axis
        sine = np.linalg.norm(np.cross(first, second), axis=1)
        angles.append(np.arctan2(sine, np.einsum("ij,ij->i", first, second)))
    return np.stack(angles, axis=1)
