"""Smoothing as a whole: planes, corners and labels kept, volume met, nothing folds."""

import numpy as np
import pytest

from isosurface import (
    SmoothingSettings,
    extract_surface,
    mirror,
    modelled_volume,
    repair_slivers,
    smooth,
)
from isosurface.folds import FoldCheck
from isosurface.offset import offset_directions, offset_to_volume
from isosurface.structure import surface_structure
from meshes import InvalidCase, NotConverged, Patch, SymmetryPlane, TetMesh, TriMesh
from meshes.quality import face_areas, face_normals, signed_volume
from meshes.self_intersection import self_intersecting_faces
from meshes.topology import require_valid
from tests import shapes
from tests.isosurface import fields


@pytest.fixture(scope="module")
def arch():
    """The arch's modelled part without slivers, and its symmetry."""
    field = fields.arch_field(8)
    return repair_slivers(extract_surface(field), field.mesh.symmetry)[0], field.mesh.symmetry


@pytest.fixture(scope="module")
def smoothed(arch):
    return smooth(arch[0], symmetry=arch[1])


def test_the_smoothed_whole_is_a_proper_surface(arch, smoothed):
    surface, report = smoothed
    whole = mirror(surface, arch[1])
    assert require_valid(whole).components == 1
    assert not self_intersecting_faces(whole.points, whole.faces).any()
    assert report.held_back == 0
    assert report.min_angle_after > 5.0


def test_connectivity_labels_and_features_stay(arch, smoothed):
    for name in ("faces", "face_labels", "feature_edges"):
        assert np.array_equal(getattr(arch[0], name), getattr(smoothed[0], name))
    assert arch[0].labels == smoothed[0].labels


def test_caps_and_symmetry_planes_are_kept_exactly(arch, smoothed):
    before, after = arch[0].points, smoothed[0].points
    for label, patch in enumerate(arch[0].labels):
        if patch.plane is not None:
            used = np.unique(arch[0].faces[arch[0].face_labels == label])
            axis = int(np.argmax(np.abs(patch.plane.normal)))
            assert np.array_equal(before[used, axis], after[used, axis])
            normals = face_normals(after, arch[0].faces[arch[0].face_labels == label])
            assert np.all(normals @ np.asarray(patch.plane.normal) > 0.99)
    for plane in arch[1]:
        on = before[:, plane.axis] == 0.0
        assert np.array_equal(on, after[:, plane.axis] == 0.0) and on.any()


def test_corners_stay_and_rims_move(arch, smoothed):
    structure = surface_structure(arch[0], arch[1])
    moved = np.linalg.norm(smoothed[0].points - arch[0].points, axis=1)
    assert structure.corner.any() and np.all(moved[structure.corner] == 0.0)
    rims = structure.on_curve & ~structure.corner
    assert np.count_nonzero(moved[rims] > 0.0) > 0.5 * rims.sum()


def test_the_modelled_part_is_smoothed_as_the_whole_would_be(arch):
    settings = SmoothingSettings(iterations=5)
    part, _ = smooth(arch[0], settings, arch[1])
    whole, _ = smooth(mirror(*arch), settings)
    expected = mirror(part, arch[1])
    # caps' insides follow their rims by the same averages; corners on the planes are the same
    assert np.abs(whole.points - expected.points).max() < 1e-9
    assert np.array_equal(whole.faces, expected.faces)


def test_volume_is_restored_or_set(arch):
    surface, symmetry = arch
    volume = modelled_volume(surface, symmetry)
    kept, report = smooth(surface, symmetry=symmetry)
    assert modelled_volume(kept, symmetry) == pytest.approx(volume, rel=1e-11)
    assert report.volume_after == pytest.approx(report.volume_before, rel=1e-11)
    assert signed_volume(mirror(kept, symmetry)) == pytest.approx(4 * volume, rel=1e-11)
    for share in (0.97, 1.03):
        settings = SmoothingSettings(target_volume=share * volume)
        found, report = smooth(surface, settings, symmetry)
        assert modelled_volume(found, symmetry) == pytest.approx(share * volume, rel=1e-11)
        assert np.sign(report.offset) == np.sign(share - 1.0)
        require_valid(mirror(found, symmetry))
    _, report = smooth(surface, SmoothingSettings(restore_volume=False), symmetry)
    assert report.offset == 0.0 and report.drift == report.drift_filtered != 0.0


def test_off_does_nothing_but_set_the_volume():
    sphere = shapes.icosphere(2)
    same, _ = smooth(sphere, SmoothingSettings(taubin="off"))
    assert np.array_equal(same.points, sphere.points)
    target = 1.1 * signed_volume(sphere)
    larger, report = smooth(sphere, SmoothingSettings(taubin="off", target_volume=target))
    radius = np.linalg.norm(larger.points, axis=1)
    assert signed_volume(larger) == pytest.approx(target, rel=1e-12)
    assert np.ptp(radius) < 2e-3 and report.offset == pytest.approx(radius.mean() - 1, rel=0.02)


