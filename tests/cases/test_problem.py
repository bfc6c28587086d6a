"""From the case file to the problem: regions, symmetry, surfaces with units."""

import math

import numpy as np
import pytest

from cases.load import load_case
from cases.problem import to_problem, units_warning
from meshes import SymmetryPlane, TriMesh
from meshes.errors import InvalidCase
from meshes.io import write_surface
from meshes.quality import signed_volume
from tests.cases.cases_in_text import TINY, write_case
from tests.shapes import cube

TETS = "mesh.kind=pytetwild"


def problem_of(tmp_path, text=TINY, settings=()):
    return to_problem(load_case(write_case(tmp_path, text), settings=settings))


def test_a_plane_is_a_box_without_thickness(tmp_path):
    problem = problem_of(tmp_path)
    assert problem.supports[0].region.lower == (0.016, -math.inf, 0.0)
    assert problem.supports[0].region.upper == (0.02, math.inf, 0.0)
    assert problem.loads[0].region.upper == (0.006, math.inf, 0.01)
    assert problem.loads[0].traction == (0.0, 0.0, -2400.0)
    assert problem.symmetry == (SymmetryPlane(0, 0.0), SymmetryPlane(1, 0.0))
    assert problem.supports[0].fixed == (0, 1, 2)


def test_a_box_region_with_open_ends(tmp_path):
    box = "supports.foot={box: [[16mm, null], null, [0, .inf]], fixed: [z]}"
    region = problem_of(tmp_path, settings=[box]).supports[0].region
    assert region.lower == (0.016, -math.inf, 0.0)
    assert region.upper == (math.inf, math.inf, math.inf)


def test_auto_is_left_to_the_optimiser(tmp_path):
    problem = problem_of(tmp_path, settings=["topopt.gamma=auto", "topopt.eps=auto"])
    assert problem.gamma is None
    assert problem.eps is None


def test_a_surface_in_its_unit_relative_to_the_case(tmp_path):
    write_surface(tmp_path / "cube.stl", cube(20.0))
    domain = problem_of(tmp_path, settings=[TETS, "domain.surface=cube.stl"]).domain
    assert signed_volume(domain.surface) == pytest.approx(0.02**3)
    domain = problem_of(tmp_path, settings=[TETS, "domain={surface: cube.stl, unit: cm}"]).domain
    assert signed_volume(domain.surface) == pytest.approx(0.2**3)


def test_surfaces_that_cannot_be_read(tmp_path):
    for name, reason in (("none.stl", "cannot be read"), ("case.yaml", "suffix")):
        with pytest.raises(InvalidCase, match=reason) as caught:
            problem_of(tmp_path, settings=[TETS, f"domain.surface={name}"])
        assert "domain.surface" in str(caught.value)
        assert caught.value.__cause__ is None  # the case is wrong, not the disk


@pytest.mark.parametrize("flaw", ["open", "intersecting"])
def test_a_domain_that_bounds_no_solid_is_refused(tmp_path, capsys, flaw):
    from cases.cli import main

    box = cube(20.0)
    surface = TriMesh(box.points, box.faces[1:])
    if flaw == "intersecting":
        points = np.concatenate([box.points, box.points + 7.0])
        surface = TriMesh(points, np.concatenate([box.faces, box.faces + 8]))
    write_surface(tmp_path / "bad.stl", surface)
    path = write_case(tmp_path)
    settings = ["domain.surface=bad.stl", TETS, "loads.deck.plane=z=20mm", "mesh.cache=false"]
    arguments = [str(path), "--out", str(tmp_path / "run"), "--quiet", "--set", *settings]
    assert main(arguments) == 2
    text = capsys.readouterr().err
    assert len(text.splitlines()) == 1
    assert ("open" if flaw == "open" else "cuts itself") in text
    assert main([*arguments, "mesh.tets=100"]) == 2  # nothing was made: no --force is asked for
    assert "--force" not in capsys.readouterr().err


def test_forgotten_units(tmp_path):
    assert units_warning(problem_of(tmp_path)) is None
    large = problem_of(tmp_path, settings=["domain.box.upper=[50, 15, 20]"])
    assert "50 m long" in units_warning(large)
