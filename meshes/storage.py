"""Tetrahedral meshes and phase fields kept exactly, for the cache and for later stages."""

import io
import json
import zipfile

import numpy as np

from meshes.errors import InvalidMesh
from meshes.patch import Patch, Plane, SymmetryPlane
from meshes.phase_field import PhaseField
from meshes.tet_mesh import TetMesh


def archive_bytes(arrays):
    """An .npz of named arrays with fixed dates: the same bytes for the same arrays."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            info = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(info, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
    return buffer.getvalue()


def read_archive(path):
    """The named arrays of an .npz.

    Raises
    ------
    InvalidMesh
        If the file is missing, cut off, or no such archive.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise InvalidMesh(f"{path}: cannot be read as a stored mesh ({error})") from error
    except zipfile.zlib.error as error:
        raise InvalidMesh(f"{path}: is damaged ({error})") from error


def tet_mesh_arrays(mesh):
    """A TetMesh as named arrays without Python objects."""
    words = {
        "patches": [[p.name, _plane_words(p.plane)] for p in mesh.patches],
        "symmetry": [[plane.axis, plane.offset] for plane in mesh.symmetry],
        "facet_sets": list(mesh.facet_sets),
        "node_sets": list(mesh.node_sets),
    }
    arrays = {
        "kind": np.array("phasemesh tetrahedra 1"),
        "words": np.array(json.dumps(words)),
        "points": mesh.points,
        "tets": mesh.tets,
        "facets": mesh.facets,
        "facet_patch": mesh.facet_patch,
    }
    for group in ("facet_sets", "node_sets"):
        for number, members in enumerate(getattr(mesh, group).values()):
            arrays[f"{group}_{number}"] = members
    return arrays


def _plane_words(plane):
    """A plane as numbers for JSON."""
    return None if plane is None else [*(float(x) for x in plane.normal), float(plane.offset)]


def tet_mesh_of(arrays, path):
    """The TetMesh of `tet_mesh_arrays`.

    Raises
    ------
    InvalidMesh
        If arrays are missing or do not fit together.
    """
    try:
        words = json.loads(str(arrays["words"]))
        patches = tuple(
            Patch(name, None if numbers is None else Plane(tuple(numbers[:3]), numbers[3]))
            for name, numbers in words["patches"]
        )
        sets = {
            group: {name: arrays[f"{group}_{k}"] for k, name in enumerate(words[group])}
            for group in ("facet_sets", "node_sets")
        }
        symmetry = tuple(SymmetryPlane(axis, offset) for axis, offset in words["symmetry"])
        basic = (arrays[name] for name in ("points", "tets", "facets", "facet_patch"))
        return TetMesh(*basic, patches, sets["facet_sets"], sets["node_sets"], symmetry)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InvalidMesh(f"{path}: holds no tetrahedral mesh of this program") from error


def phase_field_arrays(phase):
    """A PhaseField as named arrays: those of its mesh, and its values."""
    return {**tet_mesh_arrays(phase.mesh), "phi": phase.values}


def phase_field_of(arrays, path):
    """The PhaseField of `phase_field_arrays`.

    Raises
    ------
    InvalidMesh
        If arrays are missing or do not fit together.
    """
    mesh = tet_mesh_of(arrays, path)
    try:
        return PhaseField(mesh, arrays["phi"])
    except (KeyError, ValueError) as error:
        raise InvalidMesh(f"{path}: holds a mesh, but no phase field on it") from error
