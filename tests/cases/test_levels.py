"""Runs on nested meshes: what they write, and that they go on where they were killed."""

import csv
import json

import numpy as np
import pytest

from cases.cli import main
from cases.history import HistoryFile
from meshes.io import load_tet_mesh
from tests.cases.cases_in_text import TINY, write_case
from topopt.domain import mesh_hash
from topopt.geometry import tet_geometry

LATTICE = "mesh: {kind: bcc, tets: 1500}"
# The direct solver, so that every row is as exact as the certificate, whatever the mesh's size.
CASE = TINY.replace("steps: 5", "steps: 5\n  tolerance: 0\n  stagnation: 0\n  solver: direct")
CASE += "output: {pictures: false, snapshots: 3}\n"
NESTED = CASE.replace(LATTICE, "mesh: {kind: bcc, tets: 1500, levels: 2}")
ADAPTED = CASE.replace(LATTICE, "mesh: {edge_length: 1.8mm, adapted: true}")


class Killed(BaseException):
    """Ends a run as SIGKILL does: nothing is kept that is not on disk."""


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    """Adapted meshes come from here the second time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PHASEMESH_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module", params=[NESTED, ADAPTED], ids=["nested", "adapted"])
def unbroken(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("unbroken")
    path = write_case(folder, request.param)
    assert run(path, folder / "run") == 0
    return path, folder / "run"


def run(path, out, *arguments):
    return main([str(path), "--out", str(out), "--quiet", "--stop-after", "isosurface", *arguments])


def rows_of(folder):
    with open(folder / "history.csv", encoding="ascii", newline="") as file:
        return [{**row, "seconds": None} for row in csv.DictReader(file)]


def places_of(folder):
    """(iteration, level) of every row, and the first level's number of steps."""
    places = [(int(row["iteration"]), int(row["level"])) for row in rows_of(folder)]
    return places, max(step for step, level in places if level == 1)


def manifest_of(folder):
    return json.loads((folder / "manifest.json").read_text())


def end_at(patch, row, error):
    """Make the run end with `error` when it notes the (iteration, level) `row`."""
    append = HistoryFile.append

    def noted(self, new):
        append(self, new)
        if (new.iteration, new.level) == row:
            raise error

    patch.setattr(HistoryFile, "append", noted)


def test_every_level_has_its_rows(unbroken):
    rows = rows_of(unbroken[1])
    places, coarse = places_of(unbroken[1])
    last = places[-1][0]
    assert 2 <= coarse <= 5 and 2 <= last - coarse <= 5
    steps = [(k, 1) for k in range(1, coarse + 1)] + [(k, 2) for k in range(coarse, last + 1)]
    assert places == steps
    for level in ("1", "2"):
        objective = [float(row["objective_J"]) for row in rows if row["level"] == level]
        assert np.all(np.diff(objective) < 0)
    for row in rows:
        assert float(row["volume_fraction"]) == pytest.approx(0.4, rel=1e-9)


def test_result_and_certificate_are_the_last_level_s(unbroken):
    folder = unbroken[1]
    mesh, coarse = (load_tet_mesh(folder / name) for name in ("mesh.npz", "mesh-level1.npz"))
    manifest = manifest_of(folder)
    assert manifest["mesh"]["hash"] == mesh_hash(mesh)
    assert manifest["mesh"]["coarse_tets"] == [len(coarse.tets)]
    assert len(mesh.tets) > 1.1 * len(coarse.tets)
    with np.load(folder / "phase_field.npz") as design:
        mass = tet_geometry(mesh).lumped_mass
        assert mass @ design["values"] == pytest.approx(0.4 * mass.sum(), rel=1e-9)
    kkt = json.loads((folder / "kkt.json").read_text())["kkt"]
    assert kkt["residual"] == pytest.approx(float(rows_of(folder)[-1]["kkt_residual"]), rel=1e-4)
    places, coarse = places_of(folder)
    told = f"{places[-1][0]} steps ({coarse} of them on coarser meshes)"
    assert told in (folder / "summary.txt").read_text()
    assert (folder / "fields" / "design.pvd").read_text().count("<DataSet") >= 2


@pytest.mark.parametrize("after", [-1, 0, 2])
def test_a_killed_run_goes_on_in_its_level(unbroken, tmp_path, after):
    """Killed so many rows after the second level's start."""
    path, whole = unbroken
    out = tmp_path / "run"
    places, coarse = places_of(whole)
    with pytest.MonkeyPatch.context() as patch:
        end_at(patch, places[coarse + after], Killed)
        with pytest.raises(Killed):
            run(path, out)
    assert run(path, out, "--resume") == 0
    assert rows_of(out) == rows_of(whole)
    last = f"fields/step_{places[-1][0]:04d}.vtu"
    for name in ("isosurface.ply", last, "fields/design.pvd"):
        assert (out / name).read_bytes() == (whole / name).read_bytes(), name
    with np.load(out / "phase_field.npz") as a, np.load(whole / "phase_field.npz") as b:
        assert np.array_equal(a["values"], b["values"])
    assert manifest_of(out)["mesh"] == manifest_of(whole)["mesh"]


def test_a_run_interrupted_on_a_coarse_mesh_leaves_a_design(unbroken, tmp_path):
    path, whole = unbroken
    out = tmp_path / "run"
    with pytest.MonkeyPatch.context() as patch:
        end_at(patch, (2, 1), KeyboardInterrupt)
        assert run(path, out) == 130
    assert [row["level"] for row in rows_of(out)] == ["1", "1"]
    with np.load(out / "phase_field.npz") as design:
        assert len(design["values"]) == len(load_tet_mesh(out / "mesh.npz").points)
    assert run(path, out, "--resume") == 0
    assert rows_of(out) == rows_of(whole)


def test_another_mesh_under_a_checkpoint_is_refused(unbroken, tmp_path, capsys):
    path, whole = unbroken
    out = tmp_path / "run"
    with pytest.MonkeyPatch.context() as patch:
        end_at(patch, places_of(whole)[0][-1], Killed)
        with pytest.raises(Killed):
            run(path, out)
    (out / "mesh.npz").write_bytes((out / "mesh-level1.npz").read_bytes())
    assert run(path, out, "--resume") == 2
    assert "made with another mesh" in capsys.readouterr().err


def test_what_makes_no_sense_is_refused(tmp_path, capsys):
    path = write_case(tmp_path, CASE)
    for setting, sentence in (
        ("mesh.adapted=true", "mesh: can take adapted: true with kind: pytetwild only"),
        ("mesh.levels=0", "mesh.levels: must lie in [1, 6], got 0"),
    ):
        assert run(path, tmp_path / "run", "--set", setting) == 2
        assert sentence in capsys.readouterr().err
    path = write_case(tmp_path, ADAPTED)
    assert run(path, tmp_path / "run", "--set", "mesh.levels=1") == 2
    assert "adapted: true with levels: 2 or more only" in capsys.readouterr().err
