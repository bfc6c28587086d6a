"""Slivers go; topology, labels, planes, corners and the shape stay."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isosurface import (
    RepairSettings,
    SmoothingSettings,
    extract_surface,
    mirror,
    modelled_volume,
    repair_slivers,
    smooth,
)
from isosurface.repair import half_edges
from isosurface.sliver_kernels import collapse_sweep, flip_sweep
from isosurface.structure import surface_structure
from meshes import InvalidMesh, Patch, Plane, TriMesh
from meshes.closest_point import two_sided_distance
from meshes.quality import area_vectors, triangle_angles
from meshes.self_intersection import self_intersecting_faces
from meshes.topology import require_valid, topology
from tests import shapes
from tests.isosurface import fields, reference


def worst_angle(surface):
    return np.degrees(triangle_angles(surface.points, surface.faces).min())


def share_below(surface, limit):
    return np.mean(np.degrees(triangle_angles(surface.points, surface.faces).min(axis=1)) < limit)


FIELDS = {
    "ball": lambda: fields.sphere_field(fields.box(12), (0.5, 0.5, 0.5), 0.33),
    "torus": lambda: fields.torus_field(
        fields.box((14, 14, 6), (-0.8, -0.8, -0.35), (0.8, 0.8, 0.35)), 0.5, 0.22
    ),
    "rod": lambda: fields.rod_field(fields.box(10), 2, (0.5, 0.5), 0.3),
    "corner": lambda: fields.sphere_field(fields.box(8), (1.0, 1.0, 1.0), 0.6),
    "arch": lambda: fields.arch_field(8),
}


@pytest.mark.parametrize("name", FIELDS)
def test_slivers_go_and_the_rest_stays(name):
    field = FIELDS[name]()
    symmetry = field.mesh.symmetry
    raw = extract_surface(field, crossing="linear")
    mended, report = repair_slivers(raw, symmetry)
    before, after = mirror(raw, symmetry), mirror(mended, symmetry)
    require_valid(after)
    counts = [topology(m.faces, len(m.points)) for m in (before, after)]
    for what in ("genus", "components", "euler"):
        assert getattr(counts[0], what) == getattr(counts[1], what)
    assert not self_intersecting_faces(after.points, after.faces).any()
    assert report.collapses > 0 and len(mended.points) == len(raw.points) - report.collapses
    assert worst_angle(raw) == pytest.approx(report.min_angle_before, rel=1e-6)
    assert worst_angle(mended) == pytest.approx(report.min_angle_after, rel=1e-6)
    assert report.min_angle_before < 7.0 and report.min_angle_after > 9.0
    assert share_below(mended, 20.0) < 0.6 * share_below(raw, 20.0)
    edge = 1.0 / 8.0
    rms, largest = two_sided_distance(after, before)
    assert rms < 0.02 * edge and largest < 0.3 * edge
    volumes = [modelled_volume(m, symmetry) for m in (raw, mended)]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.01)


@pytest.mark.parametrize("name", ["rod", "corner", "arch"])
def test_caps_stay_planar_and_corners_stay(name):
    field = FIELDS[name]()
    symmetry = field.mesh.symmetry
    raw = extract_surface(field)
    mended, _ = repair_slivers(raw, symmetry)
    assert mended.labels == raw.labels
    for label, patch in enumerate(mended.labels):
        used = np.unique(mended.faces[mended.face_labels == label])
        assert len(used) > 0
        if patch.plane is not None:
            assert np.all(patch.plane.signed_distance(mended.points[used]) == 0.0)
    corners = [m.points[surface_structure(m, symmetry).corner] for m in (raw, mended)]
    assert {tuple(p) for p in corners[0]} == {tuple(p) for p in corners[1]}
    for plane in symmetry:
        assert np.any(mended.points[:, plane.axis] == plane.offset)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**32 - 1),
    cells=st.tuples(*[st.integers(1, 3)] * 3),
    symmetry=st.sampled_from(["", "x", "xy", "xyz"]),
)
def test_random_surfaces_stay_manifold_through_repair_and_smoothing(seed, cells, symmetry):
    field = fields.random_field(np.random.default_rng(seed), cells, symmetry)
    raw = extract_surface(field)
    planes = field.mesh.symmetry
    before = topology(*_counted(mirror(raw, planes)))
    mended, _ = repair_slivers(raw, planes)
    assert _patches(mended) == _patches(raw)
    _check_planes(mended, planes)
    whole = mirror(mended, planes)
    after = require_valid(whole)
    assert not self_intersecting_faces(whole.points, whole.faces).any()
    for what in ("genus", "components", "euler"):
        assert getattr(before, what) == getattr(after, what)
    smoothed, _ = smooth(mended, SmoothingSettings(iterations=5, restore_volume=False), planes)
    whole = mirror(smoothed, planes)
    assert not self_intersecting_faces(whole.points, whole.faces).any()
    found = topology(*_counted(whole))
    assert (found.manifold, found.watertight, found.euler) == (True, True, after.euler)


def _patches(mesh):
    """Pieces, loops and Euler number of every label's faces."""
    found = []
    for label, patch in enumerate(mesh.labels):
        part = topology(mesh.faces[mesh.face_labels == label], len(mesh.points))
        found.append((patch.name, part.components, part.boundary_loops, part.euler))
    return found


