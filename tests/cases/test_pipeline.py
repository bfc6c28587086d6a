"""The whole line on a small box: all files and what they say, --from, --stop-after, repeats."""

import csv
import itertools
import json
import subprocess
import sys

import meshio
import numpy as np
import pytest
from ruamel.yaml import YAML

from cases.cli import main
from cases.pictures import make_pictures
from meshes.io import read_surface
from meshes.quality import signed_volume
from meshes.topology import topology
from tests.cases.cases_in_text import TINY, write_case

QUALITY_KEYS = [
    "vertices", "faces", "watertight", "nonmanifold_edges", "nonmanifold_vertices",
    "self_intersecting_faces", "degenerate_faces", "euler", "components", "genus", "volume_m3",
    "volume_drift", "min_angle_worst", "min_angle_mean", "pct_below_20", "pct_below_30",
    "edge_ratio", "min_angle_6d_mean",
]  # fmt: skip

HISTORY_COLUMNS = (
    "iteration,level,compliance_J,ginzburg_landau_J,objective_J,volume_fraction,tau,rejected,"
    "pdas_iterations,state_iterations,kkt_residual,kkt_stationarity,kkt_complementarity,kkt_sign,"
    "volume_error,seconds"
)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """A folder with the case and a finished run of it (without pictures)."""
    folder = tmp_path_factory.mktemp("tiny")
    path = write_case(folder, TINY + "output: {pictures: false, snapshots: 2}\n")
    assert run(path, folder / "run") == 0
    return path, folder / "run"


def run(path, out, *arguments):
    return main([str(path), "--out", str(out), "--quiet", *arguments])


def rows_of(path):
    with open(path, encoding="ascii", newline="") as file:
        return list(csv.DictReader(file))


def without_seconds(path):
    return [{**row, "seconds": None} for row in rows_of(path)]


def test_all_files_are_there(tiny):
    found = {str(p.relative_to(tiny[1])) for p in tiny[1].rglob("*") if p.is_file()}
    steps = {"fields/step_0001.vtu", "fields/step_0002.vtu", "fields/step_0005.vtu"}
    assert found == steps | {
        "case.yaml", "manifest.json", "history.csv", "kkt.json", "run.log",
        "fields/design.pvd", "mesh.npz",
        "phase_field.npz", "isosurface.ply", "smoothed.ply", "surface.ply", "surface.stl",
        "quality.json", "summary.txt", "checkpoint-0.npz", "checkpoint-1.npz",
    }  # fmt: skip


def test_case_yaml_holds_every_value(tiny):
    tree = YAML(typ="safe").load(tiny[1] / "case.yaml")
    assert tree["topopt"]["volume_fraction"] == 0.4
    assert tree["material"]["void_ratio"] == 1e-4
    assert tree["rbf"]["form"] == "hermite"


def test_manifest(tiny):
    manifest = json.loads((tiny[1] / "manifest.json").read_text())
    assert manifest["outcome"] == "finished"
    assert manifest["seed"] == 1
    assert manifest["versions"]["numpy"] == np.__version__
    assert len(manifest["mesh"]["hash"]) == 64
    assert manifest["mesh"]["tets"] > 1000
    assert list(manifest["stages"]) == [
        "mesh", "topopt", "isosurface", "smooth", "remesh", "output",
    ]  # fmt: skip
    for stage in manifest["stages"].values():
        assert stage["seconds"] >= 0
        assert stage["peak_memory_mib"] > 10


def test_history(tiny):
    lines = (tiny[1] / "history.csv").read_text().splitlines()
    assert lines[0] == HISTORY_COLUMNS
    rows = rows_of(tiny[1] / "history.csv")
    assert [int(row["iteration"]) for row in rows] == [1, 2, 3, 4, 5]
    objective = [float(row["objective_J"]) for row in rows]
    assert all(after <= before for before, after in itertools.pairwise(objective))
    for row in rows:
        assert float(row["volume_fraction"]) == pytest.approx(0.4, rel=1e-9)
        total = float(row["compliance_J"]) + float(row["ginzburg_landau_J"])
        assert float(row["objective_J"]) == pytest.approx(total, rel=1e-12)


def test_fields_open_as_a_series(tiny):
    text = (tiny[1] / "fields" / "design.pvd").read_text()
    assert text.count("<DataSet") == 3
    grid = meshio.read(tiny[1] / "fields" / "step_0005.vtu")
    phi = grid.point_data["phi"]
    assert phi.min() >= 0
    assert phi.max() <= 1
    assert grid.point_data["displacement_m"].shape == (len(phi), 3)
    assert len(grid.cell_data["energy_density_J_per_m3"][0]) == len(grid.cells[0].data)
    assert grid.cell_data["energy_density_J_per_m3"][0].min() > 0


