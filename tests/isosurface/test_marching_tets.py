"""Marching tetrahedra: every sign, closed and manifold always, second order on known surfaces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from isosurface import extract_surface, mirror, modelled_volume, solid_volume
from isosurface.clipping_tables import TET_QUADS, TET_TRIANGLES
from meshes import InvalidCase, InvalidMesh, PhaseField, Plane, TetMesh, TriMesh
from meshes.patch import Patch
from meshes.quality import face_areas, signed_volume
from meshes.self_intersection import self_intersecting_faces
from meshes.tet_mesh import boundary_facets
from meshes.topology import require_valid, topology
from tests.isosurface import fields, reference

TET = np.array([[0.1, 0.0, 0.0], [1.0, 0.2, 0.0], [0.0, 1.1, 0.1], [0.2, 0.1, 0.9]])


def single_tet(order=(0, 1, 2, 3)):
    """One tetrahedron as a mesh; the order must be an even permutation."""
    tets = np.array([order])
    facets = boundary_facets(tets)
    return TetMesh(TET, tets, facets, np.zeros(4), (Patch("wall"),))


def valid(surface, **kwargs):
    """The topology of a surface that must be proper."""
    return require_valid(surface, **kwargs)


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (1, 2, 0, 3), (3, 2, 1, 0)])
@pytest.mark.parametrize("pattern", range(1, 16))
def test_every_sign_pattern_gives_the_closed_convex_part(pattern, order):
    values = np.where([(pattern >> k) & 1 for k in range(4)], [0.9, 0.6, 0.8, 0.7], [0.1, 0.4] * 2)
    surface = extract_surface(PhaseField(single_tet(order), values), crossing="linear")
    hull = ConvexHull(reference.solid_corners(TET, values, 0.5))
    assert valid(surface).genus == 0
    assert signed_volume(surface) == pytest.approx(hull.volume, rel=1e-12)
    assert face_areas(surface.points, surface.faces).sum() == pytest.approx(hull.area, rel=1e-12)
    inside = bin(pattern).count("1")
    if inside < 4:
        assert np.count_nonzero(surface.face_labels == 0) == (2 if inside == 2 else 1)


def test_tables_hold_one_polygon_per_pattern():
    has_triangle, has_quad = TET_TRIANGLES[:, 0] >= 0, TET_QUADS[:, 0] >= 0
    assert np.all(has_triangle[1:15] ^ has_quad[1:15])
    assert not has_triangle[[0, 15]].any() and not has_quad[[0, 15]].any()


def test_agrees_with_the_loop_over_tetrahedra():
    field = fields.random_field(np.random.default_rng(3), 2, on_level=0.1)
    surface = extract_surface(field, crossing="linear")
    number = {tuple(p): k for k, p in enumerate(surface.points)}
    expected = []
    for polygon in reference.marching_polygons(field):
        ids = [number[tuple(p)] for p in polygon]
        expected.append({reference.rotated(t) for t in _fans(ids)})
    iso = surface.face_labels == [p.name for p in surface.labels].index("isosurface")
    found = [reference.rotated(face) for face in surface.faces[iso].tolist()]
    assert len(found) == len(set(found)) == sum(1 if len(e) == 1 else 2 for e in expected)
    assert set(found) <= set().union(*expected)


def _fans(ids):
    """All triangles by which a polygon may be cut into triangles."""
    if len(ids) == 3:
        return [ids]
    a, b, c, d = ids
    return [[a, b, c], [a, c, d], [b, c, d], [b, d, a]]


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**32 - 1),
    cells=st.tuples(*[st.integers(1, 3)] * 3),
    symmetry=st.sampled_from(["", "x", "z", "xy", "xyz"]),
    on_level=st.sampled_from([0.0, 0.3, 1.0]),
)
def test_random_fields_give_closed_manifold_surfaces(seed, cells, symmetry, on_level):
    field = fields.random_field(np.random.default_rng(seed), cells, symmetry, on_level)
    if not (field.values >= 0.5).any():
        return
    surface = extract_surface(field, crossing="linear", clearance=1e-6)
    whole = mirror(surface, field.mesh.symmetry)
    valid(surface, closed=False)
    valid(whole)
    assert not self_intersecting_faces(whole.points, whole.faces).any()
    expected = solid_volume(field)
    assert modelled_volume(surface, field.mesh.symmetry) == pytest.approx(expected, abs=1e-5)
    assert signed_volume(whole) == pytest.approx(expected * 2 ** len(symmetry), abs=1e-4)


def test_nodes_exactly_at_the_level_are_inside_and_keep_their_distance():
    mesh = fields.box(4)
    field = PhaseField(mesh, np.where(mesh.points[:, 0] <= 0.5, 0.5, 0.0))
    surface = extract_surface(field, clearance=0.01)
    valid(surface)
    assert surface.points[:, 0].max() == pytest.approx(0.5 + 0.01 * 0.25)
    _, count = np.unique(surface.points, axis=0, return_counts=True)
    assert count.max() == 1


def _fitted_order(sizes, errors):
    """Slope of log error over log size."""
    return np.polyfit(np.log(sizes), np.log(np.abs(errors)), 1)[0]


@pytest.mark.parametrize("crossing", ["linear", "sine", "quadratic"])
def test_sphere_is_second_order_in_area_and_volume(crossing):
    radius, cells = 0.31, np.array([8, 12, 18, 24])
    area, volume, radial = [], [], []
    for n in cells:
        mesh = fields.box(int(n))
        field = fields.sphere_field(mesh, (0.5, 0.49, 0.52), radius, width=0.35)
        surface = extract_surface(field, crossing=crossing, clearance=1e-4)
        assert valid(surface).genus == 0
        area.append(face_areas(surface.points, surface.faces).sum() / (4 * np.pi * radius**2) - 1)
        volume.append(signed_volume(surface) / (4 / 3 * np.pi * radius**3) - 1)
        distance = np.linalg.norm(surface.points - [0.5, 0.49, 0.52], axis=1) - radius
        radial.append(np.abs(distance).max())
    assert _fitted_order(1 / cells, area) == pytest.approx(2.0, abs=0.25)
    assert _fitted_order(1 / cells, volume) == pytest.approx(2.0, abs=0.25)
    order = _fitted_order(1 / cells, radial)
    assert order > 2.5 if crossing == "quadratic" else order == pytest.approx(2.0, abs=0.4)


def test_torus_is_second_order_and_keeps_its_hole():
    major, minor, cells = 0.5, 0.2, np.array([12, 18, 26])
    area, volume = [], []
    for n in cells:
        mesh = fields.box((n, n, n // 2), (-0.8, -0.8, -0.4), (0.8, 0.8, 0.4))
        surface = extract_surface(fields.torus_field(mesh, major, minor, 0.38), clearance=1e-4)
        assert valid(surface).genus == 1
        area.append(face_areas(surface.points, surface.faces).sum() / (4 * np.pi**2 * 0.1) - 1)
        volume.append(signed_volume(surface) / (2 * np.pi**2 * major * minor**2) - 1)
    assert _fitted_order(1 / cells, area) == pytest.approx(2.0, abs=0.25)
    assert _fitted_order(1 / cells, volume) == pytest.approx(2.0, abs=0.25)


def test_sine_crossing_is_exact_along_an_edge_of_the_profile():
    mesh = fields.box((8, 2, 2))
    field = fields.slab_field(mesh, 0, -9.0, 0.537, width=0.6)
    flat = Patch("isosurface")
    for crossing, exact in (("sine", True), ("linear", False)):
        surface = extract_surface(field, crossing=crossing)
        iso = surface.faces[surface.face_labels == surface.labels.index(flat)]
        error = np.abs(surface.points[np.unique(iso), 0] - 0.537).max()
        assert (error < 1e-14) == exact


def test_rod_through_the_box_is_capped_at_both_ends():
    mesh = fields.box((16, 16, 4), upper=(1.0, 1.0, 0.3))
    surface = extract_surface(fields.rod_field(mesh, 2, (0.5, 0.5), 0.3, width=0.3))
    assert valid(surface).genus == 0
    areas = face_areas(surface.points, surface.faces)
    assert {p.name for p in surface.labels} == {"isosurface", "z-", "z+"}
    for label, patch in enumerate(surface.labels):
        on = surface.face_labels == label
        if patch.plane is None:
            assert areas[on].sum() == pytest.approx(2 * np.pi * 0.3 * 0.3, rel=0.01)
            continue
        assert areas[on].sum() == pytest.approx(np.pi * 0.09, rel=0.01)
        assert np.all(patch.plane.signed_distance(surface.points[surface.faces[on]]) == 0.0)
    assert (
        topology(surface.faces[surface.face_labels == 0], len(surface.points)).boundary_loops == 2
    )


def test_feature_edges_are_the_rims_and_the_box_edges():
    mesh = fields.box(6)
    surface = extract_surface(fields.slab_field(mesh, 2, 0.3, 0.7))
    ends = surface.points[surface.feature_edges]
    on_box_edges = np.isin(ends[..., :2], [0.0, 1.0]).all(axis=2).all(axis=1)
    on_rims = (np.abs(np.abs(ends[..., 2] - 0.5) - 0.2) < 0.02).all(axis=1)
    assert np.all(on_box_edges | on_rims)
    assert np.count_nonzero(on_box_edges & ~on_rims) > 0
    used, degree = np.unique(surface.feature_edges, return_counts=True)
    assert np.count_nonzero(degree == 3) == 8 and np.all(np.isin(degree, [2, 3]))
    assert len(used) > 8


def test_a_solid_box_is_its_own_boundary():
    mesh = fields.box(2)
    surface = extract_surface(PhaseField(mesh, np.ones(len(mesh.points))))
    assert valid(surface).euler == 2
    assert len(surface.faces) == len(mesh.facets)
    assert signed_volume(surface) == pytest.approx(1.0, abs=1e-14)
    assert [p.plane for p in surface.labels if p.name == "x+"] == [Plane((1.0, 0.0, 0.0), 1.0)]


def test_the_surface_scales_with_powers_of_two():
    small = extract_surface(fields.sphere_field(fields.box(6), (0.4, 0.5, 0.6), 0.5))
    mesh = fields.box(6)
    for scale in (2.0**-30, 2.0**30):
        scaled = TetMesh(
            scale * mesh.points, mesh.tets, mesh.facets, mesh.facet_patch, mesh.patches
        )
        field = PhaseField(scaled, fields.sphere_field(mesh, (0.4, 0.5, 0.6), 0.5).values)
        surface = extract_surface(field)
        assert np.array_equal(surface.faces, small.faces)
        assert np.array_equal(surface.points, scale * small.points)


def test_bad_fields_are_refused_in_a_sentence():
    mesh = fields.box(2)
    with pytest.raises(InvalidMesh, match=r"nowhere reaches 0\.5"):
        extract_surface(PhaseField(mesh, np.full(len(mesh.points), 0.4)))
    values = np.ones(len(mesh.points))
    values[7] = np.nan
    with pytest.raises(InvalidMesh, match="not finite at 1 nodes"):
        extract_surface(PhaseField(mesh, values))
    field = PhaseField(mesh, np.linspace(0, 1, len(mesh.points)))
    with pytest.raises(InvalidCase, match="crossing must be one of"):
        extract_surface(field, crossing="cubic")
    with pytest.raises(InvalidCase, match="clearance"):
        extract_surface(field, clearance=0.5)
    off = mesh.with_sets(symmetry=fields.box(2, (5.0,) * 3, (6.0,) * 3, "x").symmetry)
    with pytest.raises(InvalidMesh, match="no facet of the mesh lies on the symmetry plane x=5"):
        extract_surface(PhaseField(off, field.values))


def test_result_is_a_tri_mesh():
    assert isinstance(extract_surface(fields.sphere_field(fields.box(4), (0.5,) * 3, 0.4)), TriMesh)
