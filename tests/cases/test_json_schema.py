"""The exported JSON Schema and docs/cases.md cover every key; the schema takes our cases."""

import json
import re
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from cases.cli import main
from cases.json_schema import case_schema
from cases.load import all_keys
from tests.cases.cases_in_text import TINY
from tests.cases.json_schema_reference import complaints

ROOT = Path(__file__).parents[2]
FILES = sorted([*(ROOT / "cases").glob("*.yaml"), *(ROOT / "examples").glob("*.yaml")])
REGION = {
    "box", "plane", "x", "y", "z", "slab", "slab.point", "slab.normal", "slab.thickness",
    "sphere", "sphere.center", "sphere.radius", "cylinder", "cylinder.start", "cylinder.end",
    "cylinder.radius", "surface", "unit",
}  # fmt: skip


def tree_of(text):
    return YAML(typ="safe", pure=True).load(text)


def test_the_command_prints_the_schema(capsys):
    assert main(["--schema"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(case_schema()))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_schema_takes_our_cases(path):
    assert complaints(tree_of(path.read_text(encoding="utf-8")), case_schema()) == []


def test_the_schema_takes_a_case_with_everything():
    text = TINY + "preset: coarse\noutput: {pictures: false}\n"
    for line in (
        "slab: {point: [0, 0, 1mm], normal: [0, 0, 1]}",
        "sphere: {center: [1, 2mm, 3], radius: 2cm}",
        "cylinder: {start: [0, 0, 0], end: [1, 0, 0], radius: 3}",
        "surface: foot.stl",
        "box: [null, [0, null], [1mm, 2]]",
    ):
        tree = tree_of(text.replace("plane: z=0\n    x: [16mm, 20mm]", line))
        assert tree["supports"]["foot"].keys() == {line.split(":")[0], "fixed"}
        assert complaints(tree, case_schema()) == []


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("volume_fraction: 0.4", "volume_fraction: 9.5", "case.topopt.volume_fraction"),
        ("gamma: 1.0e-4", "gama: 1.0e-4", "case.topopt.gama: unknown key"),
        ("kind: bcc", "kind: tetgen", "case.mesh.kind"),
        ("plane: z=0\n", "sphere: {radius: 3}\n", "case.supports.foot.sphere"),
        ("traction: [0, 0, -2400]", "traction: [0, -2400]", "case.loads.deck.traction"),
        ("fixed: [x, y, z]", "fixed: [w]", "case.supports.foot.fixed.0"),
        ("steps: 7", "steps: 0.5", "case.presets.long"),
        ("name: tiny\n", "", "case: lacks name"),
    ],
)
def test_the_schema_refuses_what_is_wrong(old, new, complaint):
    assert old in TINY
    found = complaints(tree_of(TINY.replace(old, new)), case_schema())
    assert len(found) == 1
    assert found[0].startswith(complaint)


def schema_keys(schema, part, prefix=""):
    for key, value in part.get("properties", {}).items():
        yield prefix + key
        options = [value, *value.get("anyOf", [])]
        named = value.get("additionalProperties") or next(
            iter(value.get("patternProperties", {}).values()), {}
        )
        if "$ref" in named:
            inner = schema["$defs"][named["$ref"].rpartition("/")[2]]
            yield from schema_keys(schema, inner, f"{prefix}{key}.NAME.")
        for option in options:
            if "$ref" in option:
                inner = schema["$defs"][option["$ref"].rpartition("/")[2]]
                yield from schema_keys(schema, inner, f"{prefix}{key}.")


def test_the_schema_has_every_key_of_the_models():
    schema = case_schema()
    found = set(schema_keys(schema, schema))
    assert set(all_keys()) == {key for key in found if not key.startswith("preset")}


def documented_keys():
    """Dotted keys in the tables of docs/cases.md, by the headings above them."""
    heading, found = "", set()
    for line in (ROOT / "docs" / "cases.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            heading = line[3:]
        row = re.match(r"\| ([^|]*) \|", line)
        if not row or row[1] in ("key", "---"):
            continue
        prefix = "" if heading == "The whole" else f"{heading}."
        for key in ["region"] if row[1] == "region" else re.findall(r"`([^`]*)`", row[1]):
            found.add(prefix + key)
    return found


def test_every_key_is_documented_and_no_other():
    found = documented_keys() - {"preset", "presets"}
    shared = {key.removeprefix("Regions.") for key in found if key.startswith("Regions.")}
    assert shared == REGION
    for kind in ("supports", "loads", "passive"):
        found.remove(f"{kind}.NAME.region")
        found |= {f"{kind}.NAME.{key}" for key in shared}
    found = {key for key in found if not key.startswith("Regions.")}
    assert found == set(all_keys())
