"""--resume: a run that was killed or interrupted ends as if nothing had happened."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from cases.cli import main
from tests.cases.cases_in_text import TINY, write_case

CASE = TINY.replace("steps: 5", "steps: 12\n  tolerance: 0\n  stagnation: 0")
CASE += "output: {pictures: false, snapshots: 3}\n"
FILES = ("isosurface.ply", "smoothed.ply", "surface.stl", "quality.json", "case.yaml",
         "fields/step_0002.vtu", "fields/step_0012.vtu", "fields/design.pvd")  # fmt: skip


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    folder = tmp_path_factory.mktemp("unbroken")
    path = write_case(folder, CASE)
    assert run(path, folder / "run") == 0
    return path, folder / "run"


def run(path, out, *arguments):
    return main([str(path), "--out", str(out), "--quiet", *arguments])


def rows_of(folder):
    with open(folder / "history.csv", encoding="ascii", newline="") as file:
        return [{**row, "seconds": None} for row in csv.DictReader(file)]


def assert_same(one, two):
    for name in FILES:
        assert (one / name).read_bytes() == (two / name).read_bytes(), name
    assert rows_of(one) == rows_of(two)
    with np.load(one / "phase_field.npz") as a, np.load(two / "phase_field.npz") as b:
        assert np.array_equal(a["values"], b["values"])


def test_a_killed_run_goes_on(unbroken, tmp_path):
    path, whole = unbroken
    out = tmp_path / "run"
    child = subprocess.Popen(
        [sys.executable, "-m", "cases", str(path), "--out", str(out), "--quiet"],
        env={**os.environ, "NUMBA_NUM_THREADS": "1"},
        cwd=Path(__file__).parents[2],
    )
    while child.poll() is None and not (out / "checkpoint-1.npz").exists():
        time.sleep(0.01)
    child.send_signal(signal.SIGKILL)
    assert child.wait() == -signal.SIGKILL
    assert not (out / "phase_field.npz").exists()
    assert run(path, out, "--resume") == 0
    assert_same(out, whole)
    stages = json.loads((out / "manifest.json").read_text())["stages"]
    assert stages["mesh"]["reused"]
    assert (out / "run.log").read_text().count("step 0:") == 1


def test_a_run_stopped_after_a_stage_goes_on_with_the_next(unbroken, tmp_path):
    path, whole = unbroken
    out = tmp_path / "run"
    assert run(path, out, "--stop-after", "isosurface") == 0
    before = (out / "phase_field.npz").stat().st_mtime_ns
    assert run(path, out, "--resume") == 0
    assert (out / "phase_field.npz").stat().st_mtime_ns == before
    assert_same(out, whole)


def test_a_finished_optimisation_takes_more_steps(unbroken, tmp_path, capsys):
    path, whole = unbroken
    out = tmp_path / "run"
    assert run(path, out, "--stop-after", "topopt", "--set", "topopt.steps=5") == 0
    assert [row["iteration"] for row in rows_of(out)] == list("12345")
    assert run(path, out, "--resume") == 0
    with np.load(out / "phase_field.npz") as a, np.load(whole / "phase_field.npz") as b:
        assert np.array_equal(a["values"], b["values"])
    assert rows_of(out) == rows_of(whole)
    assert main([str(path), "--out", str(out), "--resume"]) == 0
    told = capsys.readouterr()
    assert "is finished" in told.err
    assert told.out.startswith("tiny\n")


def test_a_run_that_was_interrupted_at_its_summary_prints_it(unbroken, tmp_path, monkeypatch):
    path, whole = unbroken
    out = tmp_path / "run"

    def interrupt(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("cases.pipeline.report.summary", interrupt)
        patch.setattr("cases.pipeline.report.quality", interrupt)
        assert run(path, out) == 130
    assert not (out / "summary.txt").exists()
    assert run(path, out, "--resume") == 0
    assert_same(out, whole)
    assert (out / "summary.txt").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--resume", "--set", "topopt.gamma=1e-3"], "topopt.gamma is 0.001 now and was 0.0001"),
        (["--resume", "--set", "remesh.sigma=0"], "remesh.sigma is"),
        (["--resume", "--force"], "leave out --from and --force"),
        (["--resume", "--from", "smooth"], "leave out --from and --force"),
    ],
)
def test_what_cannot_be_resumed_is_refused(unbroken, capsys, arguments, sentence):
    path, out = unbroken
    before = (out / "surface.stl").read_bytes()
    assert run(path, out, *arguments) == 2
    assert sentence in capsys.readouterr().err
    assert (out / "surface.stl").read_bytes() == before


def test_nothing_to_resume_is_said(unbroken, tmp_path, capsys):
    assert run(unbroken[0], tmp_path / "nowhere", "--resume") == 2
    assert "holds no earlier run" in capsys.readouterr().err