def _check_planes(mesh, symmetry):
    """No face lies within the plane of another label, or of symmetry."""
    structure = surface_structure(mesh, symmetry)
    planar = [k for k, patch in enumerate(mesh.labels) if patch.plane is not None]
    for column in range(structure.on_plane.shape[1]):
        own = planar[column] if column < len(planar) else -1
        within = structure.on_plane[mesh.faces, column].all(axis=1)
        assert np.all(mesh.face_labels[within] == own)


def _counted(mesh):
    return mesh.faces, len(mesh.points)


def needle_sphere():
    """A ball with one very short edge: vertex 0 pulled onto its neighbour."""
    ball = shapes.icosphere(2)
    neighbour = int(ball.faces[(ball.faces == 0).any(axis=1)][0][1])
    neighbour = neighbour or int(ball.faces[(ball.faces == 0).any(axis=1)][0][2])
    points = np.array(ball.points)
    points[0] = points[neighbour] + 1e-4 * (points[0] - points[neighbour])
    return ball.with_points(points), neighbour


def test_a_collapse_is_a_renaming_of_vertices():
    needle, neighbour = needle_sphere()
    mesh = half_edges(needle, surface_structure(needle))
    limits = RepairSettings().limits
    assert collapse_sweep(mesh, limits, 0.01, 0, -1) == 1
    left = {reference.rotated(f) for f in mesh.faces[mesh.alive].tolist()}
    options = [
        {reference.rotated(f) for f in reference.merged(needle.faces.tolist(), a, b)}
        for a, b in ((0, neighbour), (neighbour, 0))
    ]
    assert left in options
    _check_twins(mesh)


def test_flips_keep_the_half_edges_consistent():
    rng = np.random.default_rng(2)
    ball = shapes.icosphere(3)
    ball = ball.with_points(ball.points + 0.06 * rng.normal(size=ball.points.shape))
    mesh = half_edges(ball, surface_structure(ball))
    limits = RepairSettings().limits._replace(bad_shape=0.95)
    before = np.array(mesh.faces)
    flips = flip_sweep(mesh, limits, 0, -1)
    assert flips > 20 and np.any(mesh.faces != before)
    _check_twins(mesh)
    require_valid(TriMesh(ball.points, mesh.faces))
    merges = collapse_sweep(mesh, limits, 0.7, 1, -1)
    assert merges > 20
    _check_twins(mesh)


