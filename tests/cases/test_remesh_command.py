"""`python -m remesh`: files in, files out, one sentence for what is wrong."""

import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cases import remesh_files
from cases.remesh_choices import default_sigma
from cases.remesh_command import main
from meshes import Patch, TriMesh
from meshes.io import read_surface, read_surface_data, write_surface
from meshes.normal_noise import normal_noise
from meshes.quality import signed_volume, vertex_normals
from meshes.self_intersection import self_intersecting_faces
from meshes.topology import boundary_edges, topology
from tests.shapes import cube, figure_eight, icosphere, torus


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    path = tmp_path_factory.mktemp("remesh") / "torus.ply"
    write_surface(path, torus())
    return path


def refusal(capsys, *arguments):
    assert main([str(argument) for argument in arguments]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line != "remesh ..."]
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    return lines[0]


def test_table_and_result(source, tmp_path, capsys):
    out = tmp_path / "out.stl"
    assert main([str(source), str(out), "--vertices", "300", "--sigma", "0"]) == 0
    text = capsys.readouterr().out
    for row in ("vertices", "genus", "smallest angle, mean", "volume", "distance, rms", "time"):
        assert row in text
    mesh = read_surface(out)
    found = topology(mesh.faces, len(mesh.points))
    assert found.watertight
    assert found.genus == 1
    assert found.vertices == pytest.approx(300, rel=0.02)
    assert signed_volume(mesh) == pytest.approx(signed_volume(torus()), rel=1e-3)


def test_the_inputs_count_is_the_default_and_quiet_is_quiet(source, tmp_path, capsys):
    out = tmp_path / "out.ply"
    assert main([str(source), str(out), "--quiet", "--iterations", "2"]) == 0
    assert capsys.readouterr() == ("", "")
    assert len(read_surface(out).points) == pytest.approx(960, rel=0.02)


def test_sigma_with_a_unit_is_absolute(source, tmp_path):
    """The torus is 2.6 x 2.6 x 0.6: a sigma of a tenth of its diagonal, in whatever unit."""
    diagonal = torus().diagonal
    results = []
    for sigma, unit in (
        ("0.1", "mm"),
        (f"{0.1 * diagonal!r}mm", "mm"),
        (f"{100 * diagonal!r}mm", "m"),
    ):
        out = tmp_path / f"{len(results)}.ply"
        arguments = ["--vertices", "300", "--iterations", "2", "--sigma", sigma, "--unit", unit]
        assert main([str(source), str(out), "--quiet", *arguments]) == 0
        results.append(read_surface(out))
    for result in results[1:]:
        assert np.allclose(result.points, results[0].points, atol=1e-9)


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".off"])
def test_formats_and_lengths_in_file_units(tmp_path, suffix):
    sphere = icosphere(2, radius=1000.0)
    write_surface(tmp_path / f"in{suffix}", sphere)
    out = tmp_path / f"out{suffix}"
    arguments = ["--edge-length", "400", "--sigma", "0", "--iterations", "3", "--quiet"]
    assert main([str(tmp_path / f"in{suffix}"), str(out), *arguments]) == 0
    mesh = read_surface(out)
    assert np.linalg.norm(mesh.points, axis=1) == pytest.approx(1000.0, rel=0.05)
    a, b = (mesh.points[mesh.faces[:, k]] for k in (0, 1))
    assert np.linalg.norm(a - b, axis=1).mean() == pytest.approx(400, rel=0.15)


def test_smooth_and_thesis_algorithm(source, tmp_path):
    rng = np.random.default_rng(0)
    noisy = torus()
    noisy = noisy.with_points(noisy.points + 0.01 * rng.standard_normal(noisy.points.shape))
    write_surface(tmp_path / "noisy.ply", noisy)
    arguments = ["--vertices", "300", "--sigma", "0", "--quiet"]
    assert main([str(tmp_path / "noisy.ply"), str(tmp_path / "a.ply"), "--smooth", *arguments]) == 0
    assert topology(read_surface(tmp_path / "a.ply").faces, 300).genus == 1
    arguments = ["--edge-length", "0.3", "--algorithm", "thesis", "--iterations", "2", "--quiet"]
    assert main([str(source), str(tmp_path / "b.ply"), *arguments]) == 0
    mesh = read_surface(tmp_path / "b.ply")
    assert topology(mesh.faces, len(mesh.points)).genus == 1


def _folder(path):
    path.mkdir()
    return path


