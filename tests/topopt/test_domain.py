"""Meshes of a box: exact planes and volume, independent of units, kept on disk."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from meshes import InvalidCase, NotConverged
from meshes.io import load_tet_mesh, save_tet_mesh
from meshes.structured import bcc_box
from meshes.tet_mesh import boundary_facets, tet_volumes
from tests.topopt.problems import bridge
from topopt import meshing_tetwild
from topopt.domain import attach_sets, bcc_count, default_cache, mesh_domain, mesh_hash
from topopt.problem import BoxDomain

LOWER, SIZE = np.array([0.01, 0.0, -0.02]), np.array([0.05, 0.015, 0.02])
COARSE = 0.005  # m


def box(scale=1.0, lower=LOWER):
    domain = BoxDomain(tuple(scale * lower), tuple(scale * (lower + SIZE)))
    return replace(bridge(), domain=domain, loads=(), supports=(), symmetry=())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("meshes")


@pytest.fixture(scope="module")
def workplace(tmp_path_factory):
    """The folder in which pytetwild is called."""
    return tmp_path_factory.mktemp("workplace")


@pytest.fixture(scope="module")
def tetwild_box(folder, workplace):
    """The one pytetwild mesh of this file, about 1500 tets."""
    with contextlib.chdir(workplace):
        return mesh_domain(box(), edge_length=COARSE, cache=folder)


@pytest.fixture
def no_pytetwild(monkeypatch):
    """Fail if pytetwild is run."""
    monkeypatch.setattr(meshing_tetwild, "tetrahedralize", lambda *a, **k: pytest.fail("meshed"))


def check_box(mesh, lower, upper):
    """Every property a mesh of a box must have."""
    lower, upper = np.asarray(lower), np.asarray(upper)
    volumes = tet_volumes(mesh.points, mesh.tets)
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(np.prod(upper - lower), rel=1e-12)
    np.testing.assert_array_equal(np.unique(mesh.tets), np.arange(len(mesh.points)))
    np.testing.assert_array_equal(mesh.points.min(axis=0), lower)
    np.testing.assert_array_equal(mesh.points.max(axis=0), upper)
    assert [patch.name for patch in mesh.patches] == ["x-", "x+", "y-", "y+", "z-", "z+"]
    wanted = {tuple(sorted(facet)) for facet in boundary_facets(mesh.tets).tolist()}
    assert {tuple(sorted(facet)) for facet in mesh.facets.tolist()} == wanted
    corners = mesh.points[mesh.facets]
    vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    for k, patch in enumerate(mesh.patches):
        axis, normal = k // 2, np.array(patch.plane.normal)
        here = mesh.facet_patch == k
        assert np.all(corners[here][..., axis] == (upper if k % 2 else lower)[axis])
        area = np.prod(np.delete(upper - lower, axis))
        np.testing.assert_allclose(vectors[here].sum(axis=0), normal * area, atol=1e-12 * area)


def test_pytetwild_fills_the_box_exactly(tetwild_box):
    check_box(tetwild_box, LOWER, LOWER + SIZE)
    assert 500 < len(tetwild_box.tets) < 5000


def test_pytetwild_leaves_nothing_in_the_working_folder(tetwild_box, workplace):
    assert list(workplace.iterdir()) == []


def test_nodes_tets_and_facets_are_ordered_in_space(tetwild_box):
    """Along a Morton curve neighbours are mostly near in memory; at random a third would be."""
    n = len(tetwild_box.points)
    spread = np.ptp(tetwild_box.tets, axis=1)
    assert np.median(spread) < 0.25 * n
    centres = tetwild_box.points[tetwild_box.tets].mean(axis=1)
    step = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    assert np.median(step) < 1.5 * COARSE


def test_a_mesh_is_kept_and_used_again(tetwild_box, folder, no_pytetwild):
    words = []
    again = mesh_domain(box(), edge_length=COARSE, cache=folder, log=words.append)
    assert mesh_hash(again) == mesh_hash(tetwild_box)
    np.testing.assert_array_equal(again.facets, tetwild_box.facets)
    assert len(words) == 1 and "from the cache" in words[0]


@pytest.mark.parametrize("scale", [2.0**10, 2.0**-40])
def test_powers_of_two_give_the_same_bits(scale, tetwild_box, folder, no_pytetwild):
    mesh = mesh_domain(box(scale), edge_length=scale * COARSE, cache=folder)
    np.testing.assert_array_equal(mesh.points, scale * tetwild_box.points)
    np.testing.assert_array_equal(mesh.tets, tetwild_box.tets)
    np.testing.assert_array_equal(mesh.facet_patch, tetwild_box.facet_patch)


@pytest.mark.parametrize("scale", [1000.0, 1e-9, 1e9, 1 / 3])
def test_the_same_box_in_other_units_and_elsewhere_is_the_same_mesh(
    scale, tetwild_box, folder, no_pytetwild
):
    lower = np.array([0.3, -0.2, 0.7])
    mesh = mesh_domain(box(scale, lower), edge_length=scale * COARSE, cache=folder)
    np.testing.assert_array_equal(mesh.tets, tetwild_box.tets)
    moved = scale * (tetwild_box.points - LOWER + lower)
    np.testing.assert_allclose(mesh.points, moved, rtol=0, atol=1e-15 * scale)
    check_box(mesh, mesh.points.min(axis=0), mesh.points.max(axis=0))


def lattice_of(points, faces, edge_length_abs, **options):
    """A stand-in for pytetwild: a lattice, its boundary off the planes by half the envelope."""
    sides = points.max(axis=0)
    mesh = mesh_domain(
        replace(bridge(), domain=BoxDomain((0, 0, 0), tuple(sides))), tets=2000, kind="bcc"
    )
    noise = np.random.default_rng(0).uniform(-5e-4, 5e-4, mesh.points.shape)
    unused = np.array([[9.0, 9, 9]])
    return np.concatenate([unused, mesh.points + noise]), mesh.tets[::-1] + 1


@pytest.fixture
def lattice(monkeypatch):
    """Put the stand-in in place of pytetwild; the list has one entry per call."""
    calls = []

    def stand_in(*arguments, **options):
        calls.append(options)
        return lattice_of(*arguments, **options)

    monkeypatch.setattr(meshing_tetwild, "tetrahedralize", stand_in)
    return calls


def test_planes_are_snapped_unused_nodes_dropped_and_nodes_renumbered(lattice, tmp_path):
    check_box(mesh_domain(box(), edge_length=0.004, cache=tmp_path), LOWER, LOWER + SIZE)
    options = {"num_threads": 1, "vtk_ordering": True, "epsilon": 1e-3, "seconds": None}
    options["stop_energy"] = 15.0
    assert lattice == [options | {"edge_length_abs": pytest.approx(0.08, rel=1e-12)}]


@pytest.mark.parametrize("damage", ["cut off", "garbage", "inverted"])
def test_a_damaged_file_is_made_again_and_replaced(damage, lattice, tmp_path):
    first = mesh_domain(box(), edge_length=COARSE, cache=tmp_path)
    (path,) = tmp_path.iterdir()
    data = path.read_bytes()
    if damage == "inverted":
        kept = load_tet_mesh(path)
        save_tet_mesh(path, replace(kept, tets=kept.tets[:, [0, 2, 1, 3]]))
    else:
        path.write_bytes(data[: len(data) // 2] if damage == "cut off" else b"no mesh")
    words = []
    again = mesh_domain(box(), edge_length=COARSE, cache=tmp_path, log=words.append)
    assert "damaged" in words[0] and str(path) in words[0]
    assert len(lattice) == 2
    assert mesh_hash(again) == mesh_hash(first)  # the stand-in, unlike pytetwild, repeats itself
    assert path.read_bytes() == data and len(list(tmp_path.iterdir())) == 1


def test_the_cache_tells_domains_and_sizes_apart(lattice, tmp_path):
    first = mesh_domain(box(), edge_length=COARSE, cache=tmp_path)
    mesh_domain(box(), edge_length=1.01 * COARSE, cache=tmp_path)
    mesh_domain(box(), tets=len(first.tets), cache=tmp_path)
    longer = BoxDomain((0, 0, 0), (0.051, 0.015, 0.02))
    mesh_domain(replace(box(), domain=longer), edge_length=COARSE, cache=tmp_path)
    assert len(list(tmp_path.iterdir())) == 4


def test_no_cache_and_no_room_for_one(lattice, tmp_path):
    mesh_domain(box(), edge_length=COARSE, cache=False)
    taken = tmp_path / "taken"
    taken.write_text("a file where the folder should be")
    words = []
    check_box(
        mesh_domain(box(), edge_length=COARSE, cache=taken, log=words.append), LOWER, LOWER + SIZE
    )
    assert any("not kept" in word for word in words)


def test_the_default_folder_follows_the_environment(monkeypatch, tmp_path, lattice):
    monkeypatch.setenv("PHASEMESH_CACHE", str(tmp_path))
    assert default_cache() == tmp_path / "meshes"
    mesh_domain(box(), edge_length=COARSE)
    assert len(list((tmp_path / "meshes").iterdir())) == 1
    monkeypatch.delenv("PHASEMESH_CACHE")
    assert default_cache().parts[-3:] == (".cache", "phasemesh", "meshes")


def test_meshes_that_do_not_fit_are_made_again_and_given_up(monkeypatch):
    def spoilt(points, faces, **options):
        vertices, tets = lattice_of(points, faces, **options)
        vertices[vertices[:, 2] < 0.01, 2] += 0.05  # far from its plane
        return vertices, tets

    monkeypatch.setattr(meshing_tetwild, "tetrahedralize", spoilt)
    words = []
    with pytest.raises(NotConverged, match=r"no valid mesh in 3 tries .*boundary facets lie on no"):
        mesh_domain(box(), edge_length=COARSE, cache=False, log=words.append)
    assert sum("is not used" in word for word in words) == 3


def test_a_mesh_that_is_too_coarse_is_made_again(monkeypatch, lattice):
    """The stand-in gives the same lattice whatever the edge length."""
    words = []
    with pytest.raises(NotConverged, match=r"edges are 3\.. times as long as asked for"):
        mesh_domain(box(), edge_length=COARSE / 4, cache=False, log=words.append)
    assert [call["stop_energy"] for call in lattice] == [15.0, 10.0, 10.0]


def test_tets_that_snapping_makes_flat_are_left_out(monkeypatch):
    """On some pairs of boundary facets, one within the envelope of the plane is put on top."""
    added = []

    def with_slivers(points, faces, **options):
        vertices, tets = lattice_of(points, faces, **options)
        facets = boundary_facets(tets)
        on_top = facets[(vertices[facets][:, :, 2] > points[:, 2].max() - 1e-3).all(axis=1)]
        edges = {}
        for facet in on_top.tolist():
            for k in range(3):
                edges[facet[k], facet[(k + 1) % 3]] = facet
        used = set()
        for (a, b), facet in edges.items():
            other = edges.get((b, a))
            if other is None or used & {*facet, *other}:
                continue
            (c,), (d,) = set(facet) - {a, b}, set(other) - {a, b}
            used |= {a, b, c, d}
            vertices[[a, b], 2] -= 3e-4
            added.append([a, b, c, d])
        return vertices, np.concatenate([tets, np.array(added, tets.dtype)])

    monkeypatch.setattr(meshing_tetwild, "tetrahedralize", with_slivers)
    words = []
    mesh = mesh_domain(box(), edge_length=COARSE, cache=False, log=words.append)
    assert len(added) > 3 and not any("not used" in word for word in words)
    check_box(mesh, LOWER, LOWER + SIZE)
    volumes = tet_volumes(mesh.points, mesh.tets)
    assert volumes.min() > 1e-3 * volumes.mean()


@pytest.mark.parametrize(
    "program, how",
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "signal 11"),
        ("raise MemoryError('no room for it')", "code 1 and the words: MemoryError: no room"),
        ("pass", "code 0;"),
    ],
)
def test_a_crash_of_pytetwild_is_a_sentence(program, how, monkeypatch, tmp_path, capfd):
    script = tmp_path / "worker.py"
    script.write_text(program)
    monkeypatch.setattr(meshing_tetwild, "WORKER", script)
    with pytest.raises(NotConverged, match=how):
        mesh_domain(box(), edge_length=COARSE, cache=False)
    assert capfd.readouterr() == ("", "")


def test_meshing_ends_when_its_time_is_up(monkeypatch, tmp_path):
    script = tmp_path / "worker.py"
    script.write_text("import time; time.sleep(60)")
    monkeypatch.setattr(meshing_tetwild, "WORKER", script)
    for arguments in ({"edge_length": COARSE}, {"tets": 2000}):
        with pytest.raises(NotConverged, match=r"not meshed within 0\.3 s .*mesh\.time_limit\.$"):
            mesh_domain(box(), **arguments, cache=False, time_limit=0.3)


def test_what_pytetwild_leaves_behind_is_not_left_here(monkeypatch, tmp_path):
    script = tmp_path / "worker.py"
    script.write_text("open('left.stl', 'w').close(); raise MemoryError('words')")
    monkeypatch.setattr(meshing_tetwild, "WORKER", script)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(NotConverged, match="words"):
        mesh_domain(box(), edge_length=COARSE, cache=False)
    assert [path.name for path in tmp_path.iterdir()] == ["worker.py"]


# The lattice of kind "bcc"


@pytest.mark.parametrize("tets", [500, 3000, 20000])
def test_a_lattice_has_about_the_count_asked_for(tets):
    mesh = mesh_domain(box(), tets=tets, kind="bcc")
    check_box(mesh, LOWER, LOWER + SIZE)
    assert len(mesh.tets) == pytest.approx(tets, rel=0.05)


def test_a_lattice_has_about_the_edge_length_asked_for():
    mesh = mesh_domain(box(), edge_length=0.0015, kind="bcc")
    ends = (
        mesh.points[mesh.tets[:, [0, 0, 0, 1, 1, 2]]]
        - mesh.points[mesh.tets[:, [1, 2, 3, 2, 3, 3]]]
    )
    assert np.linalg.norm(ends, axis=2).mean() == pytest.approx(0.0015, rel=0.1)


@pytest.mark.parametrize("scale", [1000.0, 1e-9, 2.0**20])
def test_a_lattice_does_not_depend_on_units(scale):
    one = mesh_domain(box(), tets=2000, kind="bcc")
    other = mesh_domain(box(scale), tets=2000, kind="bcc")
    np.testing.assert_array_equal(one.tets, other.tets)
    np.testing.assert_array_equal(one.facets, other.facets)
    np.testing.assert_allclose(other.points, scale * one.points, rtol=1e-13, atol=1e-17 * scale)
    if scale == 2.0**20:
        np.testing.assert_array_equal(other.points, scale * one.points)
        assert mesh_hash(mesh_domain(box(), tets=2000, kind="bcc")) == mesh_hash(one)
        assert mesh_hash(other) != mesh_hash(one)


@pytest.mark.parametrize("cells", [(1, 1, 1), (3, 5, 2)])
def test_the_count_of_a_lattice_is_known(cells):
    assert len(bcc_box((0, 0, 0), cells, cells).tets) == bcc_count(cells)


def test_sets_can_be_attached_to_any_mesh(tetwild_box):
    problem = bridge()
    mesh = attach_sets(mesh_domain(problem, tets=3000, kind="bcc"), problem)
    assert len(mesh.facet_sets["load:deck"]) and len(mesh.node_sets["support:ends"])


@pytest.mark.parametrize(
    "arguments, words",
    [
        ({}, "either an edge length or a number of tets"),
        ({"edge_length": 1.0, "tets": 5}, "either an edge length or a number of tets"),
        ({"edge_length": 0.0}, "edge length of the mesh must be positive"),
        ({"edge_length": float("nan")}, "must be positive, got nan"),
        ({"tets": -3}, "number of tets of the mesh must be positive"),
        ({"tets": 100, "kind": "hex"}, "no mesh of kind 'hex'"),
        ({"edge_length": 1e-6}, "raise the edge length"),
        ({"tets": 10**9}, "50,000,000 are the limit"),
    ],
)
def test_bad_arguments_are_refused(arguments, words):
    with pytest.raises(InvalidCase, match=words):
        mesh_domain(box(), **arguments)


@pytest.mark.parametrize("upper", [(1, 1, 0), (1, 1, -1), (1, float("nan"), 1)])
def test_a_box_without_volume_is_refused(upper):
    problem = replace(box(), domain=BoxDomain((0, 0, 0), upper))
    with pytest.raises(InvalidCase, match="has no volume"):
        mesh_domain(problem, tets=1000)
