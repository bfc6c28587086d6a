"""Collapse, split, flip and smoothing keep a surface what it is: each one, and all mixed."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from meshes import TriMesh
from meshes.topology import topology
from remesh.carrier import make_carrier
from remesh.collapse import collapse_short_edges
from remesh.connectivity import BASE, CORNER, CURVE, HINT, KIND, ORIGIN
from remesh.flip import DELAUNAY, THESIS, VALENCE, flip_edges
from remesh.halfedge import WorkMesh
from remesh.optimise import optimise_vertices
from remesh.smooth import AREA, BOSSEN_HECKBERT, UNIFORM, smooth_vertices
from remesh.split import split_long_edges
from tests.remesh.reference import broken_links
from tests.remesh.shapes import closed_shapes, cylinder, hemisphere, jittered
from tests.shapes import icosphere, torus

LIMITS = (10.0, 5.0, 0.2)


def mean_edge(work):
    corners, _ = work.corner_rows()
    points = work.rows[corners, :3]
    return np.linalg.norm(np.roll(points, 1, axis=1) - points, axis=2).mean()


OPERATIONS = {
    "split": lambda w, s, x: split_long_edges(w, (0.8 + x) * mean_edge(w), s, 0.2),
    "collapse": lambda w, s, x: collapse_short_edges(
        w, (0.4 + 0.7 * x) * mean_edge(w), 2.5 * mean_edge(w), s, LIMITS
    ),
    "flip for valence": lambda w, s, x: flip_edges(w, s, LIMITS, VALENCE, 2),
    "flip for angles": lambda w, s, x: flip_edges(w, s, LIMITS, DELAUNAY, 2),
    "flip as the thesis": lambda w, s, x: flip_edges(w, s, LIMITS, THESIS, 2),
    "smooth": lambda w, s, x: smooth_vertices(w, s, LIMITS, UNIFORM, 0.3 + 0.7 * x),
    "smooth by area": lambda w, s, x: smooth_vertices(w, s, LIMITS, AREA, 0.3 + 0.7 * x),
    "smooth as the thesis": lambda w, s, x: smooth_vertices(
        w, s, LIMITS, BOSSEN_HECKBERT, 0.2, mean_edge(w), 0.8
    ),
    "search": lambda w, s, x: optimise_vertices(w, s, 0.1 + 0.2 * x)[0],
    "compact": lambda w, s, x: w.compact() or 1,
}


def features(work):
    """What has to stay: corner positions, number of curves' vertices at least, planes, kind."""
    mesh, bases = work.to_mesh()
    corners = mesh.points[work.links[bases, KIND] == CORNER]
    return {tuple(p) for p in corners}


@pytest.mark.parametrize("shape", ["sphere", "torus", "cylinder", "cut sphere"])
@pytest.mark.parametrize("name", list(OPERATIONS))
def test_each_operation_happens_and_keeps_the_surface(name, shape):
    mesh = closed_shapes()[shape]
    if shape in ("sphere", "torus"):
        mesh = jittered(mesh, 0.2, 5)
    work = WorkMesh(make_carrier(mesh))
    before = topology(mesh.faces, len(mesh.points))
    corners = features(work)
    if name.startswith("flip"):
        split_long_edges(work, 0.9 * mean_edge(work), 0.1, 0.2)
        smooth_vertices(work, 0.1, LIMITS, UNIFORM, 0.7)
    count = OPERATIONS[name](work, 0.1, 0.9 if name == "collapse" else 0.3)
    assert count > 0
    assert broken_links(work) == []
    result, _ = work.to_mesh()
    after = topology(result.faces, len(result.points))
    assert (after.genus, after.components, after.watertight) == (
        before.genus, before.components, before.watertight,
    )  # fmt: skip
    assert features(work) == corners


@settings(derandomize=True, max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.sampled_from(["sphere", "torus", "cylinder", "cut sphere", "open"]),
    st.integers(0, 1000),
    st.sampled_from([0.0, 0.3]),
    st.lists(
        st.tuples(st.sampled_from(list(OPERATIONS)), st.floats(0.0, 1.0)), min_size=3, max_size=9
    ),
)
def test_any_sequence_keeps_manifold_genus_and_features(shape, seed, sigma, sequence):
    mesh = hemisphere(2) if shape == "open" else closed_shapes()[shape]
    if shape in ("sphere", "torus"):
        mesh = jittered(mesh, 0.3, seed)
    work = WorkMesh(make_carrier(mesh))
    before = topology(mesh.faces, len(mesh.points))
    corners = features(work)
    for name, strength in sequence:
        OPERATIONS[name](work, sigma, strength)
    assert broken_links(work) == []
    result, _ = work.to_mesh()
    after = topology(result.faces, len(result.points))
    assert (after.genus, after.components, after.boundary_loops) == (
        before.genus, before.components, before.boundary_loops,
    )  # fmt: skip
    assert features(work) == corners


def test_vertices_stay_on_their_patch_and_curve():
    mesh = cylinder(around=24, rings=8)
    work = WorkMesh(make_carrier(mesh))
    for name in ("split", "flip for angles", "smooth", "collapse", "smooth by area", "search"):
        OPERATIONS[name](work, 0.2, 0.5)
    result, bases = work.to_mesh()
    radius = np.hypot(result.points[:, 0], result.points[:, 1])
    on_rim = work.links[bases, KIND] == CURVE
    height = result.points[:, 2]
    assert np.all((height[on_rim] == 0.0) | (height[on_rim] == 2.0))
    assert np.all(radius[on_rim] >= np.cos(np.pi / 24) - 1e-12)
    side = np.unique(result.faces[result.face_labels == 1])
    assert radius[side].min() >= np.cos(np.pi / 24) - 1e-12
    for row in range(work.counts[0]):
        if work.links[row, BASE] >= 0:
            assert 0 <= work.links[row, HINT] < len(mesh.faces)
    corners = work.halves[: 3 * work.counts[1], ORIGIN]
    live = corners >= 0
    labels = np.repeat(work.labels[: work.counts[1]], 3)[live]
    hinted = work.carrier.mesh.face_labels[work.links[corners[live], HINT]]
    np.testing.assert_array_equal(labels, hinted)


def test_collapse_refuses_what_would_pinch():
    """A tetrahedron and a ring of three cannot lose an edge."""
    points = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    work = WorkMesh(make_carrier(TriMesh(points, faces)))
    assert collapse_short_edges(work, 100.0, 1e3, 0.0, (0.0, 0.0, -1.0)) == 0
    ring = torus(n_major=3, n_minor=3)
    work = WorkMesh(make_carrier(ring))
    collapse_short_edges(work, 100.0, 1e3, 0.0, (0.0, 0.0, -1.0))
    assert broken_links(work) == []
    result, _ = work.to_mesh()
    assert topology(result.faces, len(result.points)).genus == 1


def test_free_lists_are_reused():
    work = WorkMesh(make_carrier(icosphere(3)))
    for _ in range(6):
        assert split_long_edges(work, 0.9 * mean_edge(work), 0.0, 0.1) > 0
        assert collapse_short_edges(work, 1.1 * mean_edge(work), 3.0, 0.0, (0, 0, 0.1)) > 0
    used = work.counts[1]
    live = np.count_nonzero(work.halves[: 3 * used : 3, ORIGIN] >= 0)
    assert live == 2 * work.vertices - 4
    work.compact()
    assert work.counts[1] == live
    assert broken_links(work) == []
