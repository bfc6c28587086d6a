"""The whole from the modelled part: closed, welded, exactly symmetric, labelled."""

import numpy as np
import pytest

from isosurface import extract_surface, mirror, modelled_volume, smooth
from meshes import InvalidMesh, Patch, Plane, SymmetryPlane, TriMesh
from meshes.quality import signed_volume
from meshes.topology import require_valid, topology
from tests import shapes
from tests.isosurface import fields


def octant(symmetry="xyz", cells=6):
    """Part of a ball about the origin in [0, 1]^3."""
    return extract_surface(
        fields.sphere_field(fields.box(cells, symmetry=symmetry), (0.0,) * 3, 0.7)
    )


def planes(symmetry, offset=0.0):
    return tuple(SymmetryPlane("xyz".index(axis), offset) for axis in symmetry)


def sorted_rows(points):
    return points[np.lexsort(points.T)]


def face_set(surface):
    """Faces by the coordinates of their corners, in order, from the smallest corner on."""
    faces = set()
    for corners in surface.points[surface.faces] + 0.0:  # no -0.0
        keys = [tuple(p) for p in corners.tolist()]
        k = keys.index(min(keys))
        faces.add((keys[k], keys[(k + 1) % 3], keys[(k + 2) % 3]))
    return faces


def test_an_octant_becomes_a_ball_with_the_topology_of_the_whole():
    part = octant()
    whole = mirror(part, planes("xyz"))
    found = require_valid(whole)
    assert (found.genus, found.components, found.euler) == (0, 1, 2)
    mesh = fields.box(12, (-1.0,) * 3, (1.0,) * 3)
    direct = extract_surface(fields.sphere_field(mesh, (0.0,) * 3, 0.7))
    assert topology(direct.faces, len(direct.points)).euler == found.euler
    assert signed_volume(whole) == pytest.approx(
        8 * modelled_volume(part, planes("xyz")), rel=1e-13
    )
    assert signed_volume(whole) == pytest.approx(signed_volume(direct), rel=0.01)
    assert whole.labels == (Patch("isosurface"),)
    assert len(whole.feature_edges) == 0


@pytest.mark.parametrize("smoothed", [False, True])
def test_the_whole_is_symmetric_bit_for_bit(smoothed):
    symmetry = planes("xy")
    part = extract_surface(fields.arch_field(4))
    if smoothed:
        part, _ = smooth(part, symmetry=symmetry)
    whole = mirror(part, symmetry)
    require_valid(whole)
    for plane in symmetry:
        image = TriMesh(plane.reflect(whole.points), whole.faces[:, ::-1])
        assert np.array_equal(sorted_rows(image.points + 0.0), sorted_rows(whole.points + 0.0))
        assert face_set(image) == face_set(whole)


def test_no_two_vertices_coincide():
    whole = mirror(octant(), planes("xyz"))
    assert len(np.unique(whole.points + 0.0, axis=0)) == len(whole.points)


def test_caps_across_a_plane_go_on_and_others_get_an_image():
    mesh = fields.box(6, symmetry="x")
    whole = mirror(extract_surface(fields.slab_field(mesh, 2, 0.3, 0.7)), mesh.symmetry)
    names = [p.name for p in whole.labels]
    assert sorted(names) == ["isosurface", "x+", "x+|x=0", "y+", "y-"]
    image = whole.labels[names.index("x+|x=0")].plane
    assert image == Plane((-1.0, 0.0, 0.0), 1.0)
    for label, patch in enumerate(whole.labels):
        if patch.plane is not None:
            used = whole.points[whole.faces[whole.face_labels == label]]
            assert np.all(patch.plane.signed_distance(used) == 0.0)
    ends = whole.points[whole.feature_edges]
    assert not (ends[..., 0] == 0.0).all(axis=1).any()


def test_a_sloping_cap_meets_its_image_in_a_curve():
    slope = Plane((0.6, 0.0, 0.8), 0.8)
    roof = TriMesh(
        [(0.0, 0.0, 1.0), (1.0, 0.0, 0.25), (1.0, 1.0, 0.25), (0.0, 1.0, 1.0)],
        [(0, 1, 2), (0, 2, 3)],
        labels=(Patch("roof", slope),),
    )
    whole = mirror(roof, planes("x"))
    assert [p.name for p in whole.labels] == ["roof", "roof|x=0"]
    assert whole.labels[1].plane == Plane((-0.6, 0.0, 0.8), 0.8)
    ridge = (whole.points[whole.feature_edges][..., 0] == 0.0).all(axis=1)
    assert np.count_nonzero(ridge) == 1


def test_an_offset_plane():
    moved = octant("x")
    shifted = moved.with_points(moved.points + [2.0, 0.0, 0.0])
    whole = mirror(shifted, planes("x", 2.0))
    require_valid(whole)
    assert whole.points[:, 0].min() == pytest.approx(2.0 - 0.7, abs=0.04)
    cap = Plane((1.0, 0.0, 0.0), 3.0)
    square = TriMesh([(3, 0, 0), (3, 1, 0), (3, 1, 1)], [(0, 1, 2)], labels=(Patch("c", cap),))
    image = mirror(square, planes("x", 2.0)).labels[1].plane
    assert image == Plane((-1.0, 0.0, 0.0), -1.0)


def test_feature_edges_of_the_input_are_mirrored():
    part = octant("x")
    inner = part.faces[:1, :2]
    part = TriMesh(part.points, part.faces, part.face_labels, part.labels, inner)
    whole = mirror(part, planes("x"))
    ends = {
        tuple(map(tuple, np.sort(e, axis=0))) for e in (whole.points[whole.feature_edges]).tolist()
    }
    for image in (part.points[inner[0]], part.points[inner[0]] * [-1, 1, 1]):
        assert tuple(map(tuple, np.sort(image, axis=0).tolist())) in ends


def test_overlapping_halves_are_refused():
    with pytest.raises(InvalidMesh, match="lie beyond the symmetry plane x=0"):
        mirror(shapes.icosphere(1, centre=(0.123, 0.0, 0.0)), planes("x"))
    closed = shapes.cube()
    with pytest.raises(InvalidMesh, match="edges lie within the symmetry plane x=0"):
        mirror(closed, planes("x"))