def test_wrong_arguments(source, tmp_path, capsys):
    out = tmp_path / "out.ply"
    both = ("--vertices", "300", "--edge-length", "1")
    assert "only one of the two" in refusal(capsys, source, out, *both)
    assert "at least 4" in refusal(capsys, source, out, "--vertices", "3")
    assert "must be positive" in refusal(capsys, source, out, "--edge-length", "0")
    assert "must be positive" in refusal(capsys, source, out, "--edge-length", "nan")
    assert "--sigma" in refusal(capsys, source, out, "--sigma", "-1")
    assert "--sigma" in refusal(capsys, source, out, "--sigma", "14 furlongs")
    assert "--iterations" in refusal(capsys, source, out, "--iterations", "0")
    assert "suffix '.vtk'" in refusal(capsys, source, tmp_path / "out.vtk")
    assert "does not exist" in refusal(capsys, source, tmp_path / "no" / "out.ply")
    assert "none.ply" in refusal(capsys, tmp_path / "none.ply", out)
    assert "OUT" in refusal(capsys, source)
    assert "is a folder" in refusal(capsys, source, tmp_path / "..")
    assert "Is a directory" in refusal(capsys, _folder(tmp_path / "in.ply"), out)
    assert "end in .png" in refusal(capsys, source, out, "--picture", tmp_path / "a.jpg")
    assert "different files" in refusal(capsys, source, out, "--json", out)
    assert "--fill-holes" in refusal(capsys, source, out, "--fill-holes", "-1")
    assert "--smooth" in refusal(capsys, source, out, "--smooth", "--reference", "rbf")
    assert "no-such" in refusal(capsys, source, out, "--no-such", "1")
    assert not out.exists()


