"""Feature curves: polylines of the carrier on which vertices slide by arc length.

Creases, label boundaries and open boundaries are cut at corners into curves. A vertex on a curve
is known by its parameter s, the arc length along the curve's polyline; splitting an edge halves
the parameter, smoothing shifts it, so that curve vertices never leave their curve.

Kernels take `curves`, a tuple of arrays:

starts : (c + 1,) int64
    The nodes of curve i are starts[i] : starts[i + 1].
nodes : (k, 10) float64
    Position, arc length, the surface's normals left and right of the curve.
beside : (k, 2) int64
    Carrier triangles left and right of the segment that starts at the node, -1 for none.
closed : (c,) int64
    1 where the last node is the first one again and no corner lies on the curve.
fixed : (c,) int64
    1 where the curve keeps its edges as they are.
"""

import math
from dataclasses import dataclass

import numpy as np

from meshes.topology import feature_corners
from remesh.compiled import kernel
from remesh.connectivity import BASE, CORNER, CREASE, KIND, ORIGIN, PARAMETER, following

LEFT, RIGHT = 0, 1


@dataclass(frozen=True, eq=False)
class Curves:
    """The feature curves of a mesh.

    Parameters
    ----------
    arrays : tuple
        What kernels take (see the module's head).
    vertices : tuple of int arrays
        The mesh's vertices along each curve; a closed curve repeats its first.
    corners : (k,) int array
        Vertices where curves end.
    """

    arrays: tuple
    vertices: tuple
    corners: np.ndarray


def find_curves(mesh, normals, twins, crease, angle=45.0):
    """Cut the feature edges of a mesh into curves.

    Parameters
    ----------
    mesh : TriMesh
        With all its feature edges, boundaries included.
    normals : (m, 3, 3) float array
        Unit normals at the corners of every face.
    twins, crease : (3 m,) arrays
        The opposite half-edge (-1 on a boundary), and whether the half-edge is on a feature.
    angle : float [degrees]
        A curve is cut where it turns by more.
    """
    corners = feature_corners(mesh, angle)
    paths = _paths(mesh.faces, crease, set(corners.tolist()))
    half_of = _half_edge_lookup(mesh.faces, crease)
    starts, nodes, beside = [0], [], []
    for path in paths:
        points = mesh.points[path]
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        length = np.concatenate([[0.0], np.cumsum(steps)])
        left, right, faces = _normals_beside(path, half_of, normals)
        nodes.append(np.column_stack([points, length, left, right]))
        beside.append(faces)
        starts.append(starts[-1] + len(path))
    corner_set = set(corners.tolist())
    closed = [p[0] == p[-1] and p[0] not in corner_set for p in paths]
    arrays = (
        np.array(starts, np.int64),
        np.concatenate(nodes) if nodes else np.zeros((0, 10)),
        (np.concatenate(beside) if beside else np.zeros((0, 2))).astype(np.int64),
        np.array(closed, np.int64),
        np.zeros(len(paths), np.int64),
    )
    return Curves(arrays, tuple(np.array(p) for p in paths), corners)


def with_fixed_boundary(curves):
    """The arrays of curves (a tuple) with open boundaries marked as fixed."""
    starts, nodes, beside, closed, _ = curves
    fixed = (beside[starts[:-1]].min(axis=1) < 0).astype(np.int64)
    return starts, nodes, beside, closed, fixed


def _half_edge_lookup(faces, crease):
    """The feature half-edges by their two vertices."""
    flat = faces.ravel()
    chosen = np.flatnonzero(crease)
    after = chosen + np.where(chosen % 3 == 2, -2, 1)
    return dict(zip(zip(flat[chosen].tolist(), flat[after].tolist()), chosen.tolist()))


