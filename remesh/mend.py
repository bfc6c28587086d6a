"""The worst angles raised to a floor: where moving vertices is not enough, edges change too.

A search that moves vertices ends where the connectivity does not allow more: three neighbours with
four edges each, or a corner of a jagged boundary with two triangles where there is room for four.
Around each triangle below the floor edges are flipped, split or collapsed, one at a time (and two
in a row where one does not do), followed by flips and a search near it, until nothing is left
below the floor there; if that cannot be had, the best is kept. The rest of the mesh stays.
"""

import math

import numpy as np

from remesh.collapse import collapse_half_edge
from remesh.compiled import allocating, kernel
from remesh.connectivity import (
    BASE,
    CREASE,
    EDGES,
    INTERIOR,
    KIND,
    MAX_RING,
    ORIGIN,
    TRIANGLES,
    TWIN,
    adjacent,
    flip_edge,
    following,
    preceding,
    room,
)
from remesh.embedding import agreement, degrees_of, least_angle, squared_length
from remesh.flip import flip_allowed, tangents_of_flip
from remesh.optimise import optimise_vertices
from remesh.region import Region, half_edges_of, neighbourhood, rings_around
from remesh.split import split_half_edge

HELD_FLOOR = 23.0  # [degrees] where two corners cannot move freely
MARGIN = 1.004  # times the floor: what searches try to reach
TURNS, SWEEPS = 2, 6
PASSES = (False, False, True, False, True)  # whether two changes in a row are tried
MOST, MOST_SHARE, MOST_DEEP, BRANCHES = 40, 0.002, 12, 3  # triangles and their share; deep; first
STEP, DIRECTIONS, WEIGHT = 0.15, 6, 20.0
LEAST_GAIN, FLIP_GAIN = 0.9, 1e-8  # of the cost; of the tangent of the least angle
MOST_SPLITS, MOST_ADDED = 64, 0.008  # splits there is room for; vertices added, as a share
LEAST_TRIES, TRIES_SHARE = 500, 1 / 15  # changes tried at most, and more by share of triangles
RINGS, CORE = 6, 2  # around a triangle: what is remembered; where a second change may begin
KEEP, FLIP, SPLIT, COLLAPSE = range(4)


def raise_worst(work, floor, sigma, least_agreement, along_curves):
    """Change edges around triangles with 3D angles below a floor; return how many are left.

    Parameters
    ----------
    work : WorkMesh
        Compacted here, before and after.
    floor : float [degrees]
        Where two corners are held, on curves or in corners, at most HELD_FLOOR.
    sigma : float [unit of the points]
        Of the angles that the searches improve besides.
    least_agreement : float
        Least cosine between triangles and the surface's normals at their corners.
    along_curves : float [unit of the points]
        No edge of a crease may come to be farther from its curve than this and than before.
    """
    work.compact()
    mender = Mender(work, floor, sigma, least_agreement, along_curves)
    hopeless = set()
    for deep in PASSES:
        listed = mender.below_floor()
        most = MOST_DEEP if deep else MOST + int(MOST_SHARE * work.counts[TRIANGLES])
        known = hopeless if not deep else ()
        for t in [t for t in listed if mender.corners_of(t) not in known][:most]:
            corners = mender.corners_of(t)
            if corners[0] >= 0 and mender.tries > 0 and not mender.mend(t, deep):
                hopeless.add(corners)
        if len(listed) == 0:
            break
    left = len(mender.below_floor())
    work.compact()
    return left