def test_wrong_surfaces(source, tmp_path, capsys):
    data = source.read_bytes()
    out = tmp_path / "out.ply"
    (tmp_path / "cut.ply").write_bytes(data[: len(data) // 2])
    assert "cut.ply" in refusal(capsys, tmp_path / "cut.ply", out)
    (tmp_path / "empty.stl").write_bytes(b"")
    assert "is empty" in refusal(capsys, tmp_path / "empty.stl", out)
    mesh = torus()
    write_surface(tmp_path / "fan.ply", TriMesh(mesh.points, np.vstack([mesh.faces, [0, 1, 500]])))
    assert "more than two faces" in refusal(capsys, tmp_path / "fan.ply", out, "--no-repair")
    points = mesh.points.copy()
    points[7, 1] = np.nan
    write_surface(tmp_path / "nan.ply", mesh.with_points(points))
    assert "NaN" in refusal(capsys, tmp_path / "nan.ply", out)
    assert not out.exists()


def test_a_surface_that_crosses_itself_is_refused_unless_it_is_wanted(tmp_path, capsys):
    source, out = tmp_path / "eight.ply", tmp_path / "out.ply"
    tube = figure_eight()
    write_surface(source, tube)
    crossing = int(self_intersecting_faces(tube.points, tube.faces).sum())
    for options in ((), ("--no-repair",)):
        sentence = refusal(capsys, source, out, *options)
        assert f"eight.ply: {crossing} faces cross others" in sentence
        assert "--keep-crossings" in sentence
    assert not out.exists()
    found = run(capsys, source, out, "--keep-crossings")
    assert found["before"]["self_intersecting_faces"] == crossing
    assert any("cross others" in note for note in found["notes"]) and out.exists()


def test_a_result_that_is_not_valid_is_written_with_exit_code_1(
    source, tmp_path, capsys, monkeypatch
):
    def crossing(points, faces):
        return np.arange(len(faces)) < 2

    monkeypatch.setattr("meshes.quality.self_intersecting_faces", crossing)
    out = tmp_path / "out.ply"
    assert main([str(source), str(out), "--vertices", "300"]) == 1
    assert "out.ply is written, but 2 triangles cross others" in capsys.readouterr().err
    assert read_surface(out).faces.shape[1] == 3


def test_a_failed_write_keeps_the_old_file_and_is_exit_code_1(
    source, tmp_path, capsys, monkeypatch
):
    import os

    out = tmp_path / "out.ply"
    out.write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert main([str(source), str(out), "--vertices", "100", "--iterations", "1"]) == 1
    assert "No space left on device" in capsys.readouterr().err
    assert out.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out.ply"]


def run(capsys, *arguments):
    """The figures of a run with --json -."""
    assert main([*map(str, arguments), "--json", "-"]) == 0
    return json.loads(capsys.readouterr().out)


def test_json_holds_what_the_table_says(source, tmp_path, capsys):
    out = tmp_path / "out.ply"
    arguments = [source, out, "--vertices", 300, "--iterations", 2]
    found = run(capsys, *arguments)
    mesh = read_surface(out)
    assert found["after"]["vertices"] == len(mesh.points)
    assert found["after"]["volume"] == pytest.approx(signed_volume(mesh))
    assert found["before"]["vertices"] == 960 and found["after"]["boundary_loops"] == 0
    assert 0 < found["after"]["distance_rms"] < found["after"]["distance_max"] < 0.02
    assert sum(found["repair"].values()) == 0 and found["notes"] == []
    assert found["seconds"]["total"] >= found["seconds"]["remesh"] > 0
    place = tmp_path / "figures.json"
    assert main([*map(str, arguments), "--json", str(place), "--quiet"]) == 0
    again = json.loads(place.read_text())
    assert again["after"] == found["after"] and again["options"] == found["options"]
    assert capsys.readouterr().out == ""


def test_reference_and_sigma_are_chosen_and_told(source, tmp_path, capsys):
    out = tmp_path / "out.ply"
    quick = ["--iterations", 1]
    coarser = run(capsys, source, out, "--vertices", 300, *quick)["options"]
    finer = run(capsys, source, out, "--vertices", 3000, *quick)["options"]
    asked = run(capsys, source, out, "--vertices", 300, "--reference", "rbf", *quick)["options"]
    assert (coarser["reference"], finer["reference"]) == ("triangles", "rbf")
    assert asked["reference"] == "rbf" and asked["sigma_diagonals"] == pytest.approx(0.05)
    rough = torus(n_major=96, n_minor=40)
    rng = np.random.default_rng(0)
    rough = rough.with_points(rough.points + 0.015 * rng.standard_normal(rough.points.shape))
    write_surface(tmp_path / "rough.ply", rough)
    found = run(capsys, tmp_path / "rough.ply", out, "--vertices", 1500, *quick)
    assert 0.005 < found["options"]["sigma_diagonals"] < 0.04
    assert any("--smooth" in note for note in found["notes"])


def test_noise_of_the_normals_is_measured():
    """Against the normals of the same sphere without noise."""
    sphere = icosphere(4)
    assert normal_noise(sphere) < 0.003
    rng = np.random.default_rng(0)
    for height in (1e-3, 4e-3):
        rough = sphere.with_points(sphere.points + height * rng.standard_normal((2562, 3)))
        change = vertex_normals(rough.points, rough.faces) - sphere.points
        true = np.sqrt((change**2).sum(axis=1).mean() / 2)
        assert normal_noise(rough) == pytest.approx(true, rel=0.3)
        scaled = rough.with_points(1e9 * rough.points)
        assert normal_noise(scaled) == pytest.approx(normal_noise(rough), rel=1e-6)
    assert default_sigma(sphere, 0.1, 0.0) == 0.05 * sphere.diagonal
    assert default_sigma(sphere, 0.1, 0.25) == pytest.approx(0.2 * 0.1 / 0.25)


def halves():
    """A sphere with one label above and one below, as another program would number them."""
    sphere = icosphere(3)
    above = sphere.points[sphere.faces].mean(axis=1)[:, 2] > 0
    labels = tuple(Patch(str(k)) for k in range(8))
    return TriMesh(sphere.points, sphere.faces, np.where(above, 7, 2), labels)


@pytest.mark.parametrize("suffix", ["ply", "vtp"])
def test_labels_and_values_are_carried_over(tmp_path, capsys, suffix):
    mesh = halves()
    linear = mesh.points @ [1.0, 2.0, -1.0]
    data = {"t": linear, "Normals": mesh.points, "v": np.outer(linear, [1.0, 0.0, 2.0])}
    write_surface(tmp_path / f"in.{suffix}", mesh, point_data=data)
    out = tmp_path / f"out.{suffix}"
    run(capsys, tmp_path / f"in.{suffix}", out, "--vertices", 400, "--iterations", 3)
    result, found = read_surface_data(out)
    middle = result.points[result.faces].mean(axis=1)[:, 2]
    assert set(result.face_labels[middle > 0.1]) == {7}
    assert set(result.face_labels[middle < -0.1]) == {2}
    assert found["t"] == pytest.approx(result.points @ [1.0, 2.0, -1.0], abs=0.03)
    assert found["v"] == pytest.approx(np.outer(found["t"], [1.0, 0.0, 2.0]), abs=1e-9)
    assert np.linalg.norm(found["Normals"], axis=1) == pytest.approx(1.0, abs=1e-6)


def test_a_linear_field_on_plane_faces_stays_exact(tmp_path, capsys):
    box = cube()
    write_surface(tmp_path / "in.ply", box, point_data={"t": box.points @ [1.0, 2.0, 3.0]})
    out = tmp_path / "out.ply"
    run(capsys, tmp_path / "in.ply", out, "--vertices", 200, "--iterations", 3)
    mesh, data = read_surface_data(out)
    assert len(mesh.points) > 150
    assert data["t"] == pytest.approx(mesh.points @ [1.0, 2.0, 3.0], abs=1e-9)
    found = run(capsys, tmp_path / "in.ply", tmp_path / "out.stl", "--iterations", 1)
    assert any("STL holds no values at vertices: t left out" in note for note in found["notes"])


def test_damage_is_repaired_and_told(tmp_path, capsys):
    mesh, out = torus(), tmp_path / "out.ply"
    loose = TriMesh(mesh.points[mesh.faces].reshape(-1, 3), np.arange(5760).reshape(-1, 3)[:, ::-1])
    write_surface(tmp_path / "in.ply", loose)
    assert main([str(tmp_path / "in.ply"), str(out), "--vertices", "300"]) == 0
    text = capsys.readouterr().err
    assert "coincident vertices of open edges welded: 4,800" in text
    assert "closed pieces turned, for they were inside out: 1" in text
    mesh = read_surface(out)
    assert abs(len(mesh.points) - 300) <= 6
    found = topology(mesh.faces, len(mesh.points))
    assert found.watertight and found.genus == 1


def test_holes_are_kept_or_filled_and_boundaries_fixed(tmp_path, capsys):
    mesh, out = torus(), tmp_path / "out.ply"
    gone = np.isin(mesh.faces, [0, 1, 20]).any(axis=1)
    open_torus = TriMesh(mesh.points, mesh.faces[~gone])
    write_surface(tmp_path / "in.ply", open_torus)
    arguments = [tmp_path / "in.ply", out, "--vertices", 300, "--iterations", 3]
    found = run(capsys, *arguments, "--fix-boundary")
    result = read_surface(out)
    rims = [{tuple(p) for p in m.points[np.unique(boundary_edges(m.faces))].tolist()}
            for m in (open_torus, result)]  # fmt: skip
    assert found["after"]["boundary_loops"] == 1 and rims[0] == rims[1]
    found = run(capsys, *arguments, "--fill-holes", 0.3)
    assert found["after"]["watertight"] and found["repair"]["filled_holes"] == 1


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_scales(tmp_path, capsys, scale):
    mesh = torus()
    write_surface(tmp_path / "in.ply", mesh.with_points(scale * mesh.points))
    found = run(capsys, tmp_path / "in.ply", tmp_path / "out.ply", "--vertices", 300)["after"]
    assert found["genus"] == 1 and found["self_intersecting_faces"] == 0
    assert found["volume"] / scale**3 == pytest.approx(signed_volume(mesh), rel=1e-3)


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".obj", ".off", ".vtp"])
def test_any_damaged_file_is_remeshed_or_refused(tmp_path, capsys, suffix):
    """Cut anywhere or with any byte changed: exit code 0, or 2 and one sentence."""
    path, out = tmp_path / f"in{suffix}", tmp_path / "out.ply"
    write_surface(path, cube())
    data = path.read_bytes()

    @settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=[
        HealthCheck.function_scoped_fixture])  # fmt: skip
    @given(st.integers(0, len(data) - 1), st.integers(0, 255), st.booleans())
    def try_it(place, byte, cut):
        path.write_bytes(data[:place] + (b"" if cut else bytes([byte]) + data[place + 1 :]))
        code = main([str(path), str(out), "--quiet", "--iterations", "1"])
        lines = capsys.readouterr().err.splitlines()
        assert code == 0 or (code == 2 and len(lines) == 1 and lines[0].startswith("error: "))

    try_it()


