"""Case files into models: defaults, presets, --set, and the sentence for every mistake."""

import pytest

from cases.load import all_keys, load_case
from cases.resolved import read_case, resolved_case, write_case
from meshes.errors import InvalidCase
from tests.cases import cases_in_text
from tests.cases.cases_in_text import TINY


def load(tmp_path, text=TINY, **options):
    path = cases_in_text.write_case(tmp_path, text)
    return load_case(path, shown="tiny.yaml", **options)


def refusal(tmp_path, text=TINY, **options):
    with pytest.raises(InvalidCase) as caught:
        load(tmp_path, text, **options)
    return str(caught.value)


def test_values_and_defaults(tmp_path):
    case = load(tmp_path).case
    assert case.domain.box.upper == (0.02, 0.01, 0.01)
    assert case.supports["foot"].plane == "z=0.0"
    assert case.supports["foot"].x == (0.016, 0.02)
    assert case.loads["deck"].x == (0.0, 0.006)
    assert case.loads["deck"].y == (None, None)
    assert case.material.density == 1240.0
    assert case.topopt.eps == 0.002


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "volume_fraction: 0.4",
            "volume_fraction: 9.5",
            "tiny.yaml:17: topopt.volume_fraction: must lie in (0, 1), got 9.5 "
            "(percent? write 0.095)",
        ),
        (
            "gamma: 1.0e-4",
            "gama: 1.0e-4",
            "tiny.yaml:18: topopt.gama: unknown key; did you mean topopt.gamma?",
        ),
        (
            "name: tiny",
            "name: tiny\nvolume_fraction: 0.4",
            "tiny.yaml:2: volume_fraction: unknown key; did you mean topopt.volume_fraction?",
        ),
        (
            "steps: 5",
            "steps: 2.5",
            "tiny.yaml:20: topopt.steps: must be a whole number, got 2.5",
        ),
        (
            "gamma: 1.0e-4",
            "gamma: .nan",
            "tiny.yaml:18: topopt.gamma: must be a finite number, or auto, got nan",
        ),
        (
            "gamma: 1.0e-4",
            "gamma: 1e400",
            "tiny.yaml:18: topopt.gamma: must be a finite number, or auto, got inf",
        ),
        (
            "gamma: 1.0e-4",
            "gamma: 3mm",
            "tiny.yaml:18: topopt.gamma: must be a plain number in SI units, without a unit, "
            "or auto, got '3mm'",
        ),
        (
            "eps: 2mm",
            "eps: 2 inch",
            "tiny.yaml:19: topopt.eps: must have a unit of length (m, dm, cm, mm, um, nm), "
            "not 'inch', or auto, got '2 inch'",
        ),
        (
            "eps: 2mm",
            "eps: -2mm",
            "tiny.yaml:19: topopt.eps: must be positive, got '-2mm'",
        ),
        (
            "kind: bcc",
            "kind: tetgen",
            "tiny.yaml:15: mesh.kind: must be one of 'pytetwild', 'bcc', got 'tetgen'",
        ),
        (
            "traction: [0, 0, -2400]",
            "traction: [0, -2400]",
            "tiny.yaml:14: loads.deck.traction: must be three numbers [x, y, z], got [0, -2400]",
        ),
        (
            "x: [16mm, 20mm]",
            "x: [20mm, 16mm]",
            "tiny.yaml:8: supports.foot.x: must be a range [low, high] with low <= high, "
            "got [20mm, 16mm]",
        ),
        (
            "x: [16mm, 20mm]",
            "z: [0, 1mm]",
            "tiny.yaml:6: supports.foot: fixes z by its plane and cannot take a range of it too",
        ),
        (
            "fixed: [x, y, z]",
            "fixed: [x, w]",
            "tiny.yaml:9: supports.foot.fixed: must list the directions that are held, "
            "as [x, y, z], got [x, w]",
        ),
        (
            "symmetry: [x=0, y=0]",
            "symmetry: [x=0, x=1]",
            "tiny.yaml:4: symmetry: must name each axis once, got [x=0, x=1]",
        ),
        (
            "upper: [20mm, 10mm, 10mm]",
            "upper: [20mm, 0, 10mm]",
            "tiny.yaml:3: domain.box: must have each coordinate of upper above that of lower",
        ),
        (
            "tets: 1500",
            "cache: true",
            "tiny.yaml:15: mesh: must give either tets or edge_length",
        ),
        (
            "name: tiny",
            "name: ../tiny",
            "tiny.yaml:1: name: must be a name of letters, digits, '-', '_' and '.', "
            "got '../tiny'",
        ),
        (
            "name: tiny",
            "name: tiny\noutput: {pictures: yes}",
            "tiny.yaml:2: output.pictures: must be true or false, got 'yes'",
        ),
        (
            "name: tiny",
            "name: tiny\nrbf: 3",
            "tiny.yaml:2: rbf: must be a mapping of keys to values, got 3",
        ),
        (
            "name: tiny",
            "name: tiny\nmaterial: {young: 1.0e+9}",
            "tiny.yaml:2: material: needs both lame_lambda and lame_mu, or both young and poisson",
        ),
        (
            "name: tiny",
            "name: tiny\nmaterial: {young: 1.0e+9, poisson: 0.5}",
            "tiny.yaml:2: material.poisson: must lie in (-1, 0.5), got 0.5 "
            "(0.5 is incompressible; take 0.49)",
        ),
        (
            "name: tiny",
            "name: tiny\nmaterial: {young: 1.0e+9, lame_mu: 1.0e+9}",
            "tiny.yaml:2: material: takes lame_lambda and lame_mu, or young and poisson, not both",
        ),
        (
            "name: tiny",
            "name: tiny\nmaterial: {lame_lambda: -1.0e+9, lame_mu: 1.0e+9}",
            "tiny.yaml:2: material: needs 3 lame_lambda + 2 lame_mu > 0 (the bulk modulus is "
            "positive)",
        ),
        (
            "fixed: [x, y, z]",
            "displacement: [0, 0, 1mm]\n    stiffness: 1.0e+9",
            "tiny.yaml:6: supports.foot: takes a stiffness or a displacement, not both",
        ),
        (
            "fixed: [x, y, z]",
            "fixed: [x]\n    displacement: [0, 0, 1mm]",
            "tiny.yaml:6: supports.foot: moves z, which is not among the directions of fixed",
        ),
        (
            "fixed: [x, y, z]",
            "stiffness: 0",
            "tiny.yaml:9: supports.foot.stiffness: must be positive, got 0",
        ),
        (
            "plane: z=10mm\n    x: [0, 6mm]",
            "sphere: {center: [0, 0, 1mm], radius: 0}",
            "tiny.yaml:12: loads.deck.sphere.radius: must be positive, got 0",
        ),
        (
            "plane: z=10mm",
            "slab: {point: [0, 0, 0], normal: [0, 0, 0]}",
            "tiny.yaml:12: loads.deck.slab: must have a normal that is not zero",
        ),
        (
            "plane: z=10mm",
            "surface: deck.stl",
            "tiny.yaml:11: loads.deck: takes the range x with a plane only, as plane: z=20mm",
        ),
        (
            "    plane: z=10mm\n    x: [0, 6mm]\n",
            "",
            "tiny.yaml:11: loads.deck: must give one of box, plane, slab, sphere, cylinder and "
            "surface",
        ),
        (
            "name: tiny",
            "name: tiny\nload_cases: {a: {loads: deck}}",
            "tiny.yaml:2: load_cases.a.loads: must be a list of names, as [deck, side], "
            "got 'deck'",
        ),
        (
            "name: tiny",
            "name: tiny\npassive: {rib: {plane: z=0, phase: soild}}",
            "tiny.yaml:2: passive.rib.phase: must be one of 'solid', 'void', got 'soild'",
        ),
        ("name: tiny", "seed: 1", "tiny.yaml:1: name: is missing: a short name; "
         "the output folder's default"),
    ],
)  # fmt: skip
def test_one_sentence_for_each_mistake(tmp_path, old, new, sentence):
    assert TINY.count(old) == 1
    assert refusal(tmp_path, TINY.replace(old, new)) == sentence


