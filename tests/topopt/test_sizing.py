"""Edge lengths that follow an interface, and the meshes that pytetwild makes of them."""

from dataclasses import replace

import numpy as np
import pytest

from meshes import InvalidCase, PhaseField
from meshes.structured import bcc_box
from tests.topopt.problems import bridge
from tests.topopt.test_domain import check_box
from topopt import meshing_tetwild
from topopt.domain import attach_sets, estimated_edge_length, mesh_domain
from topopt.parameters import LOCAL_EDGES, mean_edge_length
from topopt.problem import Box, BoxDomain, Support
from topopt.sizing import (
    COARSEST,
    GROWTH,
    SHORTER,
    Sizing,
    distance_along_edges,
    interface_sizing,
)

SIZE = (0.06, 0.02, 0.02)
SHORT = 0.0017


def problem(scale=1.0):
    domain = BoxDomain((0.0, 0.0, 0.0), tuple(scale * side for side in SIZE))
    return replace(bridge(), domain=domain, loads=(), supports=(), symmetry=())


def slab(scale=1.0):
    """A design whose interface is the plane x = 10 mm."""
    mesh = bcc_box((0, 0, 0), scale * np.array(SIZE), (18, 6, 6))
    return PhaseField(mesh, np.clip(0.5 + (0.01 - mesh.points[:, 0] / scale) / 0.004, 0.0, 1.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("meshes")


@pytest.fixture(scope="module")
def adapted(folder):
    return mesh_domain(problem(), sizing=interface_sizing(slab(), SHORT), cache=folder)


def test_lengths_are_short_at_the_interface_and_grow_with_the_distance():
    design = slab()
    x, wanted = design.mesh.points[:, 0], interface_sizing(design, SHORT).edge_lengths
    shortest = SHORTER * SHORT
    assert np.all(wanted[np.abs(x - 0.01) < 0.002] == shortest)
    assert wanted.max() == COARSEST * shortest == wanted[x > 0.05].min()
    for a, b in LOCAL_EDGES:
        one, two = design.mesh.tets[:, a], design.mesh.tets[:, b]
        length = np.linalg.norm(design.mesh.points[one] - design.mesh.points[two], axis=1)
        assert np.all(np.abs(wanted[one] - wanted[two]) <= GROWTH * length * (1 + 1e-12))


def test_lengths_are_half_as_short_at_the_edges_of_supports():
    design = slab()
    half = Support("half", Box((SIZE[0], -1.0, -1.0), (SIZE[0], 0.009, 1.0)))  # ends within facets
    mesh = attach_sets(design.mesh, replace(problem(), supports=(half,)))
    wanted = interface_sizing(PhaseField(mesh, design.values), SHORT).edge_lengths
    x, y = design.mesh.points[:, 0], design.mesh.points[:, 1]
    at_edge = (x == SIZE[0]) & (np.abs(y - 0.009) < 0.0012)
    assert at_edge.sum() > 4 and np.all(wanted[at_edge] == 0.5 * SHORTER * SHORT)
    assert np.all(wanted[(x == SIZE[0]) & (np.abs(y - 0.009) > 0.005)] > SHORTER * SHORT)
    assert np.all(wanted <= interface_sizing(design, SHORT).edge_lengths)
    assert wanted.max() == COARSEST * SHORTER * SHORT


def test_distance_along_the_edges_of_one_tet():
    mesh = bcc_box((0, 0, 0), (2.0, 2.0, 2.0), (2, 2, 2))
    start = np.all(mesh.points == 0.0, axis=1)
    distance = distance_along_edges(mesh, start)
    corner = np.all(mesh.points == 2.0, axis=1)
    assert distance[start] == 0.0
    assert distance[corner] == pytest.approx(2.0 * np.sqrt(3.0))  # through the cells' centres
    assert np.all(distance >= np.linalg.norm(mesh.points, axis=1) * (1 - 1e-12))
    assert np.all(np.isinf(distance_along_edges(mesh, ~(distance >= 0.0))))


def test_a_design_without_interface_is_coarse_everywhere():
    mesh = slab().mesh
    lengths = interface_sizing(PhaseField(mesh, np.ones(len(mesh.points))), SHORT).edge_lengths
    assert np.all(lengths == COARSEST * SHORTER * SHORT)


def test_the_mesh_is_fine_where_it_was_asked_to_be(adapted):
    check_box(adapted, (0, 0, 0), SIZE)
    middle = adapted.points[adapted.tets].mean(axis=1)[:, 0]
    near = mean_edge_length(adapted, adapted.tets[np.abs(middle - 0.01) < 0.002])
    far = mean_edge_length(adapted, adapted.tets[middle > 0.04])
    assert 0.8 * SHORT < near < 1.4 * SHORT
    assert far > 2.0 * near


def test_a_scaled_domain_finds_the_same_mesh(adapted, folder, monkeypatch):
    monkeypatch.setattr(meshing_tetwild, "tetrahedralize", lambda *a, **k: pytest.fail("meshed"))
    sizing = interface_sizing(slab(1e3), 1e3 * SHORT)
    found = mesh_domain(problem(1e3), sizing=sizing, cache=folder)
    np.testing.assert_allclose(found.points, 1e3 * adapted.points, rtol=1e-9)


def test_another_sizing_is_another_mesh(adapted, folder, monkeypatch):
    class Meshed(Exception):
        pass

    def mark(*_, **options):
        assert options["bg_values"].min() > 0
        raise Meshed

    monkeypatch.setattr(meshing_tetwild, "tetrahedralize", mark)
    sizing = interface_sizing(slab(), SHORT)
    lengths = sizing.edge_lengths.copy()
    lengths[7] *= 0.9
    with pytest.raises(Meshed):
        mesh_domain(problem(), sizing=replace(sizing, edge_lengths=lengths), cache=folder)


def test_what_makes_no_sense_is_refused():
    sizing = interface_sizing(slab(), SHORT)
    with pytest.raises(InvalidCase, match="takes the place of"):
        mesh_domain(problem(), edge_length=SHORT, sizing=sizing)
    with pytest.raises(InvalidCase, match="needs 'pytetwild'"):
        mesh_domain(problem(), kind="bcc", sizing=sizing)
    for lengths in ([1.0], -sizing.edge_lengths, np.full_like(sizing.edge_lengths, np.nan)):
        with pytest.raises(InvalidCase, match="one positive edge length for each node"):
            Sizing(sizing.mesh, lengths)


def test_the_estimated_edge_length_gives_about_the_count(folder):
    length = estimated_edge_length(problem(), 1500)
    assert 750 < len(mesh_domain(problem(), edge_length=length, cache=folder).tets) < 3000
