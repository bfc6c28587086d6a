"""Case files into validated models: base, preset and --set laid over one another.

Whatever is wrong becomes one sentence a line: file and line (or the argument), key, what is
allowed, and what was found there.
"""

import difflib
import types
import typing
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from cases import source
from cases.schema import KINDS, Case, Section
from meshes.errors import InvalidCase

# Of each group a later layer that gives one key takes the others away.
_EXCLUSIVE = (
    (("mesh",), {"tets", "edge_length"}),
    (("remesh",), {"vertices", "edge_length", "edge_factor"}),
    (("rbf",), {"support_radius", "support_factor"}),
    (("domain",), {"box", "surface"}),
    (("material",), {"lame_lambda", "young"}),
    (("material",), {"lame_mu", "poisson"}),
    (("material",), {"lame_lambda", "poisson"}),
    (("material",), {"lame_mu", "young"}),
    (("supports", "*"), set(KINDS)),
    (("loads", "*"), set(KINDS)),
    (("passive", "*"), set(KINDS)),
    (("supports", "*"), {"stiffness", "displacement"}),
)


@dataclass(frozen=True)
class LoadedCase:
    """A validated case and where it came from.

    Parameters
    ----------
    case : Case
    preset : str or None
        The preset that was laid over the file's base.
    folder : Path
        The folder of the case file; the domain's surface file is relative to it.
    """

    case: Case
    preset: str | None
    folder: Path


def load_case(path, preset=None, settings=(), shown=None):
    """Read a case file, lay a preset and settings over it, and validate the result.

    Parameters
    ----------
    path : str or Path
    preset : str, optional
        A name under `presets:` of the file; else the one its key `preset` names, if any.
    settings : sequence of str
        "dotted.key=value" each, the value in YAML.
    shown : str, optional
        What the file is called in messages; its path as given unless said otherwise.

    Raises
    ------
    InvalidCase
        One sentence a line, for everything that is wrong.
    """
    shown = str(path) if shown is None else shown
    base = source.parse(source.read_text(path, shown), shown)
    presets = base.tree.pop("presets", None)
    preset = _choose_preset(base, presets, preset)
    if preset is not None:
        _lay_over(base, presets[preset], ("presets", preset))
    for setting in settings:
        _apply_setting(base, setting)
    case = _validate(base)
    return LoadedCase(case, preset, Path(path).resolve().parent)


def _choose_preset(base, presets, asked):
    """Return the name of the preset to use (None: the base as it is), checked."""
    default = base.tree.pop("preset", None)
    if presets is not None and not isinstance(presets, dict):
        raise InvalidCase(f"{base.origin(('presets',))}: presets: must be a mapping of names")
    name = asked if asked is not None else default
    if name is None:
        return None
    known = list(presets or ())
    if name not in known:
        where = f"--preset {name}" if asked is not None else f"{base.origin(('preset',))}: preset"
        has = f"the case has {', '.join(known)}" if known else "the case has no presets"
        raise InvalidCase(f"{where}: no such preset; {has}{_did_you_mean(name, known)}")
    if not isinstance(presets[name], dict | None):
        where = base.origin(("presets", name))
        raise InvalidCase(f"{where}: presets.{name}: must be a mapping of keys to values")
    return name


def _lay_over(base, layer, prefix):
    """Merge a layer of the file into the tree; mappings merge, everything else replaces."""

    def merge(target, source_node, path):
        for group_path, group in _EXCLUSIVE:
            if _matches(path, group_path) and group & set(source_node):
                for key in group - set(source_node):
                    target.pop(key, None)
        for key, value in source_node.items():
            here = (*path, key)
            base.origins[here] = base.origin(prefix + here)
            if isinstance(value, dict):
                if not isinstance(target.get(key), dict):
                    target[key] = {}
                merge(target[key], value, here)
            else:
                target[key] = value
                _move_origins(base, prefix + here, here)

    merge(base.tree, layer or {}, ())


def _move_origins(base, old, new):
    """Let the items of a list that replaced another one keep their own lines."""
    for path in [p for p in base.origins if p[: len(new)] == new and len(p) > len(new)]:
        del base.origins[path]
    for path in [p for p in base.origins if p[: len(old)] == old]:
        base.origins[new + path[len(old) :]] = base.origins[path]


def _matches(path, pattern):
    return len(path) == len(pattern) and all(p in ("*", k) for k, p in zip(path, pattern))


def _apply_setting(base, setting):
    """Set one dotted key of the tree."""
    shown = f"--set {setting}"
    key, equals, text = setting.partition("=")
    keys = key.strip().split(".")
    if not equals or not all(keys):
        raise InvalidCase(f"{shown}: must be KEY=VALUE, as topopt.steps=20")
    value = source.parse_value(text, shown)
    node, path = base.tree, ()
    for part in keys[:-1]:
        part, path = _step_into(node, part, path)
        if not isinstance(node[part], dict | list):
            node[part] = {}
        node = node[part]
    last, path = _step_into(node, keys[-1], path)
    for group_path, group in _EXCLUSIVE:
        if _matches(path[:-1], group_path) and last in group:
            for other in group - {last}:
                node.pop(other, None)
    node[last] = value
    for old in [p for p in base.origins if p[: len(path)] == path]:
        del base.origins[old]
    base.origins[path] = shown


