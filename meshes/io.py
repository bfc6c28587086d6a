"""Reading and writing surfaces, tetrahedral meshes and series for ParaView.

Files are written beside their place and then renamed, so that a write that fails leaves no half
file. The same mesh always gives the same bytes. Lengths are not converted on reading; `scale`
converts on writing.
"""

import os
import tempfile
from pathlib import Path
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np

from meshes.errors import InvalidCase, InvalidMesh
from meshes.obj_off import obj_bytes, off_bytes, read_obj, read_off
from meshes.ply import read_ply
from meshes.ply_writer import ply_bytes
from meshes.stl import read_stl, stl_bytes
from meshes.storage import (
    archive_bytes,
    phase_field_arrays,
    phase_field_of,
    read_archive,
    tet_mesh_arrays,
    tet_mesh_of,
)
from meshes.topology import check_indices
from meshes.vtp import read_vtp, vtp_bytes

SURFACE_SUFFIXES = (".stl", ".ply", ".obj", ".off", ".vtp")
WITH_POINT_DATA = (".ply", ".vtp")
LARGEST = 1e90  # coordinate


def read_surface(path):
    """Read a surface from an STL, PLY, OBJ, OFF or VTP file, in the unit of the file.

    Equal corners of an STL become one vertex. Polygons are cut into triangles. A PLY that
    `write_surface` wrote brings back labels, planes and feature edges. Of other files the labels
    are whole numbers of the faces under a name such as "label" or "RegionId" (PLY, VTP), the
    materials, groups or objects (OBJ), or the solids (STL in words).

    Parameters
    ----------
    path : path-like

    Returns
    -------
    TriMesh

    Raises
    ------
    InvalidCase
        If the suffix is unknown or the file cannot be opened.
    InvalidMesh
        If the file is empty, cut off, not what its suffix says, or its faces refer to points
        that do not exist or are not finite.
    """
    return read_surface_data(path)[0]


def read_surface_data(path):
    """As `read_surface`, with the values at the points that a PLY or VTP file holds.

    Returns
    -------
    mesh : TriMesh
    point_data : dict of str to (n,) or (n, k) array
        Empty for other formats.
    """
    path = Path(path)
    suffix = check_surface_suffix(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InvalidCase(f"{path}: cannot be read ({error.strerror})") from error
    if not data.strip():
        raise InvalidMesh(f"{path}: is empty")
    try:
        mesh, point_data = _parse(data, suffix)
        check_indices(mesh.faces, len(mesh.points))
        if len(mesh.faces) == 0:
            raise InvalidMesh("it has no faces")
        bad = int(np.count_nonzero(~np.isfinite(mesh.points).all(axis=1)))
        if bad:
            raise InvalidMesh(f"{bad} of its {len(mesh.points)} vertices are NaN or infinite")
        _check_size(mesh)
    except InvalidMesh as error:
        raise InvalidMesh(f"{path}: {error}") from error
    return mesh, point_data


def _check_size(mesh):
    """Refuse coordinates whose products would not be numbers any more."""
    largest = float(np.abs(mesh.points).max(initial=0.0))
    if largest > LARGEST or 0.0 < largest < 1.0 / LARGEST:
        raise InvalidMesh(
            f"its largest coordinate is {largest:.3g}, beyond all that can be computed with "
            f"(1e-90 to 1e90): use another unit"
        )


def _parse(data, suffix):
    """The TriMesh in the bytes of a file with the suffix, and the values at its points."""
    if suffix in WITH_POINT_DATA:
        return {".ply": read_ply, ".vtp": read_vtp}[suffix](data)
    return {".stl": read_stl, ".obj": read_obj, ".off": read_off}[suffix](data), {}


def check_surface_suffix(path):
    """Return the suffix in small letters; InvalidCase if it is none of SURFACE_SUFFIXES."""
    suffix = Path(path).suffix.lower()
    if suffix not in SURFACE_SUFFIXES:
        raise InvalidCase(
            f"{path}: the suffix {suffix!r} is unknown; use one of {', '.join(SURFACE_SUFFIXES)}"
        )
    return suffix


def write_surface(path, mesh, scale=1.0, point_data=None):
    """Write a surface in the format of the path's suffix.

    Parameters
    ----------
    path : path-like
        *.ply (binary, double, with labels and feature edges), *.vtp (with labels), *.stl (binary,
        single), *.obj (labels as groups) or *.off.
    mesh : TriMesh
    scale : float
        Factor on all coordinates (1000 writes metres as millimetres).
    point_data : mapping of str to (n,) or (n, k) array, optional
        Values at the points; only PLY and VTP hold them.

    Raises
    ------
    InvalidCase
        If the suffix is unknown or the file cannot be written.
    """
    path = Path(path)
    suffix = check_surface_suffix(path)
    if suffix in WITH_POINT_DATA:
        data = {".ply": ply_bytes, ".vtp": vtp_bytes}[suffix](mesh, scale, point_data)
    elif suffix == ".obj":
        data = obj_bytes(mesh, scale)
    else:
        data = {".stl": stl_bytes, ".off": off_bytes}[suffix](mesh.points * scale, mesh.faces)
    write_atomically(path, data)


def write_atomically(path, data):
    """Write bytes (or text) so that the file is there completely or not at all.

    Raises
    ------
    InvalidCase
        If the folder cannot be written to.
    """
    path = Path(path)
    data = data.encode("utf-8") if isinstance(data, str) else data
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, _usual_mode())
        os.replace(temporary, path)
    except BaseException as error:
        if temporary is not None and os.path.exists(temporary):
            os.unlink(temporary)
        if isinstance(error, OSError):
            raise InvalidCase(f"{path}: cannot be written ({error.strerror})") from error
        raise


