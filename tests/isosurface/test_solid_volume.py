"""Volumes of clipped tetrahedra against convex hulls; the level of a volume."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from isosurface import extract_surface, solid_volume, volume_level
from isosurface.solid_volume import solid_volumes
from meshes import InvalidCase, PhaseField
from meshes.quality import signed_volume
from tests.isosurface import fields, reference


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_clipped_tetrahedra_are_convex_hulls(seed):
    field = fields.random_field(np.random.default_rng(seed), 1, on_level=0.1)
    volumes = solid_volumes(field)
    for tet, volume in zip(field.mesh.tets, volumes):
        corners = reference.solid_corners(field.mesh.points[tet], field.values[tet], 0.5)
        flat = len(corners) < 4 or np.linalg.matrix_rank(corners - corners[0], tol=1e-9) < 3
        expected = 0.0 if flat else ConvexHull(corners).volume
        assert volume == pytest.approx(expected, abs=1e-11)


def test_it_is_the_volume_of_the_extracted_surface():
    field = fields.sphere_field(fields.box(7), (0.3, 0.5, 0.6), 0.55)
    surface = extract_surface(field, crossing="linear", clearance=1e-9)
    assert signed_volume(surface) == pytest.approx(solid_volume(field), rel=1e-8)


def test_the_level_meets_the_volume():
    field = fields.sphere_field(fields.box(8), (0.5, 0.5, 0.5), 0.4, width=0.5)
    for volume in (0.1, 0.27, 0.4):
        level = volume_level(field, volume)
        assert solid_volume(field, level) == pytest.approx(volume, rel=1e-9)
    assert level == pytest.approx(0.5, abs=0.4)


def test_a_volume_between_no_levels_is_refused():
    mesh = fields.box(2)
    with pytest.raises(InvalidCase, match="no level gives a solid of 2 m\\^3"):
        volume_level(PhaseField(mesh, np.linspace(0, 1, len(mesh.points))), 2.0)