def test_all_mistakes_at_once_in_the_order_of_the_lines(tmp_path):
    text = TINY.replace("steps: 5", "steps: -5").replace("name: tiny", "name: [1]")
    lines = refusal(tmp_path, text).splitlines()
    assert [line.split(":")[1] for line in lines] == ["1", "20"]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a: 1\na: 2\n", "tiny.yaml:2: the key 'a' is given twice"),
        ("", "tiny.yaml:1: is empty"),
        ("- 1\n", "tiny.yaml:1: must be a mapping of keys to values"),
        ("a: [1\n", "tiny.yaml:2: is not valid YAML"),
        ("a:\n\tb: 1\n", "tiny.yaml:2: is not valid YAML"),
        ("&a [*a]\n", "tiny.yaml: is nested too deeply, or refers to itself"),
    ],
)
def test_no_yaml(tmp_path, text, sentence):
    assert refusal(tmp_path, text).startswith(sentence)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InvalidCase, match="no such file"):
        load_case(tmp_path / "none.yaml")
    with pytest.raises(InvalidCase, match="is a folder"):
        load_case(tmp_path)
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00name: 3")
    with pytest.raises(InvalidCase, match="UTF-8"):
        load_case(tmp_path / "binary.yaml")


def test_presets(tmp_path):
    assert load(tmp_path, preset="long").case.topopt.steps == 7
    assert load(tmp_path, preset="long").case.topopt.gamma == 1e-4
    loaded = load(tmp_path, "preset: coarse\n" + TINY)
    assert (loaded.preset, loaded.case.mesh.tets) == ("coarse", 300)
    assert load(tmp_path, "preset: coarse\n" + TINY, preset="long").case.mesh.tets == 1500
    assert refusal(tmp_path, preset="longer") == (
        "--preset longer: no such preset; the case has coarse, long; did you mean long?"
    )
    assert refusal(tmp_path, "preset: none\n" + TINY).startswith(
        "tiny.yaml:1: preset: no such preset"
    )


