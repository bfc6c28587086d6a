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
from topopt.problem import Cylinder, LoadCase, Material, Slab, Sphere, SurfaceRegion

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
    for suffix in ("ply", "obj", "off"):
        write_surface(tmp_path / f"cube.{suffix}", cube(20.0))
        other = problem_of(tmp_path, settings=[TETS, f"domain.surface=cube.{suffix}"]).domain
        assert signed_volume(other.surface) == pytest.approx(0.02**3)
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


def test_regions_of_every_kind(tmp_path):
    write_surface(tmp_path / "deck.stl", cube(20.0))
    for text, wanted in (
        ("{slab: {point: [0, 0, 1cm], normal: [0, 1, 1]}}", Slab((0, 0, 0.01), (0, 1, 1), 0.0)),
        ("{sphere: {center: [0, 1mm, 1], radius: 2mm}}", Sphere((0, 0.001, 1), 0.002)),
        (
            "{cylinder: {start: [0, 0, 0], end: [0, 0, 1cm], radius: 2mm}}",
            Cylinder((0, 0, 0), (0, 0, 0.01), 0.002),
        ),
    ):
        assert problem_of(tmp_path, settings=[f"supports.foot={text}"]).supports[0].region == wanted
    region = "loads.deck={surface: deck.stl, traction: [0, 0, 1]}"
    found = problem_of(tmp_path, settings=[region]).loads[0].region
    assert isinstance(found, SurfaceRegion) and found.name == "deck.stl"
    assert signed_volume(found.surface) == pytest.approx(0.02**3)


def test_surface_regions_need_an_inside(tmp_path):
    box = cube(20.0)
    write_surface(tmp_path / "open.stl", TriMesh(box.points, box.faces[1:]))
    write_surface(tmp_path / "turned.stl", TriMesh(box.points, box.faces[:, ::-1]))
    region = "loads.deck={{surface: {}.stl, traction: [0, 0, 1]}}"
    with pytest.raises(InvalidCase, match=r"loads\.deck\.surface: open\.stl is not closed"):
        problem_of(tmp_path, settings=[region.format("open")])
    with pytest.raises(InvalidCase, match=r"loads\.deck\.surface: .*cannot be read"):
        problem_of(tmp_path, settings=[region.format("none")])
    found = problem_of(tmp_path, settings=[region.format("turned")]).loads[0].region
    assert signed_volume(found.surface) > 0


def test_a_later_kind_of_region_replaces_the_other(tmp_path):
    text = "supports.foot.sphere={center: [0, 0, 0], radius: 1cm}"
    settings = [text, "supports.foot.x=null"]
    region = problem_of(tmp_path, settings=settings).supports[0].region
    assert region == Sphere((0, 0, 0), 0.01)


@pytest.mark.parametrize("young, poisson", [(210e9, 0.3), (1e6, 0.0), (3.0, -0.9), (5e9, 0.499)])
def test_material_by_young_and_poisson(tmp_path, young, poisson):
    text = f"material={{young: {young}, poisson: {poisson}}}"
    material = problem_of(tmp_path, settings=[text]).material
    lame, mu = material.lame_lambda, material.lame_mu
    assert mu * (3 * lame + 2 * mu) / (lame + mu) == pytest.approx(young, rel=1e-12)
    assert lame / (2 * (lame + mu)) == pytest.approx(poisson, rel=1e-9, abs=1e-15)


def test_the_other_pair_replaces_the_first(tmp_path):
    text = TINY + "material: {lame_lambda: 1.0e+9, lame_mu: 1.0e+9}\n"
    settings = ["material.young=2e9", "material.poisson=0.25"]
    material = problem_of(tmp_path, text, settings).material
    assert material.lame_lambda == pytest.approx(0.8e9)
    assert problem_of(tmp_path, text).material.lame_mu == 1e9
    assert problem_of(tmp_path).material == Material()


def test_load_cases_and_passive_regions(tmp_path):
    text = TINY + (
        "load_cases:\n  a: {loads: [deck], weight: 2, gravity: false}\n"
        "  b: {displacements: [foot]}\n"
        "passive:\n  rib: {plane: z=0, phase: solid}\n  hole: {plane: x=0, phase: void}\n"
    )
    problem = problem_of(tmp_path, text, ["supports.foot.displacement=[0, 0, -1mm]"])
    assert problem.load_cases == (
        LoadCase("a", ("deck",), 2.0, False),
        LoadCase("b", displacements=("foot",)),
    )
    assert [(p.name, p.solid) for p in problem.passive] == [("rib", True), ("hole", False)]
    assert problem.supports[0].displacement == (0.0, 0.0, -0.001)
    assert problem_of(tmp_path).cases == (LoadCase("all", ("deck",)),)
