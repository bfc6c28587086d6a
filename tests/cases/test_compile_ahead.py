"""Compiling ahead: only where it helps, and its stages really run."""

import subprocess
import sys

import pytest

from cases import compile_ahead
from cases.compile_ahead import COMPILED_WITH, CompileAhead


@pytest.fixture
def started(monkeypatch):
    """The stages for which a child would have been started, with no kernels in the cache."""
    calls = []
    monkeypatch.setattr(compile_ahead, "_spawn", calls.append)
    monkeypatch.setattr(compile_ahead, "compiled", lambda: False)
    return calls


@pytest.mark.parametrize(
    "kind, last, threads, stages",
    [
        ("pytetwild", "remesh", 2, ["smooth", "remesh"]),
        ("pytetwild", "smooth", 2, ["smooth"]),
        ("pytetwild", "isosurface", 2, []),
        ("pytetwild", "remesh", 1, []),
        ("bcc", "remesh", 2, []),
    ],
)
def test_children_start_only_where_they_help(started, kind, last, threads, stages):
    ahead = CompileAhead(kind, last, threads)
    assert started == stages
    assert not ahead.running("remesh")
    ahead.wait("remesh")
    ahead.close()


def test_nothing_is_compiled_twice(started, monkeypatch):
    monkeypatch.setattr(compile_ahead, "compiled", lambda: True)
    CompileAhead("pytetwild", "remesh", 2)
    assert started == []


def test_a_stage_waits_for_its_own_child(started, monkeypatch):
    def spawn(stage):
        seconds = "0" if stage == "smooth" else "60"
        return subprocess.Popen([sys.executable, "-c", f"import time; time.sleep({seconds})"])

    monkeypatch.setattr(compile_ahead, "_spawn", spawn)
    ahead = CompileAhead("pytetwild", "remesh", 2)
    ahead.wait("smooth")
    assert not ahead.running("smooth")
    assert ahead.running("remesh")
    ahead.close()
    assert not ahead.running("remesh")


def test_an_empty_cache_is_seen(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not compile_ahead.compiled()
    (tmp_path / "remesh").mkdir()
    (tmp_path / "remesh" / "kernel.nbi").write_bytes(b"")
    assert compile_ahead.compiled()


@pytest.mark.parametrize("stage, made", [("smooth", "smoothed.ply"), ("remesh", "surface.stl")])
def test_the_stages_run_on_the_ball(tmp_path, stage, made):
    COMPILED_WITH[stage](compile_ahead.ball(tmp_path))
    assert (tmp_path / made).stat().st_size > 1_000
