"""The proof that is renewed in part: the same as a new one, and never below what samples find."""

import numba
import numpy as np
import pytest

from meshes.box_tree_kernels import mark_touching
from meshes.closest_point import ClosestPoint, sample_surface
from remesh.bounded import BoundLimits, coarsen, make_sure, simplify_within
from remesh.bounded_insert import insert_points
from remesh.bounded_mesh import BoundedMesh
from remesh.bounded_proof import BoundProof
from remesh.bounded_relax import relax_within
from tests.remesh.reference import boxes_touching
from tests.remesh.shapes import jittered
from tests.shapes import icosphere, torus


def test_marked_triangles_are_those_whose_boxes_touch():
    mesh = torus(n_major=16, n_minor=8)
    rng = np.random.default_rng(0)
    centre = rng.uniform(-1.4, 1.4, (5, 3))
    boxes = np.concatenate([centre - 0.1, centre + [0.3, 0.2, 0.1]], axis=1)
    boxes[0] = np.tile(mesh.points[3], 2)  # one point
    search = ClosestPoint(mesh.points, mesh.faces)
    marks = np.zeros(len(mesh.faces), bool)
    mark_touching(boxes, search.tree, marks)
    found = np.empty_like(marks)
    found[search.order] = marks
    expected = boxes_touching(boxes, mesh.points[mesh.faces])
    assert 0 < expected.sum() < len(expected)
    np.testing.assert_array_equal(found, expected)


def coarse(error):
    """A rough sphere made coarser by samples alone, and its limits."""
    source = jittered(icosphere(4), 0.1, 3)
    limits = BoundLimits(error)
    work = BoundedMesh(source, error)
    coarsen(work, limits, lambda share: None)
    return work, limits


def check_against_samples(proof, limits):
    """No sample of either surface lies farther than the bound of its face."""
    work, mesh, rng = proof.work, proof.mesh, np.random.default_rng(1)
    for here, there, upper in (
        (mesh, work.source, proof.faces.upper[proof.alive]),
        (work.source, mesh, proof.source.upper),
    ):
        points, faces = sample_surface(here.points, here.faces, 40_000, rng)
        distance = ClosestPoint(there.points, there.faces).query(points)[2]
        bounds = np.maximum(upper[faces], limits.error)  # below they need not be sharp
        assert (distance <= bounds * (1 + 1e-12)).all()
        assert (distance <= upper.max() * (1 + 1e-12)).all()


def test_a_renewed_proof_is_as_good_as_a_new_one():
    work, limits = coarse(0.02)
    proof = BoundProof(work, limits)
    proof.renew()
    whole = proof.compared
    rng = np.random.default_rng(2)
    for turn in range(4):
        check_against_samples(proof, limits)
        faces, places, targets = proof.missed()
        work.add_samples(faces, targets)
        insert_points(work, faces, places, targets, targets, limits)
        relax_within(work, limits, 1, work.vertices_around(faces, 1))
        if turn == 1:  # something that is no improvement
            moved = rng.choice(np.flatnonzero(work.state[4] >= 0), 3)
            work.state[6][moved] *= 1.05
        before = proof.compared
        proof.renew()
        assert proof.compared - before < whole
        new = BoundProof(work, limits)
        new.renew()
        assert (proof.faces.missing(limits) == new.faces.missing(limits)).all()
        assert (proof.source.missing(limits) == new.source.missing(limits)).all()


def test_only_what_changed_is_compared_again():
    work, limits = coarse(0.02)
    make_sure(work, limits)
    proof = BoundProof(work, limits)
    proof.renew()
    assert proof.proved <= limits.error
    whole = proof.compared
    proof.renew()
    assert proof.compared == whole
    one = int(np.flatnonzero(work.state[4] >= 0)[0])
    work.state[6][one] *= 1.2
    proof.renew()
    assert 0 < proof.compared - whole < 0.2 * whole
    assert proof.proved > 0.1
    faces, places, targets = proof.missed()
    assert len(faces) > 0
    gap = np.linalg.norm(places - targets, axis=1)
    assert gap[0] == pytest.approx(proof.proved, rel=0.02)
    work.state[6][one] /= 1.2
    proof.renew()
    assert proof.proved <= limits.error


def test_same_bits_with_one_thread_and_two():
    source, before, results = jittered(icosphere(4), 0.1, 3), numba.get_num_threads(), []
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            results.append(simplify_within(source, BoundLimits(0.02)))
    finally:
        numba.set_num_threads(before)
    one, two = results
    np.testing.assert_array_equal(one.mesh.points, two.mesh.points)
    np.testing.assert_array_equal(one.mesh.faces, two.mesh.faces)
    assert (one.distance, one.normal_angle) == (two.distance, two.normal_angle)
