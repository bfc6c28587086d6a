"""Closed surfaces as domains: flat parts snapped, curved ones named, bad ones refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshes import InvalidCase, InvalidMesh, Patch, Plane, SymmetryPlane, TriMesh
from meshes.quality import signed_volume
from meshes.structured import bcc_box
from meshes.tet_mesh import tet_volumes
from meshes.topology import topology
from tests import shapes
from tests.topopt.problems import bridge
from topopt import meshing_tetwild
from topopt.domain import attach_sets, mesh_domain
from topopt.meshing_flat import flat_parts
from topopt.meshing_frame import frame_of
from topopt.problem import Box, Load, Support, SurfaceDomain

INF = np.inf
TILT = Rotation.from_euler("xyz", [0.3, -0.5, 0.8]).as_matrix()


def of(surface, **changes):
    """A problem whose domain is the inside of a surface."""
    nothing = {"loads": (), "supports": (), "symmetry": ()}
    return replace(bridge(), domain=SurfaceDomain(surface), **(nothing | changes))


def half_cylinder(radius=1.0, length=3.0, sides=32, opening=np.pi):
    """Half a cylinder (or less) about the x axis; the flat face of a half one is on z = 0."""
    angle = (np.pi - opening) / 2 + np.linspace(0, opening, sides + 1)
    arc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    arc[[0, -1], 1] = arc[0, 1] if opening < np.pi else 0.0
    ends = [np.column_stack([np.full(sides + 1, x), arc]) for x in (0.0, length)]
    k, n = np.arange(sides), sides + 1
    side = [np.stack([k, k + 1 + n, k + 1], 1), np.stack([k, k + n, k + 1 + n], 1)]
    fan = np.arange(1, sides)
    caps = [
        np.stack([0 * fan, fan, fan + 1], 1),
        np.stack([0 * fan + n, fan + n + 1, fan + n], 1),
    ]
    floor = [(0, sides, sides + n), (0, sides + n, n)]
    faces = np.concatenate([*side, *caps, floor])
    mesh = TriMesh(np.concatenate(ends), faces)
    return mesh if signed_volume(mesh) > 0 else TriMesh(mesh.points, faces[:, ::-1])


def check_solid(mesh, surface, volume_error):
    """What holds for the mesh of any solid."""
    volumes = tet_volumes(mesh.points, mesh.tets)
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(signed_volume(surface), rel=volume_error)
    found = topology(mesh.facets, len(mesh.points))
    assert found.watertight and found.manifold and found.oriented
    assert signed_volume(TriMesh(mesh.points, mesh.facets)) == pytest.approx(volumes.sum())
    assert set(mesh.facet_patch) == set(range(len(mesh.patches)))
    for k, patch in enumerate(mesh.patches):
        if patch.plane is not None:
            on_it = mesh.points[np.unique(mesh.facets[mesh.facet_patch == k])]
            size = np.abs(mesh.points).max()
            assert np.abs(patch.plane.signed_distance(on_it)).max() < 1e-14 * size


def test_a_half_cylinder_has_flat_ends_a_floor_and_a_curved_patch():
    surface = half_cylinder()
    problem = of(
        surface,
        symmetry=(SymmetryPlane(2),),
        supports=(Support("end", Box((0, -INF, -INF), (0, INF, INF))),),
        loads=(Load("roof", Box((1, -0.5, 0.1), (2, 0.5, INF)), (0, 0, -1.0)),),
    )
    mesh = mesh_domain(problem, edge_length=0.5, cache=False)
    check_solid(mesh, surface, 1e-2)
    assert sorted(patch.name for patch in mesh.patches) == ["plane1", "plane2", "plane3", "surface"]
    normals = {patch.plane.normal for patch in mesh.patches if patch.plane}
    assert normals == {(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)}
    curved = mesh.facet_patch == [patch.name for patch in mesh.patches].index("surface")
    radii = np.linalg.norm(mesh.points[np.unique(mesh.facets[curved])][:, 1:], axis=1)
    assert np.abs(radii - 1).max() < 0.02  # the envelope and the chords of the input
    mesh = attach_sets(mesh, problem)
    floor = mesh.points[mesh.facets[mesh.facet_sets["symmetry:z=0"]]]
    area = (
        np.linalg.norm(np.cross(floor[:, 1] - floor[:, 0], floor[:, 2] - floor[:, 0]), axis=1) / 2
    )
    assert area.sum() == pytest.approx(6.0, rel=0.01) and len(mesh.facet_sets["load:roof"]) > 3


def test_a_sphere_is_one_curved_patch():
    surface = shapes.icosphere(2, radius=0.01, centre=(1.0, 2.0, 3.0))
    mesh = mesh_domain(of(surface), edge_length=0.006, cache=False)
    check_solid(mesh, surface, 0.02)
    assert mesh.patches == (Patch("surface"),)
    radii = np.linalg.norm(mesh.points[np.unique(mesh.facets)] - [1.0, 2.0, 3.0], axis=1)
    assert radii.min() > 0.0095 and radii.max() < 0.0101


def lattice_stand_in(matrix, shift, noise):
    """pytetwild's place taken by a tilted lattice with a wavy boundary."""

    def tetrahedralize(points, faces, **options):
        mesh = bcc_box((0, 0, 0), (1, 1, 1), (6, 6, 6))
        moved = mesh.points @ matrix.T + shift
        span = points.max(axis=0)
        low, high = moved.min(axis=0), moved.max(axis=0)
        moved = (moved - low) / (high - low).max()
        assert np.allclose(moved.max(axis=0), span)
        rng = np.random.default_rng(2)
        return moved + rng.uniform(-noise, noise, moved.shape), mesh.tets

    return tetrahedralize


