"""Single vertices put where they are missing: beside short edges that must stay.

Moving vertices cannot mend everything: a triangle whose short edge joins two vertices that are held
(of an open boundary, say) stays thin until there is a vertex near that edge.
"""

import numpy as np

from remesh.compiled import allocating
from remesh.connectivity import (
    BASE,
    CREASE,
    HINT,
    INTERIOR,
    KIND,
    OFFSET,
    ORIGIN,
    following,
    free_vertex,
    room,
    split_edge,
)
from remesh.embedding import corner_edge_lengths, smallest_angles
from remesh.nearest import place
from remesh.split import midpoint_inside, split_agreement

AGREEMENT = 0.3
BESIDE = 1.1  # times a short edge's length: how far from it a vertex is put
LEAST_SHARE = 0.25  # a new vertex is at least this far along the edge that it splits


def insert_beside_short_edges(work, least_angle, at_most):
    """Split the long edges of thin triangles whose short edge is held; return the new rows.

    Parameters
    ----------
    work : WorkMesh
    least_angle : float [degrees]
        Triangles with a smaller angle are thin.
    at_most : int
        Most splits.
    """
    corners, live = work.corner_rows()
    points = work.rows[corners, :3]
    thin = np.flatnonzero(smallest_angles(points) < least_angle)
    lengths = corner_edge_lengths(points[thin])
    short, long = lengths.argmin(axis=1), lengths.argmax(axis=1)
    kinds = work.links[work.links[corners[thin], BASE], KIND]
    each = np.arange(len(thin))
    held = (kinds[each, short] != INTERIOR) & (kinds[each, (short + 1) % 3] != INTERIOR)
    thin, short, long, each = thin[held], short[held], long[held], each[held]
    share = BESIDE * lengths[each, short] / np.maximum(lengths[each, long], 1e-300)
    share = np.clip(share, LEAST_SHARE, 0.5)
    from_start = (long - short) % 3 == 1  # the long edge starts where the short one ends
    share = np.where(from_start, share, 1.0 - share)[:, None]
    start, end = points[thin, long], points[thin, (long + 1) % 3]
    targets = (1.0 - share) * start + share * end
    return split_at(work, (3 * live[thin] + long)[:at_most], targets[:at_most])


def split_at(work, half_edges, targets):
    """Split half-edges (k,) near the targets (k, 3) on the carrier; return the new rows."""
    work.reserve(len(half_edges))
    after = half_edges + np.where(half_edges % 3 == 2, -2, 1)
    ends = np.stack([work.halves[half_edges, ORIGIN], work.halves[after, ORIGIN]], axis=1)
    rows = np.full(len(half_edges), -1)
    split_listed(
        work.halves, work.links, work.rows, work.labels, work.counts, half_edges, ends,
        np.ascontiguousarray(targets), work.carrier.reference, rows,
    )  # fmt: skip
    return rows[rows >= 0]


@allocating
def split_listed(halves, links, rows, labels, counts, listed, ends, targets, reference, inserted):
    """Split listed half-edges that still run between `ends` (k, 2); note the new rows."""
    point = np.empty(9)
    for i in range(listed.size):
        h = listed[i]
        if halves[h, ORIGIN] != ends[i, 0] or halves[following(h), ORIGIN] != ends[i, 1]:
            continue
        if halves[h, CREASE] >= 0 or not room(halves, links, counts, 2, 2):
            continue
        m = midpoint_inside(halves, links, rows, counts, h, reference, point)
        links[m, HINT] = place(
            reference, targets[i, 0], targets[i, 1], targets[i, 2], links[m, HINT], 0.0, point
        )
        for k in range(6):
            rows[m, k] = point[k]
        rows[m, OFFSET] = 0.0
        if split_agreement(halves, rows, h, m, m) < AGREEMENT:
            free_vertex(links, counts, m)
            continue
        split_edge(halves, links, counts, labels, h, m, m)
        inserted[i] = m
