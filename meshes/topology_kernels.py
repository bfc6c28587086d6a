"""Kernels behind meshes.topology: sorting half-edges, and connected components by union-find.

Slow twins: edge_faces and components in tests.meshes.reference.
"""

from numba import njit

kernel = njit(cache=True, nogil=True)


@kernel
def counting_sort(keys, before, start, after):
    """Fill after (h,) with the numbers of before (h,), stably ordered by their keys.

    start (largest key + 2,) is room to count in, and must hold zeros.
    """
    for i in range(keys.size):
        start[keys[i] + 1] += 1
    for i in range(1, start.size):
        start[i] += start[i - 1]
    for i in range(before.size):
        key = keys[before[i]]
        after[start[key]] = before[i]
        start[key] += 1


@kernel
def number_edges(low, high, order, edge_of, first):
    """Number the half-edges' edges in the given order: fill edge_of (h,) and first (h,).

    first[e] is the place in `order` of edge e's first half-edge. Returns the number of edges.
    """
    count = 0
    for i in range(order.size):
        here = order[i]
        if i == 0 or low[here] != low[order[i - 1]] or high[here] != high[order[i - 1]]:
            first[count] = i
            count += 1
        edge_of[here] = count - 1
    return count


@kernel
def root_of(parent, i):
    """The root of i's tree; halves the path to it."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@kernel
def number_components(rows, columns, parent, label):
    """Fill label (n,) with the component of every node, numbered by their first nodes.

    The graph has the edges (rows, columns). parent (n,) holds 0 ... n - 1. Returns their number.
    """
    for k in range(rows.size):
        a, b = root_of(parent, rows[k]), root_of(parent, columns[k])
        if a < b:
            parent[b] = a
        else:
            parent[a] = b
    count = 0
    for i in range(parent.size):
        root = root_of(parent, i)
        if root == i:
            label[i] = count
            count += 1
        else:
            label[i] = label[root]
    return count
