"""Compiling ahead: only where it helps, and its tiny case really runs."""

import numpy as np
import pytest

from cases import compile_ahead
from cases.compile_ahead import CompileAhead


@pytest.fixture
def started(monkeypatch):
    """What would have been started, with no kernels in the cache."""
    calls = []
    monkeypatch.setattr(compile_ahead, "_spawn", lambda: calls.append(1))
    monkeypatch.setattr(compile_ahead, "compiled", lambda: False)
    return calls


@pytest.mark.parametrize(
    "kind, last, threads, count",
    [
        ("pytetwild", "remesh", 2, 1),
        ("pytetwild", "isosurface", 2, 1),
        ("pytetwild", "topopt", 2, 0),
        ("pytetwild", "remesh", 1, 0),
        ("bcc", "remesh", 2, 0),
    ],
)
def test_the_child_starts_only_where_it_helps(started, kind, last, threads, count):
    ahead = CompileAhead(kind, last, threads)
    assert len(started) == count
    assert not ahead.running
    ahead.wait()
    ahead.close()


def test_nothing_is_compiled_twice(started, monkeypatch):
    monkeypatch.setattr(compile_ahead, "compiled", lambda: True)
    CompileAhead("pytetwild", "remesh", 2)
    assert started == []


def test_an_empty_cache_is_seen(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not compile_ahead.compiled()
    (tmp_path / "remesh").mkdir()
    (tmp_path / "remesh" / "kernel.nbi").write_bytes(b"")
    assert compile_ahead.compiled()


def test_the_tiny_case_runs_through_the_last_stage(monkeypatch, tmp_path):
    monkeypatch.setattr(compile_ahead.tempfile, "tempdir", str(tmp_path))
    seen = []
    original = compile_ahead.tempfile.TemporaryDirectory.cleanup

    def look(folder):
        seen.extend(p.name for p in tmp_path.rglob("surface.stl"))
        original(folder)

    monkeypatch.setattr(compile_ahead.tempfile.TemporaryDirectory, "cleanup", look)
    compile_ahead.main()
    assert np.unique(seen).tolist() == ["surface.stl"]
    assert list(tmp_path.glob("phasemesh-*")) == []