@pytest.mark.parametrize("scale", [1.0, 1e-6, 2.0**30])
def test_a_tilted_box_is_snapped_to_all_its_planes(scale, monkeypatch):
    cube = shapes.cube(1.0)
    surface = TriMesh(scale * (cube.points @ TILT.T), cube.faces)
    monkeypatch.setattr(meshing_tetwild, "tetrahedralize", lattice_stand_in(TILT, 0.0, 5e-4))
    mesh = mesh_domain(of(surface), edge_length=0.2 * scale, cache=False)
    check_solid(mesh, surface, 1e-11)  # coordinates in the frame have 12 digits
    assert [patch.name for patch in mesh.patches] == [f"plane{k}" for k in range(1, 7)]
    for patch in mesh.patches:
        distance = np.abs(TILT.T @ np.array(patch.plane.normal))
        assert np.sort(distance) == pytest.approx([0, 0, 1], abs=1e-10)


CORNER = (
    np.array([[0.0, 0, 2e-4], [1, 0, 0], [0, 1, 0], [1, 1, 0]]),
    np.array([[0, 1, 2], [0, 1, 3]]),
)


@pytest.mark.parametrize("turn", [0.2, 1.0, 2.0, 3.0])
def test_a_node_on_two_planes_is_moved_onto_both(turn):
    planes = [Plane((0.0, 0.0, 1.0), 1e-4), Plane((0.0, np.sin(turn), np.cos(turn)), 1e-4)]
    moved = meshing_tetwild.snapped(*CORNER, np.array([0, 1]), planes)
    for plane in planes:
        assert np.abs(plane.signed_distance(moved[:2])).max() < 1e-16


def test_a_node_on_two_nearly_parallel_planes_stays_near_both():
    """The planes meet far away: the least move onto both would be 0.1."""
    turn = 1e-3
    planes = [Plane((0.0, 0.0, 1.0), 0.0), Plane((0.0, np.sin(turn), np.cos(turn)), 1e-4)]
    points, facets = CORNER
    moved = meshing_tetwild.snapped(points, facets, np.array([0, 1]), planes)
    assert np.linalg.norm(moved - points, axis=1).max() < 1e-3
    assert moved[2, 2] == 0.0 and planes[1].signed_distance(moved[3:]) == pytest.approx(
        0, abs=1e-16
    )


def test_a_mesh_that_is_none_of_the_domain_is_not_used():
    frame = frame_of(SurfaceDomain(shapes.cube(1.0)))
    mesh = bcc_box((0, 0, 0), (1, 1, 1), (4, 4, 4))
    with pytest.raises(InvalidMesh, match="volume is off"):
        meshing_tetwild.finish(frame, 0.2, 0.9 * mesh.points, mesh.tets)
    with pytest.raises(InvalidMesh, match="no positive volume"):
        meshing_tetwild.finish(frame, 0.2, mesh.points, mesh.tets[:, [0, 2, 1, 3]])
    with pytest.raises(InvalidMesh, match="not a closed manifold"):
        touching = np.concatenate([mesh.tets[:1], mesh.tets[-1:]])
        touching[1, 0] = touching[0, 0]
        meshing_tetwild.finish(frame, 0.2, mesh.points, touching)


def test_an_inward_surface_is_turned():
    cube = shapes.cube(1.0)
    frame = frame_of(SurfaceDomain(TriMesh(cube.points, cube.faces[:, ::-1])))
    assert signed_volume(frame.surface) == pytest.approx(1.0)
    assert sum(plane.offset for plane in frame.planes) == pytest.approx(3.0)


