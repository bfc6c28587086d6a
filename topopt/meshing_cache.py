"""Meshes kept on disk: pytetwild gives another mesh each time, so a run uses the one it has.

A mesh is kept in the frame it was made in (longest side of the domain 1), under a hash of
everything that went into it, so that a domain scaled by any factor finds it too.
"""

import hashlib
import json
import os
from pathlib import Path

import numpy as np

from meshes.errors import InvalidCase, InvalidMesh
from meshes.io import load_tet_mesh, save_tet_mesh
from meshes.tet_mesh import tet_volumes


def default_cache():
    """The folder of kept meshes: $PHASEMESH_CACHE/meshes, or ~/.cache/phasemesh/meshes."""
    root = os.environ.get("PHASEMESH_CACHE")
    return (Path(root) if root else Path.home() / ".cache" / "phasemesh") / "meshes"


def cache_key(settings, *arrays):
    """Hash of settings (anything JSON knows) and arrays, as hexadecimal digits."""
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
    for array in arrays:
        array = np.ascontiguousarray(array)
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def mesh_hash(mesh):
    """SHA-256 of the points and tets of a TetMesh, as hexadecimal digits."""
    return cache_key("mesh", mesh.points, mesh.tets)


def cached(folder, key, make, log):
    """The mesh kept in `folder` under `key`; if there is none, what `make()` returns, kept.

    Parameters
    ----------
    folder : Path, or None to keep nothing
    key : str
    make : callable returning a TetMesh
    log : callable taking a str
        Told of meshes reused, damaged files, and folders that cannot be written to.

    Returns
    -------
    TetMesh
        When two processes make the same mesh at once, both return the one kept first.
    """
    if folder is None:
        return make()
    path = Path(folder) / f"{key[:32]}.npz"
    mesh = _load(path, log)
    if mesh is not None:
        log(f"mesh of {len(mesh.tets):,} tets from the cache: {path}")
        return mesh
    mesh = make()
    return _load(path, log) or _save(path, mesh, log)


def _load(path, log):
    """The valid mesh in a file, or None."""
    if not path.exists():
        return None
    try:
        mesh = load_tet_mesh(path)
        check_tets(mesh)
    except InvalidMesh as error:
        reason = str(error).removeprefix(f"{path}: ")
        log(f"the kept mesh {path} is damaged and made again: {reason}")
        return None
    return mesh


def _save(path, mesh, log):
    """Keep a mesh if the folder lets us; return it."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        save_tet_mesh(path, mesh)
    except (OSError, InvalidCase) as error:
        log(f"the mesh is not kept for the next run: {error}")
    return mesh


def check_tets(mesh):
    """Raise InvalidMesh if indices are out of range or a tet has no positive volume."""
    for name, corners in (("tets", mesh.tets), ("facets", mesh.facets)):
        if not len(corners) or corners.min() < 0 or corners.max() >= len(mesh.points):
            raise InvalidMesh(f"its {name} refer to points that do not exist")
    if len(mesh.facet_patch) and not 0 <= mesh.facet_patch.min() <= mesh.facet_patch.max() < len(
        mesh.patches
    ):
        raise InvalidMesh("its facets refer to patches that do not exist")
    smallest = tet_volumes(mesh.points, mesh.tets).min()
    if not smallest > 0:
        raise InvalidMesh(f"its smallest tet has the volume {smallest:g}")