def test_energy_density_adds_up_to_the_compliance(tiny):
    grid = meshio.read(tiny[1] / "fields" / "step_0005.vtu")
    corners = grid.points[grid.cells[0].data]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    energy = volumes @ grid.cell_data["energy_density_J_per_m3"][0]
    compliance = float(rows_of(tiny[1] / "history.csv")[-1]["compliance_J"])
    assert energy == pytest.approx(compliance, rel=1e-3)


def test_quality(tiny):
    quality = json.loads((tiny[1] / "quality.json").read_text())
    assert list(quality) == ["isosurface", "smoothed", "surface"]
    assert list(quality["isosurface"]) == QUALITY_KEYS
    for name in ("smoothed", "surface"):
        further = ["distance_rms", "distance_max", "roughness_deg"]
        assert list(quality[name]) == QUALITY_KEYS + further
        assert abs(quality[name]["volume_drift"]) < 0.01
    for figures in quality.values():
        assert figures["watertight"]
        assert figures["components"] == 1
        for key in ("nonmanifold_edges", "nonmanifold_vertices", "self_intersecting_faces"):
            assert figures[key] == 0


def test_surfaces(tiny):
    metres = read_surface(tiny[1] / "surface.ply")
    millimetres = read_surface(tiny[1] / "surface.stl")
    assert np.ptp(metres.points, axis=0).max() <= 0.04 + 1e-9
    assert signed_volume(millimetres) == pytest.approx(1e9 * signed_volume(metres), rel=1e-5)
    assert topology(millimetres.faces, len(millimetres.points)).watertight
    assert {patch.name for patch in metres.labels} >= {"isosurface", "z+"}
    quality = json.loads((tiny[1] / "quality.json").read_text())["surface"]
    assert signed_volume(metres) == pytest.approx(quality["volume_m3"], rel=1e-12)
    assert quality["vertices"] == len(millimetres.points)


def test_smoothed_is_exactly_symmetric(tiny):
    smoothed = read_surface(tiny[1] / "smoothed.ply")
    for axis in (0, 1):
        mirrored = smoothed.points.copy()
        mirrored[:, axis] *= -1
        both = [
            np.array(sorted(map(tuple, points + 0.0))) for points in (smoothed.points, mirrored)
        ]
        assert np.array_equal(*both)


def test_from_remesh_reuses_the_earlier_stages(tiny, tmp_path):
    path, out = tiny
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("case.yaml", "manifest.json", "mesh.npz", "phase_field.npz", "smoothed.ply",
                 "isosurface.ply", "surface.ply", "run.log"):  # fmt: skip
        (copy / name).write_bytes((out / name).read_bytes())
    before = (copy / "phase_field.npz").stat().st_mtime_ns
    assert run(path, copy, "--from", "remesh", "--set", "remesh.sigma=0") == 0
    assert (copy / "phase_field.npz").stat().st_mtime_ns == before
    assert (copy / "surface.ply").read_bytes() != (out / "surface.ply").read_bytes()
    assert (copy / "smoothed.ply").read_bytes() == (out / "smoothed.ply").read_bytes()
    stages = json.loads((copy / "manifest.json").read_text())["stages"]
    assert stages["topopt"]["reused"]
    assert "reused" not in stages["remesh"]


def test_from_refuses_what_would_not_take_effect(tiny, capsys):
    path, out = tiny
    assert run(path, out, "--from", "remesh", "--set", "topopt.gamma=1e-3") == 2
    assert capsys.readouterr().err == (
        "error: --from remesh: topopt.gamma is 0.001 now and was 0.0001 when the files were made, "
        "which changes the stage topopt; run with --from topopt, or with the same --preset and "
        "--set\n"
    )
    assert run(path, out.parent / "nowhere", "--from", "smooth") == 2
    assert "holds no earlier run" in capsys.readouterr().err
    assert run(path, out, "--from", "smooth", "--stop-after", "mesh") == 2
    assert "nothing is to do" in capsys.readouterr().err


def test_another_runs_folder_is_refused_without_force(tiny, tmp_path, capsys):
    path, _ = tiny
    out = tmp_path / "run"
    assert run(path, out, "--stop-after", "mesh") == 0
    assert run(path, out, "--stop-after", "mesh") == 0  # the same case may be repeated
    (out / "note.txt").write_text("mine")
    changed = ("--stop-after", "mesh", "--set", "mesh.tets=300")
    assert run(path, out, *changed) == 2
    assert "holds another run's files" in capsys.readouterr().err
    assert json.loads((out / "manifest.json").read_text())["mesh"]["tets"] > 1000
    assert run(path, out, *changed, "--force") == 0
    assert json.loads((out / "manifest.json").read_text())["mesh"]["tets"] < 1000
    assert (out / "note.txt").read_text() == "mine"


def test_stop_after(tiny, tmp_path):
    assert run(tiny[0], tmp_path / "run", "--stop-after", "mesh") == 0
    names = {p.name for p in (tmp_path / "run").iterdir() if p.is_file()}
    assert names == {"case.yaml", "manifest.json", "mesh.npz", "run.log", "summary.txt"}
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["outcome"] == "stopped after mesh"


