"""Checkpoints: the same steps after a stop, whole at any moment, refused where they do not fit."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from meshes.errors import InvalidCase
from tests.topopt.small_problems import cantilever
from topopt.checkpoint import Checkpoints
from topopt.optimize import OptimizationSettings, optimize

IDENTITY = {"mesh": "a", "case": "b"}
SETTINGS = OptimizationSettings(steps=10, tolerance=0.0, stagnation=0.0, solver="direct")


@pytest.fixture(scope="module")
def unbroken():
    return optimize(*cantilever(), SETTINGS)


@pytest.fixture(scope="module")
def half(tmp_path_factory):
    """A folder with the checkpoints of a run of five steps."""
    folder = tmp_path_factory.mktemp("checkpoints")
    keep = Checkpoints(folder, IDENTITY)
    optimize(*cantilever(), replace(SETTINGS, steps=5), callback=lambda _, loop: keep.write(loop))
    return folder


def rows(history):
    """All but the seconds."""
    return [astuple(row)[:-1] for row in history]


@pytest.mark.parametrize("solver", ["direct", "multigrid"])
def test_five_and_five_steps_are_ten_bit_for_bit(tmp_path, solver):
    settings = replace(SETTINGS, solver=solver)
    keep = Checkpoints(tmp_path, IDENTITY)
    whole = optimize(*cantilever(), settings)
    optimize(*cantilever(), replace(settings, steps=5), callback=lambda _, loop: keep.write(loop))
    start = Checkpoints(tmp_path, IDENTITY).read()
    assert start.history[-1].iteration == 5
    resumed = optimize(*cantilever(), settings, start)
    assert np.array_equal(resumed.phase_field.values, whole.phase_field.values)
    assert np.array_equal(resumed.state.displacement, whole.state.displacement)
    assert rows(resumed.history) == rows(whole.history)
    assert resumed.history[-1].seconds > start.history[-1].seconds


def test_two_files_take_turns_and_the_latest_is_read(half):
    assert sorted(p.name for p in half.iterdir()) == ["checkpoint-0.npz", "checkpoint-1.npz"]
    assert Checkpoints(half, IDENTITY).read().history[-1].iteration == 5


@pytest.mark.parametrize("kept", [0, 1000, -1])
def test_a_half_written_file_costs_one_step(half, tmp_path, kept, unbroken, caplog):
    for path in half.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    last = tmp_path / "checkpoint-1.npz"
    last.write_bytes(last.read_bytes()[:kept])
    start = Checkpoints(tmp_path, IDENTITY).read()
    assert start.history[-1].iteration == 4
    assert "checkpoint-1.npz: is damaged" in caplog.text
    resumed = optimize(*cantilever(), SETTINGS, start)
    assert np.array_equal(resumed.phase_field.values, unbroken.phase_field.values)


def test_a_flipped_bit_is_seen(half, tmp_path):
    for path in half.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    last = tmp_path / "checkpoint-1.npz"
    data = bytearray(last.read_bytes())
    data[len(data) // 2] ^= 1
    last.write_bytes(data)
    assert Checkpoints(tmp_path, IDENTITY).read().history[-1].iteration == 4


@pytest.mark.parametrize("name", ["mesh", "case"])
def test_what_belongs_to_another_run_is_refused(half, name):
    with pytest.raises(InvalidCase, match=f"made with another {name} .*without --resume"):
        Checkpoints(half, {**IDENTITY, name: "other"}).read()


def test_another_version_is_refused(half, monkeypatch):
    monkeypatch.setattr("topopt.checkpoint.package_version", lambda: "99")
    with pytest.raises(InvalidCase, match="another version"):
        Checkpoints(half, IDENTITY).read()


def test_an_empty_folder_has_none(tmp_path):
    assert Checkpoints(tmp_path, IDENTITY).read() is None
