"""YAML text into plain Python values, remembering on which line each one stands."""

from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.scalarbool import ScalarBoolean

from meshes.errors import InvalidCase

_MAX_DEPTH = 40
_MAX_VALUES = 100_000


class Source:
    """A tree of plain values and where each of them comes from.

    Parameters
    ----------
    tree : dict
        Nested dicts, lists, numbers, texts, booleans and None.
    origins : dict of tuple to str
        For each path of keys and indices, the place it was given: "bridge.yaml:14".
    """

    def __init__(self, tree, origins):
        self.tree = tree
        self.origins = origins

    def origin(self, path):
        """The place of the value at `path`, or of the nearest one around it."""
        path = tuple(path)
        while path and path not in self.origins:
            path = path[:-1]
        return self.origins.get(path, "")


def read_text(path, shown):
    """Return the text of the file at `path`, known to the user as `shown`.

    Raises
    ------
    InvalidCase
        If it cannot be read, or is no UTF-8 text.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InvalidCase(f"{shown}: no such file") from None
    except IsADirectoryError:
        raise InvalidCase(f"{shown}: is a folder, not a YAML file") from None
    except UnicodeDecodeError:
        raise InvalidCase(f"{shown}: is not a text file in UTF-8") from None
    except OSError as error:
        raise InvalidCase(f"{shown}: cannot be read: {error.strerror}") from None


def parse(text, shown):
    """Parse a case file.

    Raises
    ------
    InvalidCase
        If the text is no YAML (a key given twice included), or no mapping.
    """
    tree, origins = _plain_tree(_load(text, shown), shown)
    if tree is None:
        raise InvalidCase(f"{shown}:1: is empty; a case needs at least name, domain, supports, ...")
    if not isinstance(tree, dict):
        raise InvalidCase(f"{shown}:1: must be a mapping of keys to values, as name: bridge")
    origins.setdefault((), f"{shown}:1")
    return Source(tree, origins)


def parse_value(text, shown):
    """Parse the value of one argument."""
    tree, _ = _plain_tree(_load(text, shown), shown)
    return tree


def _load(text, shown):
    try:
        return YAML(typ="rt", pure=True).load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{shown}:{mark.line + 1}" if mark else shown
        raise InvalidCase(f"{where}: {_problem(error)}") from None
    except (YAMLError, ValueError, RecursionError) as error:
        reason = str(error).splitlines()[0] if str(error) else "nested too deeply"
        raise InvalidCase(f"{shown}: is not valid YAML: {reason}") from None


def _problem(error):
    problem = (error.problem or "is malformed").splitlines()[0]
    if problem.startswith("found duplicate key"):
        key = problem.split('"')[1] if '"' in problem else problem.split()[3]
        return f"the key '{key}' is given twice"
    if "\\t" in problem:
        problem += " (indent by spaces, not tabs)"
    return f"is not valid YAML: {problem}"


def _plain_tree(data, shown):
    """Return plain values and the origins of all of them."""
    origins = {}

    def convert(node, path):
        if len(path) > _MAX_DEPTH or len(origins) > _MAX_VALUES:
            raise InvalidCase(f"{shown}: is nested too deeply, or refers to itself")
        if isinstance(node, CommentedMap):
            return {str(key): child(node, key, path + (str(key),)) for key in node}
        if isinstance(node, CommentedSeq):
            return [child(node, index, (*path, index)) for index in range(len(node))]
        return _plain_scalar(node)

    def child(node, key, path):
        place = node.lc.data.get(key) if node.lc.data else None
        if place is not None:
            origins[path] = f"{shown}:{place[0] + 1}"
        return convert(node[key], path)

    return convert(data, ()), origins


def _plain_scalar(value):
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, ScalarBoolean):
        return bool(value)
    for kind in (int, float, str):
        if isinstance(value, kind):
            return kind(value)
    inner = getattr(value, "value", value)  # a scalar with a tag of its own
    return inner if isinstance(inner, int | float | str) else str(inner)
