"""What the stages leave on disk for a later run to go on from (--from), besides the PLY files.

The mesh goes into `mesh.npz` and the design into `phase_field.npz`; PLY files keep a surface
exactly (doubles, labels, feature edges), so they serve as they are.
"""

import io
import json
import zipfile

import numpy as np

from meshes import PhaseField
from meshes.errors import InvalidCase
from meshes.io import write_atomically
from topopt.domain import mesh_hash


def save_design(path, field, arrays, figures):
    """Write a PhaseField's values, further arrays by name, and figures (a dict for JSON)."""
    words = json.dumps({"mesh": mesh_hash(field.mesh), "figures": figures}, sort_keys=True)
    data = io.BytesIO()
    np.savez(data, words=np.frombuffer(words.encode(), np.uint8), values=field.values, **arrays)
    write_atomically(path, data.getvalue())


def load_design(path, mesh):
    """Return (PhaseField, arrays, figures) of a design on `mesh`.

    Raises
    ------
    InvalidCase
        If the file is missing or damaged, or was made on another mesh.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        words = json.loads(arrays.pop("words").tobytes())
        field = PhaseField(mesh, arrays.pop("values")) if _same(words, mesh) else None
    except FileNotFoundError:
        raise InvalidCase(f"{path}: is missing; run with --from topopt") from None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InvalidCase(f"{path}: is damaged ({error}); run with --from topopt") from None
    if field is None:
        raise InvalidCase(f"{path}: was made on another mesh; run with --from topopt")
    return field, arrays, words["figures"]


def _same(words, mesh):
    return words["mesh"] == mesh_hash(mesh)
