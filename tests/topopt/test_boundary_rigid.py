"""Rigid motions that nothing holds are found and named."""

from dataclasses import replace

import numpy as np
import pytest

from meshes import InvalidCase, TetMesh
from meshes.structured import bcc_box
from tests.topopt.problems import bridge, table, tower, whole_table
from topopt.boundary import boundary_conditions, check_problem, check_rigid_motions
from topopt.problem import Box, Support
from topopt.rigid_motions import describe_motions, free_motions

POINTS = np.random.default_rng(5).uniform(-1, 1, (40, 3))


def held(*nodes_and_axes):
    fixed = np.zeros((len(POINTS), 3), bool)
    for node, axes in nodes_and_axes:
        fixed[node, list(axes)] = True
    return fixed


def refusal(problem, cells=(12, 4, 4), early=False):
    with pytest.raises(InvalidCase) as caught:
        if early:
            check_problem(problem)
        mesh = bcc_box(problem.domain.lower, problem.domain.upper, cells)
        check_rigid_motions(mesh, problem, boundary_conditions(mesh, problem).fixed)
    return str(caught.value)


@pytest.mark.parametrize("problem", [bridge(), table(), tower()])
def test_the_three_cases_are_held(problem):
    mesh = bcc_box(problem.domain.lower, problem.domain.upper, (12, 4, 4))
    check_rigid_motions(mesh, problem, boundary_conditions(mesh, problem).fixed)


@pytest.mark.parametrize("early", [True, False])
def test_the_whole_table_on_sliding_feet_has_three_free_motions(early):
    message = refusal(whole_table(), (48, 14, 2), early)
    assert "3 rigid motions free" in message
    assert (
        "translation along x; translation along y; rotation about the axis parallel to z" in message
    )
    assert "through (0.048, 0.014, 0.01) m" in message
    assert (
        "support 'foot 00', support 'foot 01', support 'foot 10' and support 'foot 11'" in message
    )


def test_the_tower_without_symmetry_slides_along_y():
    message = refusal(replace(tower(), symmetry=()), early=True)
    assert "support 'foot' leaves 1 rigid motion free (translation along y)" in message


def test_without_supports_there_are_six():
    message = refusal(replace(bridge(), supports=(), symmetry=()), early=True)
    assert "6 rigid motions free" in message and "no support at all" in message


def test_symmetry_planes_hold_what_supports_leave():
    sliding = replace(bridge(), supports=(Support("ends", bridge().supports[0].region, (2,)),))
    check_problem(sliding)
    one_plane = replace(sliding, symmetry=sliding.symmetry[:1])
    message = refusal(one_plane, early=True)
    assert "symmetry plane x=0 leave 1 rigid motion free (translation along y)" in message


def test_a_hinge_is_named_with_its_line():
    hinge = Support("hinge", Box((0.05, -1, 0), (0.05, 1, 0)))
    problem = replace(bridge(), supports=(hinge,), symmetry=())
    assert (
        "1 rigid motion free (rotation about the axis parallel to y through (0.05, 0.0075, 0) m)"
        in (refusal(problem))
    )


def test_one_held_point_leaves_three_rotations_through_it():
    translations, rotations = free_motions(POINTS, held((7, (0, 1, 2))))
    assert len(translations) == 0 and len(rotations) == 3
    for direction, centre, pitch in rotations:
        np.testing.assert_allclose(np.cross(direction, POINTS[7] - centre), 0, atol=1e-9)
        assert abs(pitch) < 1e-9


@pytest.mark.parametrize(
    "constraints",
    [
        (),
        ((0, (0,)),),
        ((0, (0, 1, 2)), (1, (1,))),
        ((0, (2,)), (1, (2,)), (2, (2,))),
        ((0, (0, 1, 2)), (1, (0, 1, 2))),
        ((0, (0, 1, 2)), (1, (0, 1, 2)), (2, (0,))),
        ((3, (0, 1)), (9, (2,)), (11, (1,))),
    ],
)
def test_every_motion_vanishes_where_held_and_none_is_missed(constraints):
    fixed = held(*constraints)
    translations, rotations = free_motions(POINTS, fixed)
    motions = [np.broadcast_to(t, POINTS.shape) for t in translations]
    for direction, centre, pitch in rotations:
        motions.append(np.cross(direction, POINTS - centre) + pitch * direction)
    for motion in motions:
        assert np.abs(motion[fixed]).max(initial=0.0) < 1e-9
        assert np.abs(motion).max() > 0.1
    independent = sum(len(axes) for _, axes in constraints)  # generic: no row is redundant ...
    redundant = {(0, 1, 2, 0, 1, 2): 1, (0, 1, 2, 0, 1, 2, 0): 1}  # ... but for a fixed distance
    key = tuple(axis for _, axes in constraints for axis in axes)
    assert len(motions) == 6 - independent + redundant.get(key, 0)
    if motions:
        flat = np.array([motion.ravel() for motion in motions])
        assert np.linalg.matrix_rank(flat, tol=1e-6) == len(motions)


def test_a_screw_is_called_one():
    fixed = held((3, (0, 1)), (9, (2,)), (11, (1,)), (20, (0,)))
    translations, rotations = free_motions(POINTS, fixed)
    ((direction, centre, pitch),) = rotations
    assert not len(translations) and abs(pitch) > 1e-4
    motion = np.cross(direction, POINTS - centre) + pitch * direction
    assert np.abs(motion[fixed]).max() < 1e-9
    (words,) = describe_motions(POINTS, translations, rotations)
    assert words.startswith("screw motion about the axis parallel to (")


def test_each_part_of_a_mesh_in_two_must_be_held():
    near = bcc_box((0, 0, 0), (1, 1, 1), (2, 2, 2))
    far = bcc_box((3, 0, 0), (4, 1, 1), (2, 2, 2))
    n = len(near.points)
    mesh = TetMesh(
        np.concatenate([near.points, far.points]),
        np.concatenate([near.tets, far.tets + n]),
        np.concatenate([near.facets, far.facets + n]),
        np.concatenate([near.facet_patch, far.facet_patch]),
        near.patches,
    )
    fixed = np.zeros((2 * n, 3), bool)
    fixed[:n] = True
    with pytest.raises(InvalidCase, match=r"part 2 of 2 of the domain: .* 6 rigid motions free"):
        check_rigid_motions(mesh, bridge(), fixed)
    fixed[n:] = True
    check_rigid_motions(mesh, bridge(), fixed)


@pytest.mark.parametrize("scale", [1e-9, 1e9])
@pytest.mark.parametrize("shift", [0.0, 100.0])
def test_scale_and_place_do_not_matter(scale, shift):
    points = scale * (POINTS + shift)
    slide = held(*((k, (2,)) for k in range(20)))
    words = describe_motions(points, *free_motions(points, slide))
    assert [word.split(" through")[0] for word in words] == [
        "translation along x", "translation along y", "rotation about the axis parallel to z"
    ]  # fmt: skip
    assert not free_motions(points, held((0, (0, 1, 2)), (1, (0, 1, 2)), (2, (0, 1, 2))))[1]
