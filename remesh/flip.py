"""Edge flips: towards even valences, towards larger least angles, or by the thesis's rule."""

import math

import numpy as np

from remesh.compiled import allocating, hot, kernel
from remesh.connectivity import (
    BASE,
    CREASE,
    EDGES,
    IDEAL,
    INTERIOR,
    KIND,
    MAX_RING,
    ORIGIN,
    ROWS,
    TRIANGLES,
    TWIN,
    adjacent,
    flip_edge,
    following,
    preceding,
    ring,
)
from remesh.embedding import (
    agreement,
    as_tangents,
    least_tangent,
    squared_length,
    triangle_normal,
)

VALENCE, DELAUNAY, THESIS = 0, 1, 2
FEW = 2  # share of the half-edges, as a divisor, up to which those to look at are listed
LEAST_GAIN = 1e-8  # of the tangent of the least angle, for a flip


def flip_edges(work, sigma, limits, rule=DELAUNAY, passes=5, ridge_angle=60.0, chosen=None):
    """Flip edges in index order until no flip is left, at most `passes` times; return how many.

    Parameters
    ----------
    work : WorkMesh
    sigma : float [unit of the points]
    limits : (angle6, angle3, agreement)
        No triangle may come out below these, unless it was no better before.
    rule : VALENCE, DELAUNAY or THESIS
        VALENCE evens out how many edges meet at the vertices; DELAUNAY enlarges the smaller of
        the two triangles' least 6D angles; THESIS flips where the two opposite 6D angles sum to
        pi or more and the triangles' normals differ by less than `ridge_angle` [degrees].
    passes : int
    ridge_angle : float [degrees]
    chosen : (n,) bool array, optional
        Rows near which to look at first; all if not given.
    """
    limits = as_tangents(limits)
    dirty = np.ones(len(work.links), np.uint8) if chosen is None else chosen.astype(np.uint8)
    total = 0
    for _ in range(passes):
        done = sweep_flips(
            work.halves, work.links, work.rows, near_dirty(work, dirty), dirty, sigma**2, limits,
            rule, math.cos(math.radians(ridge_angle)),
        )  # fmt: skip
        total += done
        if done == 0:
            break
    return total


