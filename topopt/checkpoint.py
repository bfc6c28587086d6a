"""The loop's state on disk, so that a run that was killed goes on from its last step.

Two files take turns. Each is written beside its place and then renamed, so at any moment at least
one of them is whole: a kill loses the step that was on its way, nothing else. A run that goes on
from a checkpoint takes the same steps, bit for bit, as one that was never stopped.
"""

import dataclasses
import importlib
import importlib.metadata
import io
import json
import logging
import zipfile
import zlib
from pathlib import Path

import numpy as np

from meshes.errors import InvalidCase
from meshes.io import write_atomically

LOG = logging.getLogger("phasemesh")

FORMAT = 2
DAMAGE = (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile, zlib.error)


class Checkpoints:
    """The two checkpoint files of a run.

    Parameters
    ----------
    folder : path-like
    identity : mapping of str to str, or to a tuple of them
        What a checkpoint must agree in to be gone on from, in words for the error's sentence:
        {"mesh": ..., "case": ...}. The version of the package is added. A tuple has one for each
        level.
    """

    def __init__(self, folder, identity):
        self._paths = [Path(folder) / f"checkpoint-{k}.npz" for k in (0, 1)]
        self._identity = {"version": package_version(), **identity}

    def write(self, loop):
        """Keep a LoopState; InvalidCase if the file cannot be written."""
        arrays = {}
        words = {
            "format": FORMAT,
            "step": loop.history[-1].iteration,
            "level": loop.level,
            "identity": self._identity_of(loop.level),
            "loop": _encode(loop, arrays),
        }
        data = io.BytesIO()
        np.savez(data, words=np.frombuffer(json.dumps(words).encode(), np.uint8), **arrays)
        write_atomically(self._paths[words["step"] % 2], data.getbuffer())

    def read(self):
        """The LoopState of the latest whole checkpoint, or None if there is none.

        Raises
        ------
        InvalidCase
            If it was made by another version, on another mesh or for another case.
        """
        found = [entry for entry in map(_open, self._paths) if entry is not None]
        if not found:
            return None
        path, words, arrays = max(found, key=lambda entry: entry[1]["step"])
        for name, value in self._identity_of(words["level"]).items():
            if words["identity"].get(name) != value:
                raise InvalidCase(
                    f"{path}: was made with another {name} and cannot be gone on from; "
                    "run without --resume"
                )
        return _decode(words["loop"], arrays)

    def _identity_of(self, level):
        """What belongs to a level; None stands for what the run does not know there."""
        return {
            name: (value[level - 1] if level <= len(value) else None)
            if isinstance(value, tuple)
            else value
            for name, value in self._identity.items()
        }


def package_version():
    """The installed version, or "unknown" where the package runs uninstalled."""
    try:
        return importlib.metadata.version("phasemesh")
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


def _open(path):
    """(path, words, arrays) of a checkpoint, or None if it is missing or damaged."""
    if not path.exists():
        return None
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        words = json.loads(arrays.pop("words").tobytes())
        numbers = (words["step"], words["level"])
        if words["format"] != FORMAT or not all(isinstance(n, int) for n in numbers):
            raise ValueError("unknown format")
    except DAMAGE as error:
        LOG.warning("%s: is damaged (%s) and is not used", path, error)
        return None
    return path, words, arrays


def _encode(value, arrays):
    """A tree of dataclasses, tuples, dicts and numbers for JSON; its arrays go into `arrays`."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        name = f"array_{len(arrays)}"
        arrays[name] = value
        return {"array": name}
    if isinstance(value, tuple | list):
        return {type(value).__name__: [_encode(item, arrays) for item in value]}
    if isinstance(value, dict):
        return {"dict": [[_encode(k, arrays), _encode(v, arrays)] for k, v in value.items()]}
    if dataclasses.is_dataclass(value):
        kind = type(value)
        names = [field.name for field in dataclasses.fields(value)]
        content = {name: _encode(getattr(value, name), arrays) for name in names}
        return {"class": [kind.__module__, kind.__qualname__], "fields": content}
    raise TypeError(f"a checkpoint cannot hold a {type(value).__name__}")


def _decode(tree, arrays):
    """The inverse of `_encode`; only dataclasses of this package are made."""
    if not isinstance(tree, dict):
        return tree
    if "array" in tree:
        return arrays[tree["array"]]
    if "dict" in tree:
        return {_decode(k, arrays): _decode(v, arrays) for k, v in tree["dict"]}
    if "class" in tree:
        module, name = tree["class"]
        if not module.startswith("topopt."):
            raise ValueError(f"unknown class {module}.{name}")
        kind = getattr(importlib.import_module(module), name)
        content = {key: _decode(value, arrays) for key, value in tree["fields"].items()}
        if not dataclasses.is_dataclass(kind):
            raise ValueError(f"unknown class {module}.{name}")
        return kind(**content)
    kind = {"tuple": tuple, "list": list}
    ((name, items),) = tree.items()
    return kind[name](_decode(item, arrays) for item in items)