def test_the_offset_moves_smooth_faces_by_one_and_caps_in_their_plane():
    field = fields.rod_field(fields.box(10), 2, (0.5, 0.5), 0.35, width=0.3)
    surface, _ = repair_slivers(extract_surface(field))
    surface, _ = smooth(surface)
    directions = offset_directions(surface, surface_structure(surface))
    structure = surface_structure(surface)
    assert np.all(directions[structure.within_plane] == 0.0)
    used = np.unique(surface.faces[structure.smooth_faces])
    outward = surface.points[used] - [0.5, 0.5, 0.0]
    outward[:, 2] = 0.0
    along = np.einsum("ij,ij->i", directions[used], outward)
    assert np.allclose(along / np.linalg.norm(outward, axis=1), 1.0, atol=0.05)
    assert np.all(directions[structure.on_curve, 2] == 0.0)
    points, offset = offset_to_volume(surface, directions, signed_volume(surface) * 1.01)
    area = face_areas(surface.points, surface.faces)[structure.smooth_faces].sum()
    assert offset == pytest.approx(0.01 * signed_volume(surface) / area, rel=0.05)
    assert signed_volume(surface.with_points(points)) > signed_volume(surface)


def test_curved_pieces_of_the_domain_stay():
    mesh = fields.box(8)
    curved = tuple(Patch(patch.name) for patch in mesh.patches)
    mesh = TetMesh(mesh.points, mesh.tets, mesh.facets, mesh.facet_patch, curved)
    surface, _ = repair_slivers(extract_surface(fields.sphere_field(mesh, (1.0, 1.0, 1.0), 0.7)))
    smoothed, _ = smooth(surface)
    moved = np.any(smoothed.points != surface.points, axis=1)
    structure = surface_structure(surface)
    wall = np.zeros(len(moved), dtype=bool)
    wall[surface.faces[surface.face_labels > 0]] = True
    assert not moved[wall & ~structure.on_curve].any()
    assert moved[~wall].all() and moved[structure.on_curve].any()
    require_valid(smoothed)


def test_an_unreachable_volume_is_refused():
    sphere = shapes.icosphere(2)
    with pytest.raises(NotConverged, match="no normal offset below a mean edge") as caught:
        smooth(sphere, SmoothingSettings(target_volume=50.0))
    assert len(caught.value.history) >= 1


def test_open_surfaces_are_smoothed_without_a_volume():
    half = shapes.icosphere(3)
    keep = half.points[half.faces].mean(axis=1)[:, 0] > 0.1
    half = TriMesh(half.points, half.faces[keep])
    smoothed, report = smooth(half)
    assert report.volume_after is None and report.drift is None
    assert np.isfinite(smoothed.points).all()
    with pytest.raises(InvalidCase, match="needs a closed surface"):
        smooth(half, SmoothingSettings(target_volume=1.0))


def test_folded_faces_retreat_until_none_is_left():
    sphere = shapes.icosphere(3)
    check = FoldCheck(sphere, surface_structure(sphere))
    assert not check.folded(sphere.points).any()
    rng = np.random.default_rng(5)
    wild = sphere.points + 0.15 * rng.normal(size=sphere.points.shape)
    assert check.folded(wild).sum() > 100
    points, held = check.retreat(sphere.points, wild)
    assert not check.folded(points).any()
    assert np.array_equal(points[~held], wild[~held]) and 0 < held.sum() < len(held)


def test_faces_that_meet_others_retreat_too():
    inner, outer = shapes.icosphere(2), shapes.icosphere(2, radius=1.2)
    both = TriMesh(
        np.concatenate([inner.points, outer.points]),
        np.concatenate([inner.faces[:, ::-1], outer.faces + len(inner.points)]),
    )
    check = FoldCheck(both, surface_structure(both))
    wild = np.array(both.points)
    wild[: len(inner.points), 0] *= 1.3  # a cavity that grows through its wall
    assert not check.folded(wild).any()
    assert self_intersecting_faces(wild, both.faces).any()
    points, held = check.retreat(both.points, wild, intersections=True)
    assert not self_intersecting_faces(points, both.faces).any()
    assert 0 < held.sum() < len(inner.points) + 100


def test_vertices_beside_a_plane_stay_on_their_side():
    symmetry = (SymmetryPlane(0),)
    mesh = fields.box(6, symmetry="x")
    surface = extract_surface(fields.sphere_field(mesh, (0.0, 0.5, 0.5), 0.35))
    check = FoldCheck(surface, surface_structure(surface, symmetry), symmetry)
    on = surface.points[:, 0] == 0.0
    beside = np.unique(surface.faces[on[surface.faces].any(axis=1)])
    beside = beside[~on[beside]]
    wild = np.array(surface.points)
    wild[beside, 0] *= -0.1
    assert check.folded(wild).any()
    points, _ = check.retreat(surface.points, wild)
    assert np.all(points[beside, 0] > 0.0)


@pytest.mark.parametrize(
    "settings", [{"taubin": "strong"}, {"iterations": -1}, {"iterations": 2.5}]
)
def test_bad_settings_are_refused(settings):
    with pytest.raises(InvalidCase, match="must be"):
        SmoothingSettings(**settings)


def test_the_same_surface_at_another_scale(arch):
    surface, symmetry = arch
    for scale in (2.0**-40, 2.0**20):
        scaled, report = smooth(surface.with_points(scale * surface.points), symmetry=symmetry)
        assert report.held_back == 0
        expected = smooth(surface, symmetry=symmetry)[0].points
        assert np.array_equal(scaled.points, scale * expected)
