"""The resolved case: every value that was used, in a file that runs the same case again."""

import io

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from meshes.io import write_atomically


def resolved_case(loaded):
    """A LoadedCase as nested dicts and lists; the paths of surfaces are absolute."""
    tree = loaded.case.model_dump(mode="json")
    regions = [item for kind in ("supports", "loads", "passive") for item in tree[kind].values()]
    for section in (tree["domain"], *regions):
        if section["surface"] is not None:
            section["surface"] = str((loaded.folder / section["surface"]).resolve())
    return tree


def write_case(path, tree, source, preset):
    """Write a resolved case as YAML."""
    yaml = YAML(pure=True)
    yaml.default_flow_style = None
    yaml.width = 100
    text = io.StringIO()
    laid = f", preset {preset}" if preset else ""
    text.write(f"# Every value of the run, resolved from {source}{laid}. SI units.\n")
    yaml.dump(tree, text)
    write_atomically(path, text.getvalue())


def read_case(path):
    """The tree that `write_case` wrote, or None if there is none that can be read."""
    try:
        return YAML(typ="safe", pure=True).load(path)
    except (OSError, YAMLError, ValueError):
        return None