def _paths(faces, crease, corners):
    """Lists of vertices along each curve: first those between corners, then the loops."""
    neighbours = {}
    for a, b in sorted({(min(e), max(e)) for e in _half_edge_lookup(faces, crease)}):
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    used, paths = set(), []
    for start in sorted(neighbours):
        if start in corners:
            for step in neighbours[start]:
                if (min(start, step), max(start, step)) not in used:
                    paths.append(_walk(neighbours, corners, used, start, step))
    for start in sorted(neighbours):
        step = neighbours[start][0]
        if start not in corners and (min(start, step), max(start, step)) not in used:
            paths.append(_walk(neighbours, corners, used, start, step))
    return paths


def _walk(neighbours, corners, used, start, step):
    """Follow feature edges from start over step to the next corner, or back to start."""
    path = [start, step]
    used.add((min(start, step), max(start, step)))
    while path[-1] not in corners and path[-1] != start:
        here, before = path[-1], path[-2]
        ahead = neighbours[here]
        after = ahead[1] if ahead[0] == before else ahead[0]
        used.add((min(here, after), max(here, after)))
        path.append(after)
    return path


def _normals_beside(path, half_of, normals):
    """Normals left and right at each vertex of a path, and the faces beside its segments."""
    count = len(path)
    sides = np.zeros((2, count, 3))
    faces = np.full((count, 2), -1)
    for i in range(count - 1):
        for side, (a, b) in enumerate(((path[i], path[i + 1]), (path[i + 1], path[i]))):
            h = half_of.get((a, b), -1)
            if h < 0:
                continue
            face, corner = divmod(h, 3)
            faces[i, side] = face
            at_a, at_b = normals[face, corner], normals[face, (corner + 1) % 3]
            here, ahead = (at_a, at_b) if side == LEFT else (at_b, at_a)
            if i == 0:
                sides[side, 0] = here
            sides[side, i + 1] = ahead
    faces[-1] = faces[-2]
    left, right = sides
    missing = ~faces.max(axis=0).__ge__(0)
    if missing[LEFT]:
        left = right
    if missing[RIGHT]:
        right = left
    return left, right, faces


@kernel
def curve_length(curves, curve):
    """Arc length of a curve."""
    return curves[1][curves[0][curve + 1] - 1, 3]


@kernel
def span(halves, links, rows, curves, h):
    """Parameters at both ends of a feature half-edge, continued past the seam of a loop."""
    code = halves[h, CREASE]
    curve, against = code >> 1, code & 1
    a = links[halves[h, ORIGIN], BASE]
    b = links[halves[following(h), ORIGIN], BASE]
    length = curve_length(curves, curve)
    s_a = rows[a, PARAMETER]
    s_b = rows[b, PARAMETER]
    if links[a, KIND] == CORNER:
        s_a = length if against else 0.0
    if links[b, KIND] == CORNER:
        s_b = 0.0 if against else length
    if curves[3][curve] == 1:
        if against and s_b >= s_a:
            s_b -= length
        elif not against and s_b <= s_a:
            s_b += length
    return s_a, s_b


@kernel
def curve_point(curves, curve, s, out):
    """Write position, left and right normal (9,) at parameter s; return s in range, the node."""
    starts, nodes, _, closed, _ = curves
    low, high = starts[curve], starts[curve + 1] - 1
    length = nodes[high, 3]
    if closed[curve] == 1:
        s -= math.floor(s / length) * length
    s = min(max(s, 0.0), length)
    while high - low > 1:
        middle = (low + high) // 2
        if nodes[middle, 3] <= s:
            low = middle
        else:
            high = middle
    step = nodes[high, 3] - nodes[low, 3]
    w = (s - nodes[low, 3]) / step if step > 0.0 else 0.0
    for k in range(3):
        out[k] = (1.0 - w) * nodes[low, k] + w * nodes[high, k]
    for first in (4, 7):
        square = 0.0
        for k in range(3):
            n = (1.0 - w) * nodes[low, first + k] + w * nodes[high, first + k]
            out[first - 1 + k] = n
            square += n * n
        for k in range(3):
            out[first - 1 + k] /= math.sqrt(square) if square > 0.0 else 1.0
    return s, low
