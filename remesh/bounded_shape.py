"""Better shapes within an error bound: worst angles raised, sizes graded; the bound stays proved.

Vertices are moved along the surface, edges flipped, and edges that are the longest of both their
triangles halved (Rivara 1997) near triangles whose angles are below a floor, or that are larger
than a graded field allows. All keep the samples within the bound; halving changes no surface at
all. Then what changed is proved anew. Where the bound does not hold, triangles cross or lie
against the normals, all is undone and made again with more samples there, and at last without
changes there.
"""

from dataclasses import dataclass, replace

import numpy as np

from meshes.closest_point import ClosestPoint
from meshes.edges import edge_table
from meshes.quality import face_areas
from meshes.self_intersection import self_intersecting_faces
from remesh.bounded_proof import closest
from remesh.bounded_shape_kernels import (
    CLOSED,
    OPEN,
    embed_vertices,
    halve_faces,
    measure_shapes,
    sweep_places,
    sweep_turns,
)
from remesh.sizing import graded

FLOOR, FLOOR_6D, FLOOR_3D = 25.0, 22.0, 10.0  # [degrees] in space alone; both with sigma
TIGHTER = 0.95  # of the bound: what samples may use where shapes are to be better
PROVABLE = 1.0 - 1e-6  # of the bound, of what is to be proved again
ROUNDS, SWEEPS = 8, 3
SAMPLED = 4  # turns that get samples where the bound did not hold; in later ones nothing changes
MOST_TURNS = 8
LEAST_HALVED = 4.0  # of the bound: shorter edges are not halved for the sake of angles
LARGER = 1.05  # than the field: triangles that are cut
MOST_GRADINGS = 40


@dataclass(frozen=True)
class ShapeAims:
    """What the shapes are to be.

    Parameters
    ----------
    quality : bool
        Whether angles are improved.
    sigma : float [unit of the points]
        Of the embedding in which they are; 0 for those in space.
    growth : float or None
        What sizes may grow by, over the way along the surface.
    fix_boundary : bool
    """

    quality: bool
    sigma: float = 0.0
    growth: float | None = None
    fix_boundary: bool = False

    def figures(self, error):
        """(sigma^2, floor, floor in space, squared bound) for the kernels."""
        bound2 = (PROVABLE * error) ** 2
        if self.sigma > 0.0:
            return self.sigma**2, FLOOR_6D, FLOOR_3D, bound2
        return 0.0, FLOOR, FLOOR, bound2


def shape_within(work, proof, limits, aims, flatten):
    """Better the shapes of a surface that was proved to be within its bound.

    Parameters
    ----------
    work : BoundedMesh
    proof : BoundProof
        Of it; renewed here.
    limits : BoundLimits
    aims : ShapeAims
    flatten : callable
        Puts the points of planar labels into their planes.
    """
    if aims.growth is not None:
        sizes = vertex_sizes(work)
        proved(work, proof, limits, lambda open_to: grade(work, limits, aims, sizes, open_to))
    if aims.quality:
        tighter = replace(limits, error=TIGHTER * limits.error)

        def change(open_to):
            improve(work, tighter, aims, open_to)
            flatten(work)

        proved(work, proof, limits, change)


def proved(work, proof, limits, change):
    """Make a change; where the bound is not proved after it, make it again without what failed."""
    before = work.saved()
    already = wrong(proof, limits)[0]
    failed = np.zeros((0, 3))
    for turn in range(MOST_TURNS):
        open_to = np.full(len(work.state[4]), OPEN, np.int8)
        if turn >= SAMPLED:
            open_to[corners_near(work, failed, turn - SAMPLED)] = CLOSED
        change(open_to)
        proof.renew()
        count, places, targets = wrong(proof, limits)
        if (count <= already).all():
            return
        known = failed if turn >= SAMPLED else failed[:0]
        failed = np.concatenate([known, places, targets])
        work.restore(before)
        if turn < SAMPLED:
            mesh, alive = work.to_mesh()
            found = closest(ClosestPoint(mesh.points, mesh.faces), mesh, targets)[0]
            work.add_samples(alive[found], targets)
            before = work.saved()
    proof.renew()


def wrong(proof, limits):
    """Where a surface is not as it should be.

    Returns
    -------
    counts : (2,) int array
        Faces out of bounds, and those that cross or lie against the normals.
    places, targets : (k, 3) float arrays
        Points of them, and of the original.
    """
    faces, places, targets = proof.missed()
    mesh = proof.mesh
    bad = self_intersecting_faces(mesh.points, mesh.faces) | proof.inverted()
    middles = mesh.points[mesh.faces[bad]].mean(axis=1)
    near = closest(proof.work.search, proof.work.source, middles)[1]
    return (
        np.array([len(faces), bad.sum()]), np.concatenate([places, middles]),
        np.concatenate([targets, near]),
    )  # fmt: skip


