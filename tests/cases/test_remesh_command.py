"""`python -m remesh`: files in, files out, one sentence for what is wrong."""

import subprocess
import sys

import numpy as np
import pytest

from cases.remesh_command import main
from meshes import TriMesh
from meshes.io import read_surface, write_surface
from meshes.quality import signed_volume
from meshes.topology import topology
from tests.shapes import icosphere, torus


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    path = tmp_path_factory.mktemp("remesh") / "torus.ply"
    write_surface(path, torus())
    return path


def refusal(capsys, *arguments):
    assert main([str(argument) for argument in arguments]) == 2
    text = capsys.readouterr().err
    assert text.startswith("error: ")
    assert len(text.splitlines()) == 1
    return text


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
    assert "more than two faces" in refusal(capsys, tmp_path / "fan.ply", out)
    points = mesh.points.copy()
    points[7, 1] = np.nan
    write_surface(tmp_path / "nan.ply", mesh.with_points(points))
    assert "NaN" in refusal(capsys, tmp_path / "nan.ply", out)
    assert not out.exists()


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


def test_help_of_the_module():
    done = subprocess.run(
        [sys.executable, "-m", "remesh", "--help"], capture_output=True, text=True, check=True
    )
    for option in ("--vertices", "--edge-length", "--sigma", "--iterations", "--smooth"):
        assert option in done.stdout
