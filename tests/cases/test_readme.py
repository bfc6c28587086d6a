"""README.md: its Python example runs, and its commands are the ones there are."""

import re
from pathlib import Path

import pytest

from meshes.io import read_surface
from meshes.topology import topology

README = Path(__file__).resolve().parents[2] / "README.md"


@pytest.fixture
def text():
    if not README.is_file():
        pytest.skip("the README is not installed with the package")
    return README.read_text(encoding="utf-8")


def block(text, marker, language):
    return re.search(rf"<!-- {marker} -->\n```{language}\n(.*?)```", text, re.DOTALL).group(1)


def test_the_library_example_runs(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(block(text, "library example", "python"), "README.md", "exec"), {})
    part = read_surface(tmp_path / "part.stl")
    assert topology(part.faces, len(part.points)).watertight
    assert 350 <= len(part.points) <= 450


def test_the_test_command_is_where_ci_looks_for_it(text):
    command = block(text, "test command", "bash")
    assert command.strip().endswith("-m pytest")
    assert len(command.strip().splitlines()) == 1


def test_links_lead_somewhere(text):
    names = re.findall(r"\]\(([^)#]+)\)", text)
    missing = [name for name in names if not (README.parent / name).exists()]
    assert not missing