class Mender:
    """What is tried around one triangle at a time (see `raise_worst`)."""

    def __init__(self, work, floor, sigma, least_agreement, along_curves):
        self.work, self.sigma, self.along_curves = work, sigma, along_curves
        self.agreement = least_agreement
        self.floors = np.array([floor, min(floor, HELD_FLOOR)])
        self.limits = np.array([0.0, 0.0, least_agreement])
        work.reserve(MOST_SPLITS)
        self.steps = np.zeros(len(work.links))
        self.mark = np.zeros(len(work.links), np.int64)
        self.tries = LEAST_TRIES + int(TRIES_SHARE * work.counts[TRIANGLES])
        self.spare = int(MOST_ADDED * work.vertices)  # vertices that may still be added

    def corners_of(self, t):
        """The rows at the corners of a triangle, sorted."""
        return tuple(sorted(self.work.halves[3 * t : 3 * t + 3, ORIGIN].tolist()))

    def deficits(self, triangles):
        """By how many degrees triangles are below their floors."""
        found = np.empty(len(triangles))
        work = self.work
        deficits_of(work.halves, work.links, work.rows, triangles, self.floors, found)
        return found

    def cost(self, triangles):
        """Sum of the squared deficits of triangles, and their least agreement."""
        work, found = self.work, np.empty(len(triangles))
        return deficits_of(work.halves, work.links, work.rows, triangles, self.floors, found)

    def worst(self, triangles):
        """The triangle that is farthest below its floor, -1 if there is none."""
        deficits = self.deficits(triangles)
        return int(triangles[deficits.argmax()]) if deficits.max() > 0.0 else -1

    def below_floor(self):
        """Triangles below their floor, the worst first."""
        deficits = self.deficits(np.arange(int(self.work.counts[TRIANGLES])))
        below = np.flatnonzero(deficits > 0.0)
        return below[np.argsort(-deficits[below], kind="stable")]

    def mend(self, t, deep):
        """Try changes around a triangle, also two in a row if `deep`; whether any was kept."""
        region = Region(self.work, t, RINGS)
        before, agree = self.cost(region.triangles())
        if before == 0.0:
            return True
        agree = min(agree, self.agreement)
        found = self.try_all(region, t, agree)
        best, steps = LEAST_GAIN * before, ()
        if found and found[0][0] < best:
            best, steps = found[0][0], (found[0][1],)
        core = rings_around(self.work, t, CORE)[1]
        for _, first in found[:BRANCHES] if deep and best > 0.0 else ():
            state = region.state()
            self.change(region, *first)
            worst = self.worst(np.append(core, region.added()))
            then = self.try_all(region, worst, agree) if worst >= 0 else []
            if then and then[0][0] < best:
                best, steps = then[0][0], (first, then[0][1])
            region.restore(state)
        self.spare += self.work.vertices
        for step in steps:
            self.change(region, *step)
        self.spare -= self.work.vertices
        return len(steps) > 0

    def try_all(self, region, t, least_agreement):
        """Costs of the changes around a triangle, and these, the best first; all are undone."""
        found, state = [], region.state()
        near = neighbourhood(self.work, t)
        for kind, h in changes_at(self.work.halves, t):
            if kind == SPLIT and self.spare <= 0:
                continue
            if self.change(region, kind, h, t, near):
                cost, agree = self.cost(region.triangles())
                if agree >= least_agreement:
                    found.append((cost, (kind, h, t)))
            region.restore(state)
            if found and found[-1][0] == 0.0:
                break
        return sorted(found)

    def change(self, region, kind, h, t, near=None):
        """Make a change, then flip and search around triangle t; False if it is not allowed."""
        work, self.tries = self.work, self.tries - 1
        inner, triangles = neighbourhood(work, t) if near is None else near
        aim = MARGIN * self.floors[1 if is_held(work.halves, work.links, t) else 0]
        used = int(work.counts[TRIANGLES])
        if kind != KEEP:
            made = -1
            if room(work.halves, work.links, work.counts, 2, 2):
                made = change_edge(
                    work.halves, work.links, work.rows, work.labels, work.counts, kind, h,
                    self.limits, work.carrier.reference, work.curves, self.mark,
                )  # fmt: skip
            if made < 0:
                return False
            inner = np.unique(np.append(inner, made))
            inner = inner[work.links[inner, BASE] == inner]
        added = np.arange(used, int(work.counts[TRIANGLES]))
        sides = half_edges_of(np.concatenate([triangles, added]))
        for turn in range(TURNS):
            if kind != FLIP or turn > 0:
                flip_listed(work.halves, work.links, work.rows, sides, self.limits)
            self.steps[inner] = STEP
            optimise_vertices(
                work, self.sigma, self.steps, 2, aim, WEIGHT, self.agreement, 0.1, SWEEPS,
                DIRECTIONS, along_curves=self.along_curves, listed=inner,
            )  # fmt: skip
        return True


