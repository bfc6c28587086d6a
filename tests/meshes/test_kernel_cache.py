"""Kernels in numba's cache that rest on changed modules are compiled anew."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from meshes.kernel_cache import drop_stale_kernels

MADE = """\
from numba import njit

from tiny.inner import doubled
from tiny.sizes import SIZE

@njit(cache=True)
def outer(x):
    return doubled(x) + SIZE
"""
INNER = """\
from numba import njit

@njit(cache=True)
def doubled(x):
    return 2 * x
"""
FILES = {"outer": MADE, "inner": INNER, "sizes": "SIZE = 1\n", "other": "", "__init__": ""}
CALL = "from tiny.outer import outer; print(outer(3))"


def touch(path, seconds):
    """Give a file a time so many seconds after now."""
    time = path.stat().st_mtime_ns + int(seconds * 1e9)
    os.utime(path, ns=(time, time))


@pytest.fixture
def package(tmp_path):
    folder = tmp_path / "tiny"
    folder.mkdir()
    for name, text in FILES.items():
        (folder / f"{name}.py").write_text(text)
        touch(folder / f"{name}.py", -100)
    return folder


def called(folder):
    """What the outer kernel gives for 3 in a new process."""
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    command = [sys.executable, "-B", "-c", CALL]
    done = subprocess.run(
        command, cwd=folder.parent, env=environment, capture_output=True, text=True, check=True
    )
    return int(done.stdout)


def test_numba_forgets_what_lies_elsewhere_and_we_do_not(package):
    assert called(package) == 7
    (package / "sizes.py").write_text("SIZE = 5\n")
    assert called(package) == 7  # the day this gives 11 the module can go
    removed = drop_stale_kernels(package.parent, ["tiny"])
    assert [path.name.partition("-")[0] for path in removed] == ["outer.outer"]
    assert called(package) == 11


@pytest.mark.parametrize(
    ("changed", "stale"),
    [
        ("sizes", {"outer"}),
        ("inner", {"outer", "inner"}),
        ("outer", {"outer"}),
        ("other", set()),
        (None, set()),
    ],
)
def test_only_what_rests_on_a_change_is_removed(package, changed, stale):
    cache = package / "__pycache__"
    cache.mkdir()
    for name in ("outer", "inner"):
        (cache / f"{name}.kernel-4.py311.nbi").write_bytes(b"")
    if changed:
        touch(package / f"{changed}.py", 200)
    removed = drop_stale_kernels(package.parent, ["tiny"])
    assert {path.name.partition(".")[0] for path in removed} == stale
    assert {path.name.partition(".")[0] for path in Path(cache).iterdir()} == {
        "outer",
        "inner",
    } - stale


def test_without_a_cache_nothing_happens(package):
    assert drop_stale_kernels(package.parent, ["tiny", "absent"]) == []