def corners_near(work, places, rings):
    """Vertices of the work mesh's faces closest to places (k, 3), and of rings around them."""
    mesh, alive = work.to_mesh()
    found = closest(ClosestPoint(mesh.points, mesh.faces), mesh, places)[0]
    return np.flatnonzero(work.vertices_around(np.unique(alive[found]), rings))


class Shapes:
    """The arguments that all kernels of one change take."""

    def __init__(self, work, limits, aims, open_to):
        self.work, self.limits, self.aims, self.open_to = work, limits, aims, open_to
        self.embedded = np.zeros((len(work.state[4]), 3))
        embed_vertices(work.state, work.counts, work.reference, self.embedded)

    def rooms(self):
        """Two arrays for the numbers of samples."""
        return (np.empty(len(self.work.samples[2]), np.int64) for _ in range(2))

    def sweep(self, kernel):
        """One pass of `sweep_places` or `sweep_turns`."""
        work = self.work
        return kernel(
            work.state, work.samples, work.counts, self.limits.figures(), work.reference,
            self.aims.figures(self.work.bound), self.embedded, self.open_to, *self.rooms(),
        )  # fmt: skip

    def halve(self, faces, least):
        """Halve terminal edges near faces, none shorter than `least`; returns how many."""
        work = self.work
        work.reserve(len(faces))
        more = len(work.state[4]) - len(self.open_to)
        self.open_to = np.append(self.open_to, np.full(more, OPEN, np.int8))
        self.embedded = np.append(self.embedded, np.zeros((more, 3)), axis=0)
        return halve_faces(
            work.state, work.samples, work.counts, faces, least**2, self.aims.fix_boundary,
            work.reference, self.aims.sigma**2, self.embedded, self.open_to,
            np.zeros(len(work.state[3]), bool), *self.rooms(),
        )  # fmt: skip

    def below_floor(self):
        """Faces below their floor, the worst first."""
        work = self.work
        faces = np.flatnonzero(work.state[0][: 3 * work.counts[1] : 3] >= 0)
        costs, slacks = np.empty(len(faces)), np.empty(len(faces))
        figures = self.aims.figures(work.bound)
        measure_shapes(work.state, faces, figures, self.embedded, costs, slacks)
        order = np.argsort(slacks, kind="stable")
        return faces[order[slacks[order] < 1.0]]


def improve(work, limits, aims, open_to):
    """Moves, flips and halvings until no angle is below its floor, or nothing helps."""
    shapes = Shapes(work, limits, aims, open_to)
    least = max(2.0 * limits.min_length, LEAST_HALVED * limits.error)
    for turn in range(ROUNDS + 1):
        for _ in range(SWEEPS):
            if shapes.sweep(sweep_turns) + shapes.sweep(sweep_places) == 0:
                break
        faces = shapes.below_floor()
        if turn == ROUNDS or len(faces) == 0 or shapes.halve(faces, least) == 0:
            break


def vertex_sizes(work):
    """Edges (n,) of equilateral triangles with the mean area of those around; inf for none."""
    mesh, _ = work.to_mesh()
    areas = np.repeat(face_areas(mesh.points, mesh.faces), 3)
    count = len(mesh.points)
    total = np.bincount(mesh.faces.ravel(), areas, count)
    number = np.bincount(mesh.faces.ravel(), minlength=count)
    sizes = np.full(len(work.state[4]), np.inf)
    sizes[work.kept()] = np.sqrt(4.0 / np.sqrt(3.0) * total / number)
    return sizes


def grade(work, limits, aims, sizes, open_to):
    """Halve edges of triangles that are larger than the graded field of sizes (n,) allows."""
    shapes = Shapes(work, limits, aims, open_to)
    for _ in range(MOST_GRADINGS):
        mesh, alive = work.to_mesh()
        own = np.append(sizes, np.full(len(work.state[4]), np.inf))[work.kept()]
        edges = edge_table(mesh.faces).edges
        steps = np.linalg.norm(np.diff(mesh.points[edges], axis=1)[:, 0], axis=1)
        field = graded(own, edges, steps, aims.growth)[mesh.faces].mean(axis=1)
        here = np.sqrt(4.0 / np.sqrt(3.0) * face_areas(mesh.points, mesh.faces))
        large = np.flatnonzero(here > LARGER * field)
        order = np.argsort(-(here / field)[large], kind="stable")
        if len(large) == 0 or shapes.halve(alive[large[order]], 2.0 * limits.min_length) == 0:
            break