def _step_into(node, part, path):
    """Return the key or index that `part` means in `node`, and the path to it."""
    if isinstance(node, list):
        if not part.isdecimal() or int(part) >= len(node):
            dotted = ".".join(map(str, path))
            raise InvalidCase(f"--set {dotted}.{part}: {dotted} has the items 0 to {len(node) - 1}")
        return int(part), (*path, int(part))
    node.setdefault(part, None)
    return part, (*path, part)


def _validate(base):
    try:
        return Case.model_validate(base.tree)
    except ValidationError as error:
        errors = error.errors(include_url=False)
    raise InvalidCase("\n".join(_sentence(base, item) for item in _sorted(base, errors)))


def _sorted(base, errors):
    """In the order of the file's lines."""

    def line(item):
        tail = base.origin(item["loc"]).rpartition(":")[2]
        return int(tail) if tail.isdecimal() else 10**9

    return sorted(errors, key=line)


def _sentence(base, error):
    """One validation error as `where: key: what is allowed, got ...`."""
    path, value = error["loc"], error["input"]
    dotted = ".".join(map(str, path))
    where = _origin(base, path)
    lead = f"{where}: {dotted}: " if dotted else f"{where}: the case "
    kind = error["type"]
    if kind == "missing":
        return lead + f"is missing{_meaning(path)}"
    if kind == "extra_forbidden":
        return lead + f"unknown key{_nearest_key(path)}"
    context = error.get("ctx", {})
    remark = f" ({context['remark']})" if context.get("remark") else ""
    return lead + _allowed(kind, context, error) + _got(value) + remark


def _origin(base, path):
    """The place to name; where a --set reached into the refused value, that argument."""
    inside = [p for p in base.origins if p[: len(path)] == path and len(p) > len(path)]
    settings = [base.origins[p] for p in inside if base.origins[p].startswith("--set ")]
    return settings[-1] if settings else base.origin(path)


def _allowed(kind, context, error):
    if kind == "refused":
        return context["text"]
    if kind == "literal_error":
        return f"must be one of {context['expected'].replace(' or ', ', ')}"
    known = {
        "bool_type": "must be true or false",
        "string_type": "must be a text",
        "dict_type": "must be a mapping of names",
        "model_type": "must be a mapping of keys to values",
        "model_attributes_type": "must be a mapping of keys to values",
    }
    return known.get(kind, error["msg"])


def _got(value):
    if isinstance(value, dict | Section):
        return ""
    if value is None:
        return ", got nothing"
    text = repr(value) if isinstance(value, str) else _in_yaml(value)
    return f", got {text if len(text) <= 60 else text[:57] + '...'}"


def _in_yaml(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join('null' if v is None else _in_yaml(v) for v in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _section_of(annotation):
    """The Section inside an annotation such as `BoxSection | None` or `dict[str, Load]`."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation, False
    arguments = typing.get_args(annotation)
    if typing.get_origin(annotation) is dict:
        return _section_of(arguments[1])[0], True
    if isinstance(annotation, types.UnionType):
        for argument in arguments:
            found = _section_of(argument)
            if found[0]:
                return found
    return None, False


def _model_at(path):
    """The Section whose keys stand at `path`, or None."""
    model, keys = Case, list(path)
    while keys and model is not None:
        field = model.model_fields.get(keys.pop(0))
        model, named = _section_of(field.annotation) if field else (None, False)
        if named and keys:
            keys.pop(0)
    return model


def _meaning(path):
    model = _model_at(path[:-1])
    field = model.model_fields.get(path[-1]) if model else None
    return f": {field.description}" if field is not None and field.description else ""


def all_keys(model=Case, prefix=""):
    """Every dotted key of the schema; `NAME` stands for a name the user chooses."""
    for key, field in model.model_fields.items():
        yield prefix + key
        section, named = _section_of(field.annotation)
        if section is not None:
            yield from all_keys(section, f"{prefix}{key}.{'NAME.' if named else ''}")


def _nearest_key(path):
    """What the user may have meant by an unknown key."""
    model = _model_at(path[:-1])
    known = list(model.model_fields) if model else []
    near = difflib.get_close_matches(str(path[-1]), known, 1, 0.6)
    if near:
        return f"; did you mean {'.'.join(map(str, (*path[:-1], near[0])))}?"
    elsewhere = [key for key in all_keys() if key.rpartition(".")[2] == path[-1]]
    if elsewhere:
        return f"; did you mean {elsewhere[0]}?"
    return f"; known here: {', '.join(known)}" if known else ""


def _did_you_mean(name, known):
    near = difflib.get_close_matches(str(name), known, 1, 0.6)
    return f"; did you mean {near[0]}?" if near else ""