def test_a_mistake_in_a_preset_is_found_where_it_stands(tmp_path):
    text = TINY.replace("topopt: {steps: 7}", "topopt: {steps: 0.5}")
    assert refusal(tmp_path, text, preset="long") == (
        "tiny.yaml:26: topopt.steps: must be a whole number, got 0.5"
    )
    assert load(tmp_path, text, preset="coarse").case.topopt.steps == 5


def test_a_later_layer_replaces_the_other_way_to_say_it(tmp_path):
    case = load(tmp_path, settings=["mesh.edge_length=1mm", "remesh.edge_length=2mm"]).case
    assert (case.mesh.tets, case.mesh.edge_length) == (None, 0.001)
    assert (case.remesh.vertices, case.remesh.edge_length) == (None, 0.002)
    text = TINY.replace("mesh: {tets: 300}", "mesh: {edge_length: 2mm}")
    assert load(tmp_path, text, preset="coarse").case.mesh.tets is None


def test_settings(tmp_path):
    settings = ["topopt.steps=9", "loads.deck.traction=[0, 1, 0]", "supports.foot.fixed.2=y"]
    case = load(tmp_path, settings=settings + ["topopt.steps=11", "name=other"]).case
    assert case.topopt.steps == 11
    assert case.loads["deck"].traction == (0.0, 1.0, 0.0)
    assert case.supports["foot"].fixed == ("x", "y")
    assert case.name == "other"


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        (
            "topopt.volume_fraction=9.5",
            "--set topopt.volume_fraction=9.5: topopt.volume_fraction: must lie in (0, 1), "
            "got 9.5 (percent? write 0.095)",
        ),
        (
            "topopt.gama=1",
            "--set topopt.gama=1: topopt.gama: unknown key; did you mean topopt.gamma?",
        ),
        ("steps", "--set steps: must be KEY=VALUE, as topopt.steps=20"),
        ("=3", "--set =3: must be KEY=VALUE, as topopt.steps=20"),
        ("a..b=3", "--set a..b=3: must be KEY=VALUE, as topopt.steps=20"),
        (
            "domain.box.upper=[0, 1, 1]",
            "--set domain.box.upper=[0, 1, 1]: domain.box: must have each coordinate of upper "
            "above that of lower",
        ),
        (
            "loads.deck.traction.2=down",
            "--set loads.deck.traction.2=down: loads.deck.traction: must be a number, "
            "got [0, 0, down]",
        ),
        ("loads.deck.traction.3=1", "--set loads.deck.traction.3: loads.deck.traction has the "
         "items 0 to 2"),
    ],
)  # fmt: skip
def test_a_wrong_setting_is_named(tmp_path, setting, sentence):
    assert refusal(tmp_path, settings=[setting]) == sentence


def test_a_setting_that_is_no_yaml(tmp_path):
    assert refusal(tmp_path, settings=["topopt.steps=[1"]).startswith("--set topopt.steps=[1")


def test_the_resolved_case_runs_the_same_case_again(tmp_path):
    loaded = load(tmp_path, preset="coarse", settings=["remesh.sigma=14mm"])
    tree = resolved_case(loaded)
    write_case(tmp_path / "case.yaml", tree, "tiny.yaml", loaded.preset)
    again = load_case(tmp_path / "case.yaml")
    assert again.case == loaded.case
    assert read_case(tmp_path / "case.yaml") == tree
    assert tree["topopt"]["solver"] == "auto"
    assert read_case(tmp_path / "none.yaml") is None


def test_all_keys_are_described():
    keys = list(all_keys())
    assert "supports.NAME.fixed" in keys
    assert "remesh.edge_factor" in keys


@pytest.mark.parametrize("name", ["bridge", "table", "tower"])
@pytest.mark.parametrize("preset", ["thesis", "certified", "preview"])
def test_our_cases_are_valid(name, preset):
    from importlib.resources import files

    loaded = load_case(files("cases") / f"{name}.yaml", preset)
    assert loaded.case.name == name
    if preset == "preview":
        assert loaded.case.mesh.tets >= 20_000
    elif preset == "certified":
        tolerance = {"bridge": 1e-2, "table": 2e-2, "tower": 1e-3}[name]
        assert loaded.case.topopt.tolerance == tolerance and loaded.case.topopt.steps == 300
        assert loaded.case.mesh == load_case(files("cases") / f"{name}.yaml", "thesis").case.mesh
    else:
        assert loaded.case.topopt.steps == 60
