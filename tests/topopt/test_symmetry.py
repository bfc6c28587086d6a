"""No, one, two or three symmetry planes: the modelled part does what the whole one does."""

from dataclasses import replace

import numpy as np
import pytest

from meshes import SymmetryPlane
from meshes.patch import Patch
from meshes.structured import bcc_box
from meshes.tet_mesh import TetMesh, boundary_facets
from topopt.boundary import attach_sets, boundary_conditions, check_problem, check_rigid_motions
from topopt.elasticity import ElasticModel
from topopt.problem import Box, BoxDomain, Load, Problem, Support

INF = np.inf
HALF = np.array([0.03, 0.02, 0.01])


def pressed_block(planes):
    """A block pressed from both ends by springs and tractions alike in all eight octants."""
    lower = -HALF.copy()
    lower[list(planes)] = 0.0
    ends = Box((-INF, -0.007, -INF), (INF, 0.007, INF))
    rim = Box((-INF, 0.02, -INF), (INF, INF, INF)), Box((-INF, -INF, -INF), (INF, -0.02, INF))
    load = [Load("up", Box((-0.013, -INF, 0.01), (0.013, INF, INF)), (0, 0, -3e4))]
    load += [Load("down", Box((-0.013, -INF, -INF), (0.013, INF, -0.01)), (0, 0, 3e4))]
    supports = [Support(f"rim{k}", region, stiffness=1e12) for k, region in enumerate(rim)]
    supports.append(Support("ends", replace(ends, lower=(0.03, -0.007, -INF)), stiffness=4e11))
    supports.append(Support("other", replace(ends, upper=(-0.03, 0.007, INF)), stiffness=4e11))
    keep = [s for s in supports if _touches(s.region, lower)]
    return Problem(
        BoxDomain(tuple(lower), tuple(HALF)),
        tuple(keep),
        tuple(item for item in load if _touches(item.region, lower)),
        0.5,
        symmetry=tuple(SymmetryPlane(axis) for axis in planes),
    )


def octant_mirrored(axes):
    """A mesh of the block's first octant, mirrored at 0 along axes, tet by tet."""
    mesh = bcc_box((0, 0, 0), HALF, (3, 2, 1))
    points, tets = mesh.points, mesh.tets
    for axis in axes:
        image = points.copy()
        image[:, axis] *= -1.0
        flipped = tets[:, [1, 0, 2, 3]] + len(points)
        points, tets = np.concatenate([points, image]), np.concatenate([tets, flipped])
    points, place = np.unique(points + 0.0, axis=0, return_inverse=True)
    tets = place[tets]
    facets = boundary_facets(tets)
    return TetMesh(points, tets, facets, np.zeros(len(facets), int), (Patch("all"),))


def _touches(region, lower):
    return all(high >= low for high, low in zip(region.upper, lower))


@pytest.mark.parametrize("planes", [(0,), (1, 2), (0, 1, 2)])
def test_the_modelled_part_moves_as_the_whole(planes):
    found = []
    for some in ((), planes):
        problem = pressed_block(some)
        mesh = octant_mirrored(set(range(3)) - set(some))
        check_problem(problem)
        mesh = attach_sets(mesh, problem)
        conditions = boundary_conditions(mesh, problem)
        check_rigid_motions(mesh, problem, conditions.fixed, conditions.springs)
        phi = 0.3 + 0.6 * np.cos(np.abs(mesh.points) @ [30.0, 50.0, 70.0]) ** 2
        state = ElasticModel(mesh, problem, conditions, "direct").solve(phi)
        found.append((mesh, phi, state))
    (whole, _, whole_state), (part, _, state) = found
    copies = 2 ** len(planes)
    assert copies * state.compliance == pytest.approx(whole_state.compliance, rel=1e-9)
    index = {tuple(np.round(p, 9)): k for k, p in enumerate(whole.points)}
    same = [index[tuple(np.round(p, 9) + 0.0)] for p in part.points]
    size = np.abs(state.displacement).max()
    np.testing.assert_allclose(state.displacement, whole_state.displacement[same], atol=1e-9 * size)
