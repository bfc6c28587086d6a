"""The way into the commands."""

import os
import subprocess
import sys

import pytest

from cases.entry import start


def test_ctrl_c_during_the_imports_is_one_sentence(tmp_path, monkeypatch, capsys):
    (tmp_path / "slow_import.py").write_text("raise KeyboardInterrupt\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert start("slow_import", "main") == 130
    assert capsys.readouterr().err == "error: interrupted\n"


def test_the_function_gets_its_arguments_and_gives_the_exit_code(tmp_path, monkeypatch):
    (tmp_path / "quick_import.py").write_text("def main(a, b):\n    return a + b\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert start("quick_import", "main", 3, 4) == 7


@pytest.mark.parametrize("module", ["numba", "numpy"])
def test_ctrl_c_while_python_m_remesh_imports_is_one_sentence(tmp_path, module):
    """As soon as any of the large modules is asked for."""
    (tmp_path / f"{module}.py").write_text("raise KeyboardInterrupt\n")
    done = subprocess.run(
        [sys.executable, "-m", "remesh", "in.ply", "out.ply"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "error: interrupted\n")