@pytest.mark.parametrize("scale", [2.0**12, 2.0**-30])
def test_the_frame_of_a_surface_does_not_depend_on_powers_of_two(scale):
    sphere = shapes.icosphere(1, centre=(0.1, 0.2, 0.3))
    one = frame_of(SurfaceDomain(sphere))
    other = frame_of(SurfaceDomain(sphere.with_points(scale * sphere.points)))
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(scale * one.to_metres(one.points), other.to_metres(other.points))


def test_the_way_back_from_the_frame_is_exact_on_the_bounding_box():
    half = half_cylinder(radius=0.7, length=1.1)
    surface = half.with_points(half.points + [0.1, 0.3, 0.0123])
    frame = frame_of(SurfaceDomain(surface))
    back = frame.to_metres(frame.points)
    np.testing.assert_allclose(back, surface.points, rtol=0, atol=1e-12)
    offsets = {p.normal: frame.plane_in_metres(p).offset for p in frame.planes}
    assert offsets[(0.0, 0.0, -1.0)] == -0.0123
    assert offsets[(1.0, 0.0, 0.0)] == surface.points[:, 0].max()


@pytest.mark.parametrize(
    "surface, planes",
    [
        (shapes.cube(1.0), 6),
        (shapes.icosphere(1), 0),
        (shapes.torus(), 0),
        (half_cylinder(), 3),
        (half_cylinder(sides=100, opening=0.05), 3),  # turns by 5e-4 a face, but bends
    ],
)
def test_flat_parts_are_found_and_facets_of_curves_are_not(surface, planes):
    found, widths, face_plane = flat_parts(surface.points / 3.0, surface.faces)
    assert len(found) == len(widths) == planes
    assert set(face_plane) - {-1} == set(range(planes))
    for k, plane in enumerate(found):
        corners = surface.points[surface.faces[face_plane == k]] / 3.0
        assert np.abs(plane.signed_distance(corners)).max() < 1e-12


def test_coplanar_parts_are_one_plane():
    """Two feet of a bridge on one floor: two cubes side by side."""
    cube = shapes.cube(0.25)
    points = np.concatenate([cube.points, cube.points + [0.75, 0, 0]])
    faces = np.concatenate([cube.faces, cube.faces + 8])
    planes, widths, face_plane = flat_parts(points, faces)
    assert len(planes) == 4 + 4  # floor, roof, front and back are shared
    floor = planes.index(Plane((0.0, 0.0, -1.0), 0.0))
    assert np.count_nonzero(face_plane == floor) == 4
    assert widths == pytest.approx((0.125,) * 8)


def dented_cube():
    """A cube one of whose corners is pushed through the opposite face."""
    cube = shapes.cube(1.0)
    points = cube.points.copy()
    points[7] = (-0.5, 0.2, 0.3)
    return TriMesh(points, cube.faces)


def flipped_face():
    cube = shapes.cube(1.0)
    faces = cube.faces.copy()
    faces[0] = faces[0, ::-1]
    return TriMesh(cube.points, faces)


def two_cubes_at_a_corner():
    cube = shapes.cube(1.0)
    far = np.array([8, 9, 10, 11, 12, 13, 14, 15])
    far[0] = 7  # the corner (0, 0, 0) of the second is the corner (1, 1, 1) of the first
    points = np.concatenate([cube.points, cube.points + 1.0])
    return TriMesh(points, np.concatenate([cube.faces, far[cube.faces]]))


@pytest.mark.parametrize(
    "surface, words",
    [
        (TriMesh(shapes.cube().points, shapes.cube().faces[:-1]), "3 open boundary edges"),
        (dented_cube(), "cuts itself in"),
        (flipped_face(), "opposite orientation"),
        (two_cubes_at_a_corner(), "1 vertices where parts of it only touch"),
        (TriMesh(np.zeros((0, 3)), np.zeros((0, 3))), "has no faces"),
        (
            TriMesh(np.where(shapes.cube().points == 0, np.nan, 1.0), shapes.cube().faces),
            "vertices that are NaN",
        ),
        (TriMesh(np.zeros((8, 3)), shapes.cube().faces), "it is flat"),
    ],
)
def test_surfaces_that_bound_no_solid_are_refused(surface, words):
    with pytest.raises(InvalidCase, match=words) as caught:
        mesh_domain(of(surface), edge_length=0.2, cache=False)
    assert str(caught.value).endswith(".")


def test_a_lattice_fills_boxes_only():
    with pytest.raises(InvalidCase, match="fills a box only"):
        mesh_domain(of(shapes.cube()), edge_length=0.2, kind="bcc")