def test_a_repeat_gives_the_same_bytes(tiny, tmp_path):
    path, out = tiny
    assert run(path, tmp_path / "again", "--threads", "1") == 0
    for name in ("mesh.npz", "isosurface.ply", "smoothed.ply", "surface.ply", "surface.stl",
                 "quality.json", "case.yaml", "fields/step_0005.vtu"):  # fmt: skip
        assert (tmp_path / "again" / name).read_bytes() == (out / name).read_bytes(), name
    with (
        np.load(out / "phase_field.npz") as one,
        np.load(tmp_path / "again" / "phase_field.npz") as two,
    ):
        assert np.array_equal(one["values"], two["values"])
    assert without_seconds(tmp_path / "again" / "history.csv") == without_seconds(
        out / "history.csv"
    )


def test_damaged_files_are_named(tiny, tmp_path, capsys):
    path, out = tiny
    for name in ("case.yaml", "mesh.npz", "phase_field.npz"):
        (tmp_path / name).write_bytes((out / name).read_bytes())
    (tmp_path / "phase_field.npz").write_bytes((out / "phase_field.npz").read_bytes()[:1000])
    assert run(path, tmp_path, "--from", "isosurface", "--stop-after", "isosurface") == 2
    assert "phase_field.npz: is damaged" in capsys.readouterr().err
    (tmp_path / "mesh.npz").unlink()
    assert run(path, tmp_path, "--from", "isosurface", "--stop-after", "isosurface") == 2
    assert "mesh.npz is missing" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--set", "loads.deck.plane=z=30mm"], "load 'deck' touches no boundary facet"),
        (["--set", "supports.foot.fixed=[x]"], "rigid motion"),
        (["--set", "symmetry=[x=1]"], "symmetry plane x=1"),
        (["--preset", "none"], "no such preset"),
        (["--threads", "0"], "must be at least 1"),
        (["--bogus"], "--bogus"),
        (["--from", "nowhere"], "--from"),
        (["--threads", "many"], "--threads"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(tiny, tmp_path, capsys, arguments, sentence):
    assert run(tiny[0], tmp_path / "run", *arguments) == 2
    text = capsys.readouterr().err
    assert text.startswith("error: ")
    assert len(text.splitlines()) == 1
    assert sentence in text


def test_no_convergence_is_exit_code_1(tiny, tmp_path, capsys, monkeypatch):
    from cases import design_stages
    from meshes.errors import NotConverged

    def fail(*_, **__):
        raise NotConverged("the state problem stalled; use another solver")

    monkeypatch.setattr(design_stages, "optimize", fail)
    assert run(tiny[0], tmp_path / "run") == 1
    assert capsys.readouterr().err == "error: the state problem stalled; use another solver\n"
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["outcome"] == "failed: the state problem stalled; use another solver"
    assert "mesh" in manifest["stages"]


def test_a_full_disk_is_exit_code_1_and_loses_nothing(tiny, tmp_path, capsys, monkeypatch):
    from cases import surface_stages

    def full(*_, **__):
        raise OSError(28, "No space left on device", "isosurface.ply")

    monkeypatch.setattr(surface_stages, "write_surface", full)
    assert run(tiny[0], tmp_path / "run") == 1
    assert capsys.readouterr().err == "error: isosurface.ply: No space left on device\n"
    assert (tmp_path / "run" / "phase_field.npz").is_file()


def test_ctrl_c_keeps_the_last_design(tiny, tmp_path, capsys, monkeypatch):
    from cases.history import HistoryFile

    append = HistoryFile.append

    def interrupt(self, row):
        append(self, row)
        if row.iteration == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(HistoryFile, "append", interrupt)
    assert run(tiny[0], tmp_path / "run") == 130
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["outcome"] == "interrupted"
    assert len(rows_of(tmp_path / "run" / "history.csv")) == 2
    monkeypatch.undo()
    capsys.readouterr()
    assert run(tiny[0], tmp_path / "run", "--from", "isosurface", "--stop-after", "smooth") == 0


def test_the_module_prints_a_summary(tiny, tmp_path):
    command = [sys.executable, "-m", "cases", str(tiny[0]), "--out", str(tmp_path / "run")]
    done = subprocess.run(
        [*command, "--stop-after", "mesh"], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("tiny\n")
    assert "tetrahedra" in done.stdout
    assert "mesh ..." in done.stderr
    help_text = subprocess.run([*command[:3], "--help"], capture_output=True, text=True, check=True)
    for option in ("--preset", "--set", "--out", "--stop-after", "--from", "--threads"):
        assert option in help_text.stdout


def test_pictures_or_one_sentence(tiny):
    problem = make_pictures(tiny[1])
    names = {p.name for p in (tiny[1] / "pictures").iterdir()}
    assert "convergence.png" in names
    if problem is None:
        assert names == {"convergence.png", "domain.png", "isosurface.png", "smoothed.png",
                         "surface.png", "close_up.png"}  # fmt: skip
    else:
        assert "no OpenGL" in problem