@pytest.mark.parametrize("faces, vertices", [([[0, 1, 2]], 30), ([[0, 1, 2], [2, 1, 3]], 4)])
def test_the_smallest_surfaces(tmp_path, capsys, faces, vertices):
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.3]]
    write_surface(tmp_path / "in.ply", TriMesh(points, faces))
    out = tmp_path / "out.ply"
    found = run(capsys, tmp_path / "in.ply", out, "--vertices", vertices)["after"]
    assert found["vertices"] == pytest.approx(vertices, abs=1) and found["boundary_loops"] == 1


def test_an_interrupt_leaves_nothing_behind(source, tmp_path, capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(remesh_files, "remesh", interrupted)
    assert main([str(source), str(tmp_path / "out.ply"), "--quiet"]) == 130
    assert capsys.readouterr().err.splitlines() == ["error: interrupted; finished files are kept"]
    assert list(tmp_path.iterdir()) == []


LIMITED = """
import resource, sys
from cases.remesh_command import main
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
sys.exit(main(sys.argv[1:]))
"""


def test_a_full_disk(source, tmp_path):
    command = [sys.executable, "-c", LIMITED, str(source), str(tmp_path / "out.ply")]
    command += ["--vertices", "300", "--iterations", "1", "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and list(tmp_path.iterdir()) == []
    assert done.stderr.splitlines() == [
        f"error: {tmp_path / 'out.ply'}: cannot be written (File too large)"
    ]


def test_a_picture_or_one_sentence(source, tmp_path, capsys, monkeypatch):
    picture = tmp_path / "both.png"
    arguments = [source, tmp_path / "out.ply", "--vertices", 300, "--iterations", 1]
    found = run(capsys, *arguments, "--picture", picture)
    if found["notes"] == []:
        assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 20_000
    monkeypatch.setattr("cases.remesh_picture.run_apart", lambda *_: "no OpenGL is to be had here")
    picture.unlink(missing_ok=True)
    found = run(capsys, *arguments, "--picture", picture)
    assert found["notes"] == [f"{picture}: no picture was drawn, for no OpenGL is to be had here"]


def test_help_of_the_module():
    done = subprocess.run(
        [sys.executable, "-m", "remesh", "--help"], capture_output=True, text=True, check=True
    )
    options = ("--vertices", "--edge-length", "--sigma", "--iterations", "--smooth", "--reference",
               "--fix-boundary", "--fill-holes", "--no-repair", "--keep-crossings", "--json",
               "--picture", "--min-length", "--max-length", "--gradation")  # fmt: skip
    for option in options:
        assert option in done.stdout


def test_lengths_are_held_or_a_remark_tells(source, tmp_path, capsys):
    out = tmp_path / "out.ply"
    limits = ["--max-length", 0.22, "--gradation", 1.4, "--sigma", 0]
    found = run(capsys, source, out, "--vertices", 1000, *limits)
    mesh = read_surface(out)
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    longest = max(np.linalg.norm(p - q, axis=1).max() for p, q in ((a, b), (b, c), (c, a)))
    assert longest <= 0.22 * (1 + 1e-6)
    assert found["options"]["max_length"] == 0.22 and found["options"]["gradation"] == 1.4
    assert found["notes"] == []
    found = run(capsys, source, out, "--vertices", 300, *limits)
    assert any("the lengths do not allow fewer" in note for note in found["notes"])


def test_an_error_bound_is_met_and_printed(source, tmp_path, capsys):
    """In diagonals, or with a unit; the table and the JSON tell what is proved."""
    out, figures = tmp_path / "out.ply", tmp_path / "out.json"
    for error in ("0.01", f"{0.01 * torus().diagonal!r}mm"):
        assert main([str(source), str(out), "--max-error", error, "--json", str(figures)]) == 0
        text = capsys.readouterr().out
        assert "distance, proved bound" in text and "normals, proved bound" in text
        after = json.loads(figures.read_text())["after"]
        assert after["distance_max"] <= after["distance_proved"] <= 0.01
        assert topology(read_surface(out).faces, after["vertices"]).genus == 1
        assert after["vertices"] < 300


@pytest.mark.parametrize(
    "options",
    [
        ["--max-error", "0"],
        ["--max-error", "-1"],
        ["--max-error", "wide"],
        ["--max-error", "0.01", "--vertices", "100"],
        ["--max-error", "0.01", "--smooth"],
        ["--max-error", "0.01", "--algorithm", "thesis"],
        ["--max-error", "0.01", "--max-normal-angle", "200"],
        ["--max-error", "0.01", "--min-length", "2", "--max-length", "1"],
        ["--max-normal-angle", "20"],
        ["--max-length", "0"],
        ["--min-length", "2", "--max-length", "1"],
        ["--min-length", "-1"],
        ["--gradation", "1"],
        ["--quality", "4d"],
        ["--gradation", "1.3", "--algorithm", "thesis"],
    ],
    ids=" ".join,
)
def test_bounds_that_make_no_sense_are_refused(source, tmp_path, capsys, options):
    assert "--" in refusal(capsys, source, tmp_path / "out.ply", *options)
