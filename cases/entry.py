"""The way into every command: Ctrl-C already counts while the modules are imported."""

import importlib
import os
import sys

# Idle threads of a parallel loop spin this often before they sleep: enough for the next loop.
os.environ.setdefault("GOMP_SPINCOUNT", "10000")


def start(module, function, *arguments):
    """Import a module and call one of its functions; returns the exit code.

    Parameters
    ----------
    module, function : str
        Such as "cases.cli" and "main".
    """
    try:
        command = getattr(importlib.import_module(module), function)
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        return 130
    return command(*arguments)