@pytest.mark.parametrize("name, symmetry", [("arch", "xy"), ("random", "xyz"), ("random", "")])
def test_open_surfaces_keep_consistent_half_edges(name, symmetry):
    field = FIELDS["arch"]()
    if name == "random":
        field = fields.random_field(np.random.default_rng(8), 4, symmetry)
    surface = extract_surface(field)
    mesh = half_edges(surface, surface_structure(surface, field.mesh.symmetry))
    for sweep in range(6):
        done = collapse_sweep(mesh, RepairSettings().limits, 0.1 * (sweep + 1), sweep, -1)
        assert flip_sweep(mesh, RepairSettings().limits, sweep, -1) + done > 0 or sweep > 1
        _check_twins(mesh)


@pytest.mark.parametrize("patch", [Patch("cap", Plane((0.0, 0.0, 1.0), 0.0)), Patch("smooth")])
def test_collapses_that_would_fold_a_face_are_refused(patch):
    rng = np.random.default_rng(4)
    k = np.arange(8)
    faces = np.stack([np.full(8, 8), k, (k + 1) % 8], axis=1)
    mended_stars = 0
    for _ in range(60):  # stars about a vertex, with deep dents
        angle = (k + rng.uniform(-0.3, 0.3, 8)) * np.pi / 4
        radius = rng.choice([0.1, 0.3, 1.0], size=8)
        ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle], axis=1)
        star = TriMesh(np.concatenate([ring, np.zeros((1, 3))]), faces, labels=(patch,))
        mended, report = repair_slivers(star)
        mended_stars += report.collapses + report.flips > 0
        assert np.all(area_vectors(mended.points, mended.faces)[:, 2] > 0.0)
    assert mended_stars > 10


def _check_twins(mesh):
    """Twins run the same edge the other way; out half-edges leave their vertex."""
    flat = mesh.faces.ravel()
    alive = np.flatnonzero(np.repeat(mesh.alive, 3))
    after = alive + np.where(alive % 3 == 2, -2, 1)
    twin = mesh.twin[alive]
    inner = twin >= 0
    assert np.array_equal(mesh.twin[twin[inner]], alive[inner])
    assert np.array_equal(flat[twin[inner]], flat[after[inner]])
    assert mesh.alive[twin[inner] // 3].all()
    for vertex in np.unique(flat[alive]):
        assert flat[mesh.out[vertex]] == vertex and mesh.alive[mesh.out[vertex] // 3]


def test_a_good_surface_is_left_alone():
    ball = shapes.icosphere(3)
    same, report = repair_slivers(ball)
    assert report.collapses == report.flips == 0
    assert np.array_equal(same.points, ball.points) and np.array_equal(same.faces, ball.faces)


def test_tiny_closed_surfaces_survive():
    tetrahedron = TriMesh(
        np.eye(4)[:, :3] * [1.0, 1.0, 0.01], [(0, 1, 2), (0, 3, 1), (1, 3, 2), (0, 2, 3)]
    )
    mended, _ = repair_slivers(tetrahedron)
    assert len(mended.faces) == 4


def test_scale_does_not_matter():
    raw = extract_surface(FIELDS["arch"]())
    symmetry = FIELDS["arch"]().mesh.symmetry
    expected, _ = repair_slivers(raw, symmetry)
    for scale in (2.0**-33, 2.0**33):
        scaled, _ = repair_slivers(raw.with_points(scale * raw.points), symmetry)
        assert np.array_equal(scaled.faces, expected.faces)
        assert np.array_equal(scaled.points, scale * expected.points)


def test_surfaces_that_are_no_manifold_are_refused():
    points = np.eye(5, 3)
    with pytest.raises(InvalidMesh, match="1 edges have more than two faces"):
        repair_slivers(TriMesh(points, [(0, 1, 2), (1, 0, 3), (0, 1, 4)]))
    with pytest.raises(InvalidMesh, match="different orientation"):
        repair_slivers(TriMesh(points, [(0, 1, 2), (0, 1, 3)]))
