"""Vertices drawn to what the triangles miss: narrow ridges, grooves and blends.

The fits see the gaps from the triangles to the surface. A groove that triangles bridge is close to
none of them, so here the carrier's vertices are looked at instead: where one is far from the
triangles, the nearest vertex is put there, if that leaves good triangles.
"""

import numpy as np

from meshes.closest_point import ClosestPoint
from remesh.compiled import allocating
from remesh.connectivity import HINT, MAX_RING, OFFSET, ring
from remesh.embedding import as_tangents
from remesh.guard import gather_star, no_worse, star_quality
from remesh.moves import restore_vertex, save_vertex
from remesh.nearest import place

FAR_IN_EDGES, FAR_IN_RMS = 0.03, 4.0
ROUNDS = 6


def reach_far_points(work, free, length, sigma, limits):
    """Move vertices to points of the carrier that the triangles miss; return their rows.

    Parameters
    ----------
    work : WorkMesh
    free : (n,) bool array
        Rows that may move.
    length : float [unit of the points]
        Edge length; points within a small share of it, or a few times the root mean square
        distance, are near enough.
    sigma : float [unit of the points]
        Of the 6D angles that `limits` speaks of.
    limits : (angle6, angle3, agreement)
        No triangle may come out below these and below what it was.
    """
    points = work.carrier.mesh.points
    reached, before = [], np.inf
    for _ in range(ROUNDS):
        mesh, bases = work.to_mesh()
        faces, weights, distance = ClosestPoint(mesh.points, mesh.faces).query(points)
        least = max(FAR_IN_EDGES * length, FAR_IN_RMS * np.sqrt(np.mean(distance**2)))
        far = np.flatnonzero(distance > least)
        if len(far) == 0 or distance.max() >= before:
            break
        before = distance.max()
        far = far[np.argsort(-distance[far], kind="stable")]
        corner = weights[far].argmax(axis=1)
        rows = bases[mesh.faces[faces[far], corner]]
        _, first = np.unique(rows, return_index=True)
        first = np.sort(first)
        first = first[free[rows[first]]]
        moved = np.zeros(len(first), bool)
        draw_vertices(
            work.halves, work.links, work.rows, rows[first], points[far[first]], sigma**2,
            as_tangents(limits), work.carrier.reference, moved,
        )  # fmt: skip
        reached.append(rows[first[moved]])
    return np.unique(np.concatenate(reached)) if reached else np.zeros(0, int)


@allocating
def draw_vertices(halves, links, rows, vertices, targets, sigma2, limits, reference, moved):
    """Put vertices at points of the carrier, or half way, as the limits allow; mark `moved`."""
    fan, star = np.empty(MAX_RING, np.int64), np.empty((MAX_RING, 14))
    saved, saved_hints, point = np.empty((1, 8)), np.empty(1, np.int64), np.empty(9)
    for i in range(vertices.size):
        v = vertices[i]
        count, _ = ring(halves, links, v, fan)
        if count == 0:
            continue
        gather_star(halves, rows, fan, count, star)
        before = star_quality(rows, halves, fan, count, star, sigma2)
        save_vertex(rows, links, v, saved, saved_hints)
        share, done = 1.0, False
        for _ in range(3):
            offset = (1.0 - share) * saved[0, OFFSET]
            links[v, HINT] = place(
                reference,
                saved[0, 0] + share * (targets[i, 0] - saved[0, 0]),
                saved[0, 1] + share * (targets[i, 1] - saved[0, 1]),
                saved[0, 2] + share * (targets[i, 2] - saved[0, 2]),
                saved_hints[0], offset, point,
            )  # fmt: skip
            for k in range(6):
                rows[v, k] = point[k]
            rows[v, OFFSET] = offset
            if no_worse(star_quality(rows, halves, fan, count, star, sigma2), before, limits):
                done = True
                break
            share *= 0.6
        moved[i] = done
        if not done:
            restore_vertex(rows, links, v, saved, saved_hints)
