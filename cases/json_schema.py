"""The JSON Schema of case files, by which editors complete and check them."""

import copy

from cases.schema import Case

_DRAFT = "https://json-schema.org/draft/2020-12/schema"
_OWN_PARTS = ("Region", "BoxSection", "SlabSection", "SphereSection", "CylinderSection")


def case_schema():
    """The schema of a whole file as a dict: the case's keys, `preset` and `presets`.

    A preset may hold any part of a case, and the base may leave to it what it likes; so no key is
    required, except `name` and those that belong together (a sphere's center and radius).
    """
    schema = Case.model_json_schema()
    parts = schema.pop("$defs")
    for name, part in parts.items():
        if name not in _OWN_PARTS:
            part.pop("required", None)
    preset = copy.deepcopy(schema)
    preset.pop("required")
    preset |= {"title": "Preset", "description": "Keys of the case that the preset replaces."}
    parts["Preset"] = preset
    schema["properties"] |= {
        "preset": {"type": "string", "description": "the preset that is used if none is named"},
        "presets": {
            "type": "object",
            "description": "variants by name: --preset NAME lays one over the case",
            "additionalProperties": {"anyOf": [{"$ref": "#/$defs/Preset"}, {"type": "null"}]},
        },
    }
    whole = {"$schema": _DRAFT, "title": "phasemesh case", "required": ["name"]}
    return {**whole, **{k: v for k, v in schema.items() if k not in whole}, "$defs": parts}