def changes_at(halves, t):
    """Kinds of change, each with the half-edge to try it at, around a triangle."""
    own = [3 * t, 3 * t + 1, 3 * t + 2]
    beside = [int(halves[h, TWIN]) for h in own if halves[h, TWIN] >= 0]
    around = own + [k for h in beside for k in (following(h), preceding(h))]
    yield KEEP, own[0]
    for kind in (FLIP, SPLIT, COLLAPSE):
        for h in around:
            yield kind, h


@kernel
def is_held(halves, links, t):
    """Whether two corners of a triangle cannot move freely."""
    held = 0
    for k in range(3):
        if links[links[halves[3 * t + k, ORIGIN], BASE], KIND] != INTERIOR:
            held += 1
    return held >= 2


@kernel
def deficits_of(halves, links, rows, listed, floors, deficits):
    """Write by how many degrees listed triangles are below their floors (0: none, or free).

    Returns the sum of their squares, and the least agreement with the surface's normals.
    """
    total, least = 0.0, 1.0
    for i in range(listed.size):
        t = listed[i]
        deficits[i] = 0.0
        a, b, c = halves[3 * t, ORIGIN], halves[3 * t + 1, ORIGIN], halves[3 * t + 2, ORIGIN]
        if a < 0:
            continue
        sine, cosine = least_angle(
            squared_length(rows, a, b, 0.0), squared_length(rows, b, c, 0.0),
            squared_length(rows, c, a, 0.0),
        )  # fmt: skip
        floor = floors[1] if is_held(halves, links, t) else floors[0]
        deficits[i] = max(floor - degrees_of(sine, cosine), 0.0)
        total += deficits[i] * deficits[i]
        least = min(least, agreement(rows, a, b, c))
    return total, least


@kernel
def may_flip(halves, links, rows, h, limits):
    """Whether the edge of a half-edge may be flipped as far as edges and normals go."""
    g = halves[h, TWIN]
    if halves[h, ORIGIN] < 0 or g < 0 or halves[h, CREASE] >= 0:
        return False
    a, b = halves[h, ORIGIN], halves[following(h), ORIGIN]
    c, d = halves[preceding(h), ORIGIN], halves[preceding(g), ORIGIN]
    va, vb = links[a, BASE], links[b, BASE]
    least_a = 5 if links[va, KIND] == INTERIOR else 4
    least_b = 5 if links[vb, KIND] == INTERIOR else 4
    if links[va, EDGES] < least_a or links[vb, EDGES] < least_b:
        return False
    if not flip_allowed(rows, a, b, c, d, limits):
        return False
    return not adjacent(halves, links, links[c, BASE], links[d, BASE])


@kernel
def flip_listed(halves, links, rows, listed, limits):
    """Flip listed half-edges' edges where that leaves a larger least 3D angle."""
    for i in range(listed.size):
        h = listed[i]
        g = halves[h, TWIN]
        if halves[h, ORIGIN] < 0 or g < 0 or halves[h, CREASE] >= 0:
            continue
        a, b = halves[h, ORIGIN], halves[following(h), ORIGIN]
        c, d = halves[preceding(h), ORIGIN], halves[preceding(g), ORIGIN]
        before, after = tangents_of_flip(rows, a, b, c, d, 0.0)
        if after > before + FLIP_GAIN and may_flip(halves, links, rows, h, limits):
            flip_edge(halves, links, h)


@allocating
def change_edge(halves, links, rows, labels, counts, kind, h, limits, reference, curves, mark):
    """Flip, split or collapse the edge of a half-edge; -1 if it is not allowed, else a vertex."""
    point = np.empty(9)
    v = links[halves[h, ORIGIN], BASE]
    if kind == SPLIT:
        code = halves[h, CREASE]
        if code >= 0 and curves[4][code >> 1] == 1:
            return -1
        return split_half_edge(
            halves, links, rows, labels, counts, h, limits[2], reference, curves, point
        )
    if halves[h, CREASE] >= 0:
        return -1
    if kind == FLIP:
        if not may_flip(halves, links, rows, h, limits):
            return -1
        flip_edge(halves, links, h)
        return v
    fans = np.empty((2, MAX_RING), np.int64)
    w = links[halves[following(h), ORIGIN], BASE]
    if not collapse_half_edge(
        halves, links, rows, counts, h, 0.0, math.inf, limits, fans[0], fans[1], mark,
        (np.empty(0), 0.0, math.inf),
    ):  # fmt: skip
        return -1
    return v if links[v, BASE] == v else w
