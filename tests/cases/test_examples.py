"""The example cases, tiny, through the whole line; what their files promise holds."""

import json
import shutil
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest

from cases.cli import main
from cases.load import load_case
from meshes import PhaseField
from meshes.io import load_tet_mesh, read_surface, write_surface
from meshes.topology import topology
from topopt.geometry import tet_geometry

EXAMPLES = Path(__file__).parents[2] / "examples"
BOXES = ["console", "footbridge", "press", "table_with_deck"]
TINY = ["topopt.steps=2", "isosurface.islands=keep", "output={pictures: false, snapshots: 0}",
        "remesh.iterations=1"]  # fmt: skip


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Folder of a finished tiny run of each example, made when it is first asked for."""
    base, done = tmp_path_factory.mktemp("examples"), {}

    def run(name, *settings):
        if name not in done:
            done[name] = base / name
            mesh = ["mesh.kind=bcc", "mesh.tets=900"] if name in BOXES else []
            folder = base if name == "bracket" else EXAMPLES
            arguments = [str(folder / f"{name}.yaml"), "--out", str(base / name), "--quiet"]
            assert main([*arguments, "--set", *TINY, *mesh, *settings]) == 0
        return done[name]

    run.base = base
    return run


def figures(folder):
    return json.loads((folder / "manifest.json").read_text())["stages"]["topopt"]


def design(folder):
    mesh = load_tet_mesh(folder / "mesh.npz")
    return PhaseField(mesh, np.load(folder / "phase_field.npz")["values"])


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_example_loads_with_its_preset(path):
    case = load_case(path, "preview").case
    assert case.name == path.stem
    assert 5000 <= case.mesh.tets <= 10000


@pytest.mark.parametrize("name", BOXES)
def test_an_example_ends_with_a_closed_surface(runs, name):
    surface = read_surface(runs(name) / "surface.ply")
    assert topology(surface.faces, len(surface.points)).watertight
    assert (runs(name) / "summary.txt").read_text().startswith(load_case(
        EXAMPLES / f"{name}.yaml").case.title)  # fmt: skip


def test_two_load_cases_are_reported_each(runs):
    folder = runs("console")
    found = figures(folder)
    down, sideways = found["load_cases"]
    assert (down["name"], down["weight"]) == ("down", 1.0)
    assert list(down["load_displacement_m"]) == ["weight"]
    assert list(sideways["load_displacement_m"]) == ["push"]
    total = down["compliance_J"] + 2.0 * sideways["compliance_J"]
    assert found["compliance_J"] == pytest.approx(total, rel=1e-12)
    force = 20000 * np.pi * 0.006**2  # a disc, of which all lies on the end face
    work = down["load_displacement_m"]["weight"] * force
    assert down["compliance_J"] == pytest.approx(work, rel=1e-3)
    wall = np.array(down["support_force_N"]["wall"])
    np.testing.assert_allclose(wall, [0, 0, force], atol=1e-3 * force)
    summary = (folder / "summary.txt").read_text()
    assert "load case sideways" in summary and "(sideways)" in summary
    grid = meshio.read(folder / "fields" / "step_0002.vtu")
    names = {"phi", "displacement_m_down", "displacement_m_sideways"}
    assert set(grid.point_data) == names
    assert {"von_mises_Pa_down", "energy_density_J_per_m3"} <= set(grid.cell_data)
    largest = np.linalg.norm(grid.point_data["displacement_m_sideways"], axis=1).max()
    assert largest == pytest.approx(sideways["largest_displacement_m"])


def test_the_deck_is_solid_and_counted(runs):
    field = design(runs("table_with_deck"))
    z = field.mesh.points[:, 2]
    assert (z >= 0.018 - 1e-9).sum() > 20
    assert np.all(field.values[z >= 0.018 - 1e-9] == 1.0)
    mass = tet_geometry(field.mesh).lumped_mass
    assert mass @ field.values == pytest.approx(0.23 * mass.sum(), rel=1e-12)


def test_the_footbridge_carries_its_weight(runs):
    folder = runs("footbridge")
    found = figures(folder)
    weight = found["material_volume_m3"] * 2400 * 9.81
    force = found["load_cases"][0]["support_force_N"]["abutment"]
    assert force[2] == pytest.approx(weight, rel=1e-3)
    field = design(folder)
    x, _, z = field.mesh.points.T
    assert np.all(field.values[np.hypot(x, z) < 1.2] == 0.0)
    assert np.all(field.values[z >= 1.85] == 1.0)


def test_the_press_moves_as_it_is_told_and_tells_its_force(runs):
    folder = runs("press")
    found = figures(folder)
    moved = np.load(folder / "phase_field.npz")["displacement"][0]
    x, y, z = design(folder).mesh.points.T
    punch = (z == 0.025) & (x <= 0.008) & (y <= 0.008)
    np.testing.assert_allclose(moved[punch, 2], -1e-4, rtol=1e-12)
    force = found["load_cases"][0]["support_force_N"]["punch"]
    assert found["compliance_J"] == pytest.approx(1e-4 * force[2], rel=1e-3)
    assert force[2] < 0.0
    assert "force at punch" in (folder / "summary.txt").read_text()


def test_a_mesh_that_is_too_coarse_is_told_with_the_mesh_that_would_do(runs):
    """eps: auto follows the mesh; a given one may be too small for it."""
    assert "COARSE" not in (runs("console") / "summary.txt").read_text()
    out = runs.base / "coarse"
    settings = [*TINY, "mesh.kind=bcc", "mesh.tets=900", "topopt.eps=3mm"]
    arguments = [str(EXAMPLES / "console.yaml"), "--out", str(out), "--quiet", "--stop-after"]
    assert main([*arguments, "topopt", "--set", *settings]) == 0
    (line,) = [li for li in (out / "summary.txt").read_text().splitlines() if "COARSE" in li]
    edge = float(line.partition("an edge length of ")[2].split()[0])
    assert edge == pytest.approx(np.pi * 0.003 / np.sqrt(2) / 4, rel=0.05)
    manifest = json.loads((out / "manifest.json").read_text())
    assert any("would give 4" in words for words in manifest["warnings"])


def test_the_bracket_is_made_meshed_and_loaded_in_its_eye(runs, monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    import bracket

    monkeypatch.delitem(sys.modules, "bracket")
    monkeypatch.setattr(bracket, "CORNERS", 8)  # of the eye: quicker to mesh
    surface = bracket.bracket()
    found = topology(surface.faces, len(surface.points))
    assert found.watertight and found.oriented and found.genus == 1
    write_surface(runs.base / "bracket.stl", surface)
    shutil.copy(EXAMPLES / "bracket.yaml", runs.base)
    folder = runs("bracket", "mesh={edge_length: 20mm, cache: false}", "remesh.vertices=500")
    chords = 2 * 8 * 6.0 * np.sin(np.pi / 8)
    force = np.array(figures(folder)["load_cases"][0]["support_force_N"]["ceiling"])
    assert force[2] == pytest.approx(50000 * chords * 9.9 * 1e-6, rel=2e-2)
    surface = read_surface(folder / "surface.ply")
    assert topology(surface.faces, len(surface.points)).watertight