def near_dirty(work, dirty):
    """Half-edges, in order, among which are those near a vertex with dirty = 1."""
    chosen = np.zeros(3 * int(work.counts[TRIANGLES]), np.bool_)
    if mark_near_dirty(work.halves, work.links, work.counts, dirty, chosen.size // FEW, chosen):
        return np.flatnonzero(chosen)
    return np.arange(chosen.size)


@allocating
def mark_near_dirty(halves, links, counts, dirty, most, chosen):
    """Mark one half-edge of each edge of the triangles at vertices with dirty = 1.

    Returns whether it came to an end: it stops where triangles meet `most` such vertices.
    """
    fan = np.empty(MAX_RING, np.int64)
    found = 0
    for v in range(counts[ROWS]):
        if dirty[v] == 0 or links[v, BASE] != v:
            continue
        count, _ = ring(halves, links, v, fan)
        for i in range(count):
            h = fan[i]
            for _ in range(2):  # the spoke, and the edge opposite to the vertex
                if halves[h, TWIN] >= 0:
                    chosen[min(h, halves[h, TWIN])] = True
                h = following(h)
        found += 2 * count
        if found > most:
            return False
    return True


@hot
def evens_valences(links, a, b, c, d):
    """Whether taking an edge from a, b and giving one to c, d brings them nearer to ideal."""
    give = links[a, EDGES] - links[a, IDEAL] + links[b, EDGES] - links[b, IDEAL]
    take = links[c, EDGES] - links[c, IDEAL] + links[d, EDGES] - links[d, IDEAL]
    return take - give + 2 < 0  # half the change of the sum of squared excesses


@kernel
def opposite_cosine(rows, c, a, b, sigma2):
    """6D cosine of the angle at c of the triangle a, b, c."""
    to_a, to_b = squared_length(rows, c, a, sigma2), squared_length(rows, c, b, sigma2)
    product = math.sqrt(to_a * to_b)
    if product <= 0.0:
        return 1.0
    return 0.5 * (to_a + to_b - squared_length(rows, a, b, sigma2)) / product


@kernel
def thesis_wants(rows, a, b, c, d, sigma2, ridge_cosine):
    """The thesis's rule (section 2.4.3): theta + rho >= pi in 6D, and no ridge between."""
    theta = opposite_cosine(rows, c, a, b, sigma2)
    rho = opposite_cosine(rows, d, a, b, sigma2)
    if theta + rho >= 0.0:  # theta + rho > pi  <=>  cos theta + cos rho < 0
        return False
    x, y, z = triangle_normal(rows, a, b, c)
    u, v, w = triangle_normal(rows, b, a, d)
    size = math.sqrt((x * x + y * y + z * z) * (u * u + v * v + w * w))
    return x * u + y * v + z * w >= ridge_cosine * size


@hot
def tangents_of_flip(rows, a, b, c, d, sigma2):
    """Tangents of the least 6D angle of the two triangles at edge a-b, and at edge c-d."""
    ab, cd = squared_length(rows, a, b, sigma2), squared_length(rows, c, d, sigma2)
    bc, ca = squared_length(rows, b, c, sigma2), squared_length(rows, c, a, sigma2)
    ad, db = squared_length(rows, a, d, sigma2), squared_length(rows, d, b, sigma2)
    before = min(least_tangent(ab, bc, ca), least_tangent(ab, ad, db))
    return before, min(least_tangent(cd, ca, ad), least_tangent(cd, db, bc))


@hot
def flip_allowed(rows, a, b, c, d, limits):
    """Whether the triangles (c, a, d) and (d, b, c) may replace (a, b, c) and (b, a, d)."""
    after = min(agreement(rows, c, a, d), agreement(rows, d, b, c))
    if after < limits[2]:
        before = min(agreement(rows, a, b, c), agreement(rows, b, a, d))
        if after < before or after <= 0.0:
            return False
    if limits[1] <= 0.0:
        return True
    before, after = tangents_of_flip(rows, a, b, c, d, 0.0)
    return after >= limits[1] or after >= before


@kernel
def sweep_flips(halves, links, rows, listed, dirty, sigma2, limits, rule, ridge_cosine):
    """One pass over listed edges near a vertex with dirty = 1; returns the number of flips.

    Vertices whose edges changed are left with dirty = 1, all others with 0.
    """
    done = 0
    for index in range(listed.size):
        h = listed[index]
        g = halves[h, TWIN]
        if halves[h, ORIGIN] < 0 or g < h or halves[h, CREASE] >= 0:
            continue
        a, b = halves[h, ORIGIN], halves[following(h), ORIGIN]
        c, d = halves[preceding(h), ORIGIN], halves[preceding(g), ORIGIN]
        va, vb, vc, vd = links[a, BASE], links[b, BASE], links[c, BASE], links[d, BASE]
        if max(max(dirty[va], dirty[vb]), max(dirty[vc], dirty[vd])) == 0:
            continue
        least_a = 5 if links[va, KIND] == INTERIOR else 4
        least_b = 5 if links[vb, KIND] == INTERIOR else 4
        if links[va, EDGES] < least_a or links[vb, EDGES] < least_b:
            continue
        if rule == VALENCE:
            if not evens_valences(links, va, vb, vc, vd):
                continue
            _, after = tangents_of_flip(rows, a, b, c, d, sigma2)
            if after < limits[0]:
                continue
        elif rule == DELAUNAY:
            before, after = tangents_of_flip(rows, a, b, c, d, sigma2)
            if after <= before + LEAST_GAIN:
                continue
        elif not thesis_wants(rows, a, b, c, d, sigma2, ridge_cosine):
            continue
        if not flip_allowed(rows, a, b, c, d, limits):
            continue
        if adjacent(halves, links, vc, vd):
            continue
        flip_edge(halves, links, h)
        for vertex in (va, vb, vc, vd):
            dirty[vertex] = 2
        done += 1
    for vertex in range(dirty.size):
        dirty[vertex] = 1 if dirty[vertex] == 2 else 0
    return done
