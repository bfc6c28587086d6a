"""VTU, ParaView's format for meshes of tets: base64, in blocks that zlib has packed.

The tets pack to a quarter, the numbers of a field hardly at all: packing those takes most of the
time and saves a tenth. So they are put into blocks as they are (zlib's level 0), which every reader
of packed files takes. The tets are packed once for a mesh.
"""

import base64
import zlib
from weakref import WeakKeyDictionary
from xml.sax.saxutils import quoteattr

import numpy as np

from meshes.vtp import NAMES

TETRA = 10  # VTK's number of the kind of cell
PACKED, AS_IT_IS = 1, 0  # zlib's levels
_KNOWN = WeakKeyDictionary()  # TetMesh to its elements Points and Cells


def vtu_bytes(mesh, point_data=None, cell_data=None):
    """VTU of a TetMesh with values at its points and on its tets; the same bytes each time."""
    if mesh not in _KNOWN:
        _KNOWN[mesh] = _points_and_cells(mesh)
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64" compressor="vtkZLibDataCompressor">',
        "<UnstructuredGrid>",
        f'<Piece NumberOfPoints="{len(mesh.points)}" NumberOfCells="{len(mesh.tets)}">',
        *_KNOWN[mesh],
        "<PointData>",
        *(_element(name, values) for name, values in (point_data or {}).items()),
        "</PointData>",
        "<CellData>",
        *(_element(name, values) for name, values in (cell_data or {}).items()),
        "</CellData>",
        "</Piece>", "</UnstructuredGrid>", "</VTKFile>", "",
    ]  # fmt: skip
    return "\n".join(lines).encode("utf-8")


def _points_and_cells(mesh):
    """The elements Points and Cells of a mesh, line by line."""
    count = len(mesh.tets)
    return (
        "<Points>", _element("Points", mesh.points), "</Points>",
        "<Cells>",
        _element("connectivity", mesh.tets.ravel(), PACKED),
        _element("offsets", 4 * np.arange(1, count + 1, dtype=np.int64), PACKED),
        _element("types", np.full(count, TETRA, np.uint8), PACKED),
        "</Cells>",
    )  # fmt: skip


def _element(name, values, level=AS_IT_IS):
    """A DataArray, one block long."""
    values = np.asarray(values)
    if values.dtype.newbyteorder("=") not in NAMES:
        values = values.astype(np.int8 if values.dtype.kind == "b" else float)
    body = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
    packed = zlib.compress(body, level)
    head = np.array([1, len(body), len(body), len(packed)], "<u8") if body else np.zeros(1, "<u8")
    text = (base64.b64encode(head.tobytes()) + base64.b64encode(packed)).decode("ascii")
    width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    kind = NAMES[values.dtype.newbyteorder("=")]
    return (
        f'<DataArray type="{kind}" Name={quoteattr(name)}{width} format="binary">{text}</DataArray>'
    )
