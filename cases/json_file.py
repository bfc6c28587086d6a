"""JSON files that appear whole or not at all."""

import json
import math

from meshes.io import write_atomically


def write_json(path, data):
    """Write `data` as indented JSON; NaN and infinities, which JSON lacks, become null."""
    write_atomically(path, json.dumps(plain(data), indent=2, allow_nan=False) + "\n")


def plain(value):
    """Return `value` with nothing but what JSON knows."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "item"):  # numpy's scalars
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