def _usual_mode():
    """The permissions a new file would have (mkstemp's are for the owner alone)."""
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def write_tets(path, mesh, point_data=None, cell_data=None):
    """Write a tetrahedral mesh with fields as a .vtu file for ParaView.

    Parameters
    ----------
    path : path-like
    mesh : TetMesh
    point_data : mapping of str to (n,) or (n, 3) array, optional
    cell_data : mapping of str to (m,) or (m, 3) array, optional

    Raises
    ------
    InvalidCase
        If the suffix is not .vtu or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".vtu":
        raise InvalidCase(f"{path}: tetrahedra are written as .vtu")
    grid = meshio.Mesh(
        mesh.points,
        [("tetra", mesh.tets)],
        point_data={name: np.asarray(values) for name, values in (point_data or {}).items()},
        cell_data={name: [np.asarray(values)] for name, values in (cell_data or {}).items()},
    )
    with tempfile.TemporaryDirectory() as folder:
        beside = Path(folder) / "mesh.vtu"
        meshio.write(beside, grid, file_format="vtu", binary=True, compression=None)
        data = beside.read_bytes()
    write_atomically(path, data)


def write_series(path, files, times=None):
    """Write a .pvd, which ParaView opens as one series over time.

    Parameters
    ----------
    path : path-like
    files : sequence of path-like
        The .vtu files; those in the folder of `path` or below are named relative to it.
    times : sequence of float, optional
        0, 1, 2, ... if not given.
    """
    path = Path(path)
    times = range(len(files)) if times is None else times
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
        "  <Collection>",
    ]
    for time, file in zip(times, files):
        name = Path(os.path.relpath(file, path.parent)).as_posix()
        lines.append(f'    <DataSet timestep="{time}" part="0" file={quoteattr(name)}/>')
    lines += ["  </Collection>", "</VTKFile>", ""]
    write_atomically(path, "\n".join(lines))


def save_tet_mesh(path, mesh):
    """Keep a TetMesh exactly, with all sets, patches and symmetry planes, as one .npz."""
    write_atomically(path, archive_bytes(tet_mesh_arrays(mesh)))


def load_tet_mesh(path):
    """Return what `save_tet_mesh` kept; InvalidMesh if the file is none or damaged."""
    return tet_mesh_of(read_archive(path), path)


def save_phase_field(path, phase):
    """Keep a PhaseField and its mesh exactly as one .npz."""
    write_atomically(path, archive_bytes(phase_field_arrays(phase)))


def load_phase_field(path):
    """Return what `save_phase_field` kept; InvalidMesh if the file is none or damaged."""
    return phase_field_of(read_archive(path), path)
