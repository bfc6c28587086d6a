"""The largest gaps made smaller, by single vertices and edges where triangles are far off.

Fits and searches see sums over all triangles; the few that cut across a bend of the surface hardly
count there. Here each of them gets a search of its own. A triangle's gap is the larger of two: from
a lattice of points on it to the carrier, and from the points of the carrier that it is nearest to.
"""

import math

import numpy as np

from meshes.closest_point import ClosestPoint
from remesh.adjust import free_rows
from remesh.compiled import allocating, kernel
from remesh.connectivity import (
    BASE,
    CREASE,
    CURVE,
    EDGES,
    HINT,
    INTERIOR,
    KIND,
    MAX_RING,
    OFFSET,
    ORIGIN,
    PARAMETER,
    TWIN,
    adjacent,
    flip_edge,
    following,
    preceding,
    ring,
)
from remesh.embedding import as_tangents
from remesh.flip import flip_allowed, tangents_of_flip
from remesh.gap_kernels import measure_gaps, pair_gap, star_gap
from remesh.guard import no_worse
from remesh.moves import curve_neighbours, restore_vertex, save_vertex, slide
from remesh.nearest import place
from remesh.optimise import mean_edge, tangent_frame
from remesh.star import STAR_SHAPE, gather_star, star_quality

FAR_IN_RMS = 6.0  # gaps below this many times the root mean square are small enough
AIM = 0.85  # of the gap allowed: what the searches try to get below
NEARLY = 0.4  # of the gap allowed: triangles of the carrier with such corners are looked at inside
INSIDE = np.array([[2, 2, 2], [3, 3, 0], [0, 3, 3], [3, 0, 3]]) / 6.0
PARTS = 6  # of an edge between the lattice's points
FIRST_STEP, SHORTEST_STEP, RISE = 0.3, 0.03, 0.2  # of the mean edge; of a step
DIRECTIONS = 6
LEAST_GAIN = 0.98
ROUNDS, SWEEPS = 6, 3
STALLED = 0.9  # share of the far triangles left at which a round is the last


def relieve_gaps(work, farthest, sigma, limits, exact=True, rounds=ROUNDS):
    """Move vertices and flip edges around triangles that are too far from the carrier.

    Parameters
    ----------
    work : WorkMesh
        Compacted here.
    farthest : float [unit of the points]
        Gaps below this, or below a few times the root mean square, are small enough.
    sigma : float [unit of the points]
        Of the 6D angles that `limits` speaks of.
    limits : (angle6, angle3, agreement)
        No triangle may come out below these and below what it was.
    exact : bool
        Whether the carrier's triangles are the surface itself; else only its vertices are, and
        gaps are measured at these alone.
    rounds : int

    Returns
    -------
    int
        Triangles with a larger gap that are left.
    """
    work.compact()
    lattice = lattice_points(PARTS) if exact else np.zeros((0, 3))
    tangents = as_tangents(limits)
    movable = free_rows(work)
    movable |= work.links[: len(movable), KIND] == CURVE
    before = np.inf
    for turn in range(rounds + 1):
        targets, gaps, farthest = gaps_of(work, farthest, lattice)
        far = np.flatnonzero(gaps > farthest)
        if len(far) == 0 or turn == rounds or len(far) > STALLED * before:
            break
        before = len(far)
        far = far[np.argsort(-gaps[far], kind="stable")]
        sides = (3 * far[:, None] + np.arange(3)).ravel()
        vertices = work.links[work.halves[sides, ORIGIN], BASE]
        _, first = np.unique(vertices, return_index=True)
        vertices = vertices[np.sort(first)]
        moved = shift_vertices(
            work.halves, work.links, work.rows, vertices[movable[vertices]], targets,
            AIM * farthest, sigma**2, tangents, turn, work.curves,
        )  # fmt: skip
        flipped = flip_far(
            work.halves, work.links, work.rows, sides, targets, AIM * farthest, sigma**2, tangents
        )
        if moved + flipped == 0:
            break
    return len(far)


