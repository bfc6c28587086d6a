"""A plain validator of the part of JSON Schema that our schema uses."""

import re

_TYPES = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "null": type(None),
}
_KNOWN = {
    "$schema", "$defs", "$ref", "title", "description", "default", "required", "type", "enum",
    "const", "anyOf", "properties", "additionalProperties", "propertyNames", "items", "minItems",
    "maxItems", "pattern", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum",
    "patternProperties",
}  # fmt: skip


def complaints(value, schema, root=None, path="case"):
    """What a schema (dict) has against a value: a list of str, empty if it is valid."""
    root = schema if root is None else root
    unknown = set(schema) - _KNOWN
    if unknown:
        raise ValueError(f"{path}: the schema uses {unknown}, which this validator does not know")
    if "$ref" in schema:
        return complaints(value, root["$defs"][schema["$ref"].rpartition("/")[2]], root, path)
    found = list(_simple(value, schema, path))
    if "anyOf" in schema and all(
        complaints(value, option, root, path) for option in schema["anyOf"]
    ):
        found.append(f"{path}: fits none of the options")
    if isinstance(value, dict):
        found += _of_object(value, schema, root, path)
    if isinstance(value, list) and "items" in schema:
        for k, item in enumerate(value):
            found += complaints(item, schema["items"], root, f"{path}.{k}")
    return found


def _simple(value, schema, path):
    kinds = schema.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if kinds and not any(_is_a(value, kind) for kind in kinds):
        yield f"{path}: is no {' or '.join(kinds)}"
    if "enum" in schema and value not in schema["enum"]:
        yield f"{path}: is not in {schema['enum']}"
    if isinstance(value, str) and not re.search(schema.get("pattern", ""), value):
        yield f"{path}: does not match {schema['pattern']}"
    if _is_a(value, "number"):
        bounds = (
            value >= schema.get("minimum", value),
            value <= schema.get("maximum", value),
            value > schema.get("exclusiveMinimum", value - 1),
            value < schema.get("exclusiveMaximum", value + 1),
        )
        if not all(bounds):
            yield f"{path}: is out of bounds"
    if isinstance(value, list):
        size = len(value)
        if not schema.get("minItems", 0) <= size <= schema.get("maxItems", size):
            yield f"{path}: has the wrong length"


def _is_a(value, kind):
    if isinstance(value, bool):
        return kind == "boolean"
    return isinstance(value, _TYPES[kind])


def _of_object(value, schema, root, path):
    found = [f"{path}: lacks {key}" for key in schema.get("required", []) if key not in value]
    properties = schema.get("properties", {})
    patterns = schema.get("patternProperties", {})
    others = schema.get("additionalProperties", True)
    for key, item in value.items():
        where = f"{path}.{key}"
        inner = [s for pattern, s in patterns.items() if re.search(pattern, key)]
        if key in properties:
            found += complaints(item, properties[key], root, where)
        elif inner:
            found += complaints(item, inner[0], root, where)
        elif others is False:
            found.append(f"{where}: unknown key")
        elif isinstance(others, dict):
            found += complaints(item, others, root, where)
    return found
