"""The structured box: exact volume, closed outward boundary, good angles."""

import numpy as np
import pytest

from meshes.structured import bcc_box
from meshes.tet_mesh import tet_volumes
from tests import shapes


@pytest.mark.parametrize("cells", [(1, 1, 1), (5, 3, 4)])
def test_bcc_box_fills_the_box(cells):
    lower, upper = np.array([0.0, -1.0, 2.0]), np.array([5.0, 2.0, 6.0])
    mesh = bcc_box(lower, upper, cells)
    volumes = tet_volumes(mesh.points, mesh.tets)
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(np.prod(upper - lower), rel=1e-13)
    assert len(np.unique(mesh.tets)) == len(mesh.points)


def test_bcc_box_boundary_is_outward_and_on_its_planes():
    mesh = bcc_box((0, 0, 0), (5, 3, 4), (5, 3, 4))
    corners = mesh.points[mesh.facets]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    for index, patch in enumerate(mesh.patches):
        here = mesh.facet_patch == index
        assert np.all(patch.plane.signed_distance(corners[here]) == 0)
        a, b = (i for i in range(3) if patch.plane.normal[i] == 0)
        size = np.array([5, 3, 4.0])
        np.testing.assert_allclose(
            area[here].sum(axis=0), np.array(patch.plane.normal) * size[a] * size[b], atol=1e-12
        )


@pytest.mark.parametrize(
    "mesh, volume",
    [
        (shapes.icosphere(4), 4 * np.pi / 3),
        (shapes.torus(n_major=200, n_minor=80), 2 * np.pi**2 * 0.09),
        (shapes.cube(2.0), 8.0),
    ],
)
def test_shapes_are_outward(mesh, volume):
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(volume, rel=5e-3)
