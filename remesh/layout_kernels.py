"""Kernels of `layout`. Half-edge 3 t + k runs from corner k of face t to corner k + 1.

Slow twins: in `meshes.edges` and `meshes.curves`, which the tests compare them with.
"""

from remesh.compiled import kernel
from remesh.connectivity import following, preceding


@kernel
def morton_keys(points, low, scale, cells, keys):
    """Place of every point on a Morton curve through cells^3 cells, cells a power of two."""
    for i in range(points.shape[0]):
        key, bit, place = 0, 1, 0
        while bit < cells:
            for k in range(3):
                cell = min(int((points[i, k] - low[k]) * scale), cells - 1)
                if cell & bit:
                    key |= 1 << (3 * place + k)
            bit <<= 1
            place += 1
        keys[i] = key


@kernel
def list_by_lower_end(faces, starts, listed):
    """List half-edges by the lower-numbered vertex of their edge.

    Those of vertex v are listed[starts[v] : starts[v + 1]]; `starts` (n + 1,) is handed in as 0.
    """
    flat = faces.reshape(faces.size)
    for h in range(flat.size):
        starts[min(flat[h], flat[following(h)])] += 1
    total = 0
    for v in range(starts.size):
        total += starts[v]
        starts[v] = total
    for h in range(flat.size - 1, -1, -1):
        v = min(flat[h], flat[following(h)])
        starts[v] -= 1
        listed[starts[v]] = h


@kernel
def pair_half_edges(faces, starts, listed, twins):
    """Fill `twins` (handed in as -1); return how many half-edges are more than a manifold has.

    Those are: the third on an edge, the second in the same direction, one from a vertex to itself.
    """
    flat = faces.reshape(faces.size)
    wrong = 0
    for v in range(starts.size - 1):
        for i in range(starts[v], starts[v + 1]):
            h = listed[i]
            other = max(flat[h], flat[following(h)])
            if other == v:
                wrong += 1
            for j in range(i + 1, starts[v + 1]):
                g = listed[j]
                if max(flat[g], flat[following(g)]) != other:
                    continue
                if flat[g] == flat[h] or twins[g] >= 0 or twins[h] >= 0:
                    wrong += 1
                else:
                    twins[h], twins[g] = g, h
    return wrong


@kernel
def pinched_vertices(faces, twins, out, degree):
    """How many vertices have more than one fan; `out` (-1) and `degree` (0) are filled."""
    flat = faces.reshape(faces.size)
    for h in range(flat.size):
        degree[flat[h]] += 1
        if out[flat[h]] < 0 or twins[h] < 0:
            out[flat[h]] = h
    pinched = 0
    for v in range(out.size):
        if out[v] < 0:
            continue
        h, count = out[v], 0
        while count <= degree[v]:
            count += 1
            h = twins[preceding(h)]
            if h < 0 or h == out[v]:
                break
        if count != degree[v]:
            pinched += 1
    return pinched


@kernel
def mark_creases(faces, twins, labels, edges, starts, listed, crease):
    """Mark half-edges (False) on open boundaries, between labels, and on the edges (k, 2) given."""
    flat = faces.reshape(faces.size)
    for h in range(flat.size):
        crease[h] = twins[h] < 0 or labels[twins[h] // 3] != labels[h // 3]
    for e in range(edges.shape[0]):
        a, b = min(edges[e, 0], edges[e, 1]), max(edges[e, 0], edges[e, 1])
        for i in range(starts[a], starts[a + 1]):
            if max(flat[listed[i]], flat[following(listed[i])]) == b:
                crease[listed[i]] = True


@kernel
def number_rows(faces, twins, crease, group, rows_of, points):
    """Number the corners' sectors between creases; returns how many there are.

    group, rows_of : (3 m,) int64
        Handed in as -1. The first sector of vertex v, in order of the corners, is row v.
    """
    flat = faces.reshape(faces.size)
    count = points
    for first in range(flat.size):
        if group[first] >= 0:
            continue
        v = flat[first]
        row = v
        if rows_of[v] >= 0:
            row = count
            count += 1
        rows_of[row] = v
        h = first
        while h >= 0 and group[h] < 0:  # turning left
            group[h] = row
            back = preceding(h)
            h = -1 if crease[back] else twins[back]
        h = first
        while not crease[h]:  # turning right
            h = following(twins[h])
            if group[h] >= 0:
                break
            group[h] = row
    return count
