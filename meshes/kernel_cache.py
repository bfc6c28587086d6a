"""Compiled kernels on disk that are out of date.

numba compares a cached kernel with the file it stands in, and with no other. One that calls a
kernel of another module, or takes a constant from there, is loaded as it was although that module
has changed since: after an edit or an update the old code would go on computing.
"""

import contextlib
import os
import re
from pathlib import Path

PACKAGES = ("meshes", "topopt", "isosurface", "rbf", "remesh")
ROOT = Path(__file__).resolve().parents[1]
IMPORT = re.compile(r"^(?:from|import) +([\w.]+)(?: +import +([\w, ]+))?", re.MULTILINE)
COMPILERS = ("numba", "compiled")  # last names of the modules that make kernels


def drop_stale_kernels(root=ROOT, packages=PACKAGES):
    """Remove the index of every cached kernel older than a module its own one rests on.

    Those are the modules it imports, and theirs in turn where they hold kernels. Only caches in
    `__pycache__` are looked at, not those that NUMBA_CACHE_DIR names.

    Parameters
    ----------
    root : path
        The folder of the packages.
    packages : sequence of str

    Returns
    -------
    list of pathlib.Path
        What was removed; numba then compiles anew.
    """
    files = [path for package in packages for path in _files(Path(root) / package)]
    sources = {_module(path, root): path for path in files if path.suffix == ".py"}
    indexes = [path for path in files if path.suffix == ".nbi"]
    changed = {module: _time(path) for module, path in sources.items()}
    compiled = {path: _time(path) for path in indexes}
    if not compiled or max(changed.values()) <= min(compiled.values()):
        return []
    imports = {module: _imports(path, sources) for module, path in sources.items()}
    stale = []
    for path, time in compiled.items():
        own = _module(path.parents[1] / f"{path.name.partition('.')[0]}.py", root)
        if any(changed.get(module, 0) > time for module in _needed(own, imports)):
            with contextlib.suppress(OSError):
                path.unlink()
                stale.append(path)
    return stale


def _files(folder):
    return [Path(where, name) for where, _, names in os.walk(folder) for name in names]


def _module(path, root):
    return ".".join(path.relative_to(root).with_suffix("").parts)


def _time(path):
    """Nanoseconds of the last change; 0 if the file has gone."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def _imports(path, sources):
    """The project's modules that a file imports, and whether it makes kernels."""
    found, makes = set(), False
    for module, names in IMPORT.findall(path.read_text(encoding="utf-8")):
        makes |= module.partition(".")[0] in COMPILERS or module.split(".")[-1] in COMPILERS
        found |= {module, *(f"{module}.{name.strip()}" for name in names.split(","))}
    return found & sources.keys(), makes


def _needed(module, imports):
    """A module, those it imports, and those that these import if they hold kernels."""
    needed, waiting = set(), [module]
    while waiting:
        name = waiting.pop()
        if name not in needed and name in imports:
            needed.add(name)
            modules, makes = imports[name]
            if makes:
                waiting += modules
    return needed