def lattice_points(parts):
    """Barycentric coordinates (k, 3) of a lattice (even parts): corners, midpoints, the rest."""
    points = np.array(
        [(i, j, parts - i - j) for i in range(parts + 1) for j in range(parts + 1 - i)]
    )
    coarse = (points % (parts // 2) == 0).all(axis=1)
    return np.concatenate([points[coarse], points[~coarse]]) / parts


def gaps_of(work, farthest, lattice):
    """What the kernels measure against, the gap of every triangle, and what gap is allowed.

    The points looked for are the carrier's vertices and, if there is a lattice, some inside of
    those of its triangles that have a corner far off.
    """
    carrier = work.carrier.mesh
    mesh, _ = work.to_mesh()
    nearest = ClosestPoint(mesh.points, mesh.faces)
    faces, _, distance = nearest.query(carrier.points)
    farthest = max(farthest, FAR_IN_RMS * float(np.sqrt(np.mean(distance**2))))
    far = carrier.faces[(distance[carrier.faces] > NEARLY * farthest).any(axis=1)]
    inside = np.einsum("sk,mkd->msd", INSIDE[: len(lattice)], carrier.points[far]).reshape(-1, 3)
    inside_faces, _, inside_distance = nearest.query(inside)
    _, live = work.corner_rows()
    triangle = live[np.concatenate([faces, inside_faces])]
    count = np.bincount(triangle, minlength=live[-1] + 1)
    starts = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    listed = np.argsort(triangle, kind="stable").astype(np.int64)
    points = np.concatenate([carrier.points, inside])
    targets = (points, starts, listed, lattice, work.carrier.reference)
    gaps = np.zeros(len(count))
    measure_gaps(work.halves, work.links, work.rows, targets, AIM * farthest, gaps)
    np.maximum.at(gaps, triangle, np.concatenate([distance, inside_distance]))
    return targets, gaps, farthest


@allocating
def shift_vertices(
    halves, links, rows, vertices, targets, aim, sigma2, limits, turn, curves
):  # fmt: skip
    """Pattern search of each vertex for smaller gaps around it; returns how many moved."""
    fan, star = np.empty(MAX_RING, np.int64), np.zeros(STAR_SHAPE)
    point, four, frame = np.empty(9), np.empty(4), np.empty((2, 3))
    best_rows, best_hints = np.empty((2, 8)), np.empty(2, np.int64)
    moved = 0
    for sweep in range(SWEEPS * turn, SWEEPS * (turn + 1)):
        for i in range(vertices.size):
            v = vertices[i]
            count, closed = ring(halves, links, v, fan)
            on_curve = links[v, KIND] == CURVE
            if count == 0 or (on_curve and not curve_neighbours(
                halves, links, rows, v, fan, count, closed, 0.0, curves, four
            )):  # fmt: skip
                continue
            best = star_gap(halves, links, rows, fan, count, targets, aim, math.inf)
            if best == 0.0:
                continue
            gather_star(halves, rows, fan, count, star)
            before = star_quality(rows, halves, fan, count, star, sigma2)
            edge = mean_edge(rows, v, count, star)
            tangent_frame(rows, v, frame)
            save_vertex(rows, links, v, best_rows, best_hints)
            size, success = FIRST_STEP * edge, False
            while size > SHORTEST_STEP * edge and best > 0.0:
                better = False
                for k in range(2 if on_curve else DIRECTIONS + 2):
                    restore_vertex(rows, links, v, best_rows, best_hints)
                    if on_curve:
                        s = best_rows[0, PARAMETER] + (size if k == 0 else -size)
                        slide(halves, links, rows, v, fan, count, s, curves, point)
                    else:
                        shift_inside(rows, links, v, k, size, frame, sweep, targets[4], point)
                    quality = star_quality(rows, halves, fan, count, star, sigma2)
                    if not no_worse(quality, before, limits):
                        continue
                    cost = star_gap(halves, links, rows, fan, count, targets, aim, best)
                    if cost < LEAST_GAIN * best:
                        best, better, success = cost, True, True
                        save_vertex(rows, links, v, best_rows, best_hints)
                        break
                if not better:
                    size *= 0.5
            restore_vertex(rows, links, v, best_rows, best_hints)
            moved += 1 if success else 0
    return moved


@kernel
def shift_inside(rows, links, v, k, size, frame, sweep, reference, point):
    """Move a vertex along the surface in the k-th direction, or (the last two) off or onto it."""
    offset = rows[v, OFFSET]
    along, across, rise = 0.0, 0.0, 0.0
    if k >= DIRECTIONS:
        rise = RISE * size if k == DIRECTIONS else -RISE * size
    else:
        turn = 2.0 * math.pi * k / DIRECTIONS + 2.4 * v + 1.9 * sweep
        along, across = size * math.cos(turn), size * math.sin(turn)
    x = rows[v, 0] - offset * rows[v, 3] + along * frame[0, 0] + across * frame[1, 0]
    y = rows[v, 1] - offset * rows[v, 4] + along * frame[0, 1] + across * frame[1, 1]
    z = rows[v, 2] - offset * rows[v, 5] + along * frame[0, 2] + across * frame[1, 2]
    links[v, HINT] = place(reference, x, y, z, links[v, HINT], offset + rise, point)
    for j in range(6):
        rows[v, j] = point[j]
    rows[v, OFFSET] = offset + rise


@kernel
def flip_far(halves, links, rows, listed, targets, aim, sigma2, limits):
    """Flip listed half-edges' edges where that leaves smaller gaps; returns how many."""
    done = 0
    for i in range(listed.size):
        h = listed[i]
        g = halves[h, TWIN]
        if g < 0 or halves[h, CREASE] >= 0:
            continue
        a, b = halves[h, ORIGIN], halves[following(h), ORIGIN]
        c, d = halves[preceding(h), ORIGIN], halves[preceding(g), ORIGIN]
        va, vb = links[a, BASE], links[b, BASE]
        least_a = 5 if links[va, KIND] == INTERIOR else 4
        least_b = 5 if links[vb, KIND] == INTERIOR else 4
        if links[va, EDGES] < least_a or links[vb, EDGES] < least_b:
            continue
        before, after = tangents_of_flip(rows, a, b, c, d, sigma2)
        if after < limits[0] and after < before:
            continue
        if not flip_allowed(rows, a, b, c, d, limits):
            continue
        now = pair_gap(links, rows, (a, b, c), (b, a, d), h, g, targets, aim)
        if now == 0.0 or adjacent(halves, links, links[c, BASE], links[d, BASE]):
            continue
        then = pair_gap(links, rows, (c, a, d), (d, b, c), h, g, targets, aim)
        if then < LEAST_GAIN * now:
            flip_edge(halves, links, h)
            done += 1
    return done
