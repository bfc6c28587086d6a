"""Pieces that carry nothing are dropped without touching the others; cavities are reported."""

import numpy as np
import pytest

from isosurface import drop_islands, extract_surface, solid_volume
from meshes import InvalidMesh, PhaseField
from meshes.quality import signed_volume
from meshes.topology import face_components, topology
from tests.isosurface import fields


def facets_at(mesh, axis, value):
    """Boundary facets on the plane x[axis] = value."""
    return np.flatnonzero((mesh.points[mesh.facets][..., axis] == value).all(axis=1))


def two_rods_and_a_ball(loads=True, supports=True):
    """A rod from x = 0 (support) to x = 1 (load), one from x = 0 to 0.5, and a ball elsewhere."""
    mesh = fields.box(14, symmetry="y")
    sets = {"load:end": facets_at(mesh, 0, 1.0)} if loads else {}
    if supports:
        sets["support:foot"] = facets_at(mesh, 0, 0.0)
    mesh = mesh.with_sets(facet_sets=sets)
    rod = fields.rod_field(mesh, 0, (0.2, 0.2), 0.15).values
    short = fields.rod_field(mesh, 0, (0.8, 0.8), 0.12).values
    short = np.minimum(short, fields.sine_profile(0.5 - mesh.points[:, 0], 0.2))
    ball = fields.sphere_field(mesh, (0.6, 0.0, 0.75), 0.17).values
    return PhaseField(mesh, np.maximum(np.maximum(rod, short), ball))


def test_only_the_piece_from_load_to_support_stays():
    field = two_rods_and_a_ball()
    cleaned, report = drop_islands(field)
    assert report.components == 3 and report.islands == 2 and report.cavities == 0
    dropped = solid_volume(field) - solid_volume(cleaned)
    assert sum(report.island_volumes) == pytest.approx(dropped, rel=1e-12)
    assert report.island_volumes[0] == pytest.approx(np.pi * 0.12**2 * 0.5, rel=0.15)
    assert report.island_volumes[1] == pytest.approx(2 / 3 * np.pi * 0.17**3, rel=0.15)
    again, nothing = drop_islands(cleaned)
    assert nothing.components == 1 and nothing.islands == 0
    assert np.array_equal(again.values, cleaned.values)


def test_the_other_pieces_keep_their_surface_bit_for_bit():
    field = two_rods_and_a_ball()
    before, after = extract_surface(field), extract_surface(drop_islands(field)[0])
    kept = {tuple(p) for p in after.points}
    _, piece = face_components(before.faces)
    pieces = [{tuple(p) for p in before.points[before.faces[piece == k].ravel()]} for k in range(3)]
    assert kept in pieces
    assert topology(after.faces, len(after.points)).components == 1


@pytest.mark.parametrize(
    "loads, supports, islands",
    [(True, True, 2), (False, True, 1), (True, False, 2), (False,) * 2 + (0,)],
)
def test_only_the_kinds_of_sets_that_exist_are_asked_for(loads, supports, islands):
    assert drop_islands(two_rods_and_a_ball(loads, supports))[1].islands == islands


def test_a_knife_edge_that_holds_nodes_alone_is_a_support():
    field = two_rods_and_a_ball(supports=False)
    x, y, _ = field.mesh.points.T
    nodes = np.flatnonzero((x == 0.0) & (y < 0.5))  # of the rod that is loaded, not of the other
    facets = dict(field.mesh.facet_sets) | {"support:edge": np.empty(0, np.int32)}
    mesh = field.mesh.with_sets(facets, {"support:edge": nodes})
    report = drop_islands(PhaseField(mesh, field.values))[1]
    assert report.components - report.islands == 1
    elsewhere = mesh.with_sets(facets, {"support:edge": np.flatnonzero((x == 0.5) & (y == 1.0))})
    with pytest.raises(InvalidMesh, match="none of the 3 pieces"):
        drop_islands(PhaseField(elsewhere, field.values))


def test_lowered_values_lie_below_the_level_and_in_the_unit_interval():
    field = two_rods_and_a_ball()
    field = PhaseField(field.mesh, np.where(np.abs(field.values - 0.5) < 0.1, 0.5, field.values))
    for level in (0.3, 0.5, 0.7):
        cleaned, _ = drop_islands(field, level)
        changed = cleaned.values != field.values
        assert changed.any() and np.all(cleaned.values[changed] < level)
        assert cleaned.values.min() >= 0.0


def test_a_cut_design_is_refused():
    field = two_rods_and_a_ball()
    values = np.where(np.abs(field.mesh.points[:, 0] - 0.7) < 0.1, 0.0, field.values)
    with pytest.raises(InvalidMesh, match="pieces of the solid joins a load to a support"):
        drop_islands(PhaseField(field.mesh, values))


@pytest.mark.parametrize("symmetry", ["", "x", "xy"])
def test_closed_cavities_are_reported_and_kept(symmetry):
    mesh = fields.box(12, symmetry=symmetry)
    centre = [0.0 if axis in symmetry else 0.5 for axis in "xyz"]
    ball = fields.sphere_field(mesh, centre, 0.3)
    cleaned, report = drop_islands(PhaseField(mesh, 1.0 - ball.values))
    assert np.array_equal(cleaned.values, 1.0 - ball.values)
    share = 0.5 ** len(symmetry)
    assert report.cavity_volumes == pytest.approx([4 / 3 * np.pi * 0.027 * share], rel=0.1)
    wall = signed_volume(extract_surface(cleaned, crossing="linear")) if not symmetry else None
    if wall is not None:
        assert wall == pytest.approx(1.0 - report.cavity_volumes[0], rel=1e-3)


def test_a_cavity_open_to_the_boundary_is_none():
    mesh = fields.box(10)
    rod = fields.rod_field(mesh, 2, (0.5, 0.5), 0.2)
    _, report = drop_islands(PhaseField(mesh, 1.0 - rod.values))
    assert report.cavities == 0 and report.components == 1
