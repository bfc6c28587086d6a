"""VTP, the surfaces of VTK and ParaView, with values at points and labels of faces.

Read: words, base64 and raw bytes, inline or appended, plain or compressed with zlib or LZMA.
Written: base64, not compressed. Nothing of VTK is needed: its reader ends the process on a
damaged file that announces too much.
"""

import base64
import binascii
import lzma
import zlib
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from meshes.errors import InvalidMesh
from meshes.face_labels import is_label_name, numbered_labels
from meshes.patch import Patch
from meshes.polygons import triangulate
from meshes.tri_mesh import TriMesh

TYPES = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4",
    "Int64": "i8", "UInt64": "u8", "Float32": "f4", "Float64": "f8",
}  # fmt: skip
NAMES = {np.dtype(code): name for name, code in TYPES.items()}
COMPRESSORS = {
    None: None,
    "vtkZLibDataCompressor": zlib.decompressobj,
    "vtkLZMADataCompressor": lzma.LZMADecompressor,
}


def read_vtp(data):
    """The TriMesh in VTP bytes, and the values at its points by name.

    Raises
    ------
    InvalidMesh
        If the bytes are no VTP, are cut off or damaged.
    """
    root, appended = _parsed(data)
    reader = _Reader(root, appended)
    pieces = [_piece(reader, piece) for piece in root.iterfind("PolyData/Piece")]
    if not pieces:
        raise InvalidMesh("it has no PolyData with a Piece")
    start = np.cumsum([0] + [len(points) for points, *_ in pieces])
    points = np.concatenate([points for points, *_ in pieces])
    faces = np.concatenate([faces + first for (_, faces, _, _), first in zip(pieces, start)])
    labels = _common([numbers for *_, numbers, _ in pieces])
    values = _common([values for *_, values in pieces])
    found = next((numbered_labels(v) for k, v in labels.items() if is_label_name(k)), None)
    mesh = TriMesh(points, faces) if found is None else TriMesh(points, faces, found[1], found[0])
    return mesh, values


def _parsed(data):
    """The root element, and the encoding and bytes of the appended data."""
    place, appended = data.find(b"<AppendedData"), None
    if place >= 0:
        begin = data.find(b"_", data.find(b">", place)) + 1
        end = data.rfind(b"</AppendedData>")
        if begin == 0 or end < begin:
            raise InvalidMesh("its appended data is cut off")
        raw = b"raw" in data[place:begin]
        body = data[begin:end]
        appended = ("raw", body) if raw else ("base64", body.strip())
        data = data[:place] + data[end + len(b"</AppendedData>") :]
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InvalidMesh(f"it is no VTP file, or cut off ({error})") from error
    if root.tag != "VTKFile" or root.get("type") != "PolyData":
        raise InvalidMesh("it is no VTP file: it has no VTKFile of type PolyData")
    return root, appended


class _Reader:
    """Makes arrays of DataArray elements."""

    def __init__(self, root, appended):
        self.order = ">" if root.get("byte_order") == "BigEndian" else "<"
        header = root.get("header_type", "UInt32")
        self.header = np.dtype(self.order + {"UInt32": "u4", "UInt64": "u8"}.get(header, "u4"))
        self.appended = appended
        name = root.get("compressor")
        if name not in COMPRESSORS:
            raise InvalidMesh(f"its compression {name} is not read: write it with zlib")
        self.decompressor = COMPRESSORS[name]

    def array(self, element):
        """The values (n,) or (n, k) of a DataArray; None for texts."""
        kind = TYPES.get(element.get("type"))
        if kind is None:
            return None
        name = element.get("Name", "")
        try:
            values = self._values(element, np.dtype(self.order + kind))
            width = int(element.get("NumberOfComponents") or 1)
            values = values.astype(values.dtype.newbyteorder("="))
            return values if width == 1 else values.reshape(-1, width)
        except (ValueError, TypeError, OverflowError, IndexError, binascii.Error, EOFError,
                zlib.error, lzma.LZMAError) as error:  # fmt: skip
            raise InvalidMesh(f"its array {name!r} is cut off or damaged ({error})") from error

    def _values(self, element, kind):
        if element.get("format") == "appended":
            if self.appended is None:
                raise InvalidMesh("its appended data is missing")
            encoding, body = self.appended
            body = body[int(element.get("offset", 0)) :]
            take = _raw if encoding == "raw" else _from_base64
            return np.frombuffer(self._payload(body, take), kind)
        text = element.text or ""
        if element.get("format") == "binary":
            return np.frombuffer(self._payload(text.strip().encode(), _from_base64), kind)
        return np.array(text.split(), dtype=kind.newbyteorder("="))

    def _payload(self, body, take):
        """The bytes of one array: a header of lengths, and perhaps compressed blocks."""
        size = self.header.itemsize
        if self.decompressor is None:
            count = int(np.frombuffer(take(body, 0, size), self.header)[0])
            return take(body, 0, count, size)
        blocks = int(np.frombuffer(take(body, 0, size), self.header)[0])
        head = take(body, 0, (3 + blocks) * size)
        _, block, last, *packed = np.frombuffer(head, self.header).tolist()
        start = _after(take, len(head))
        parts, place = [], 0
        for number, length in enumerate(packed):
            whole = last if number == blocks - 1 and last else block
            data = take(body, start, length, place)
            parts.append(self.decompressor().decompress(data, whole))
            if len(parts[-1]) != whole:
                raise ValueError("a block is too short")
            place += length
        return b"".join(parts)


def _raw(body, start, count, skip=0):
    """`count` bytes of a raw section, `skip` bytes after `start`."""
    found = body[start + skip : start + skip + count]
    if len(found) < count:
        raise ValueError(f"{count} bytes announced, {len(found)} found")
    return found


def _from_base64(body, start, count, skip=0):
    """The same of a section in base64 that begins at character `start`."""
    if start == 0 and skip and body[: -(-skip // 3) * 4].endswith(b"="):
        start, skip = -(-skip // 3) * 4, 0  # the header was encoded by itself
    first, last = skip // 3 * 4, -(-(skip + count) // 3) * 4
    found = base64.b64decode(body[start + first : start + last], validate=True)
    found = found[skip % 3 : skip % 3 + count]
    if len(found) < count:
        raise ValueError(f"{count} bytes announced, {len(found)} found")
    return found


def _after(take, length):
    """Where the section behind a header of `length` bytes begins."""
    return length if take is _raw else -(-length // 3) * 4


def _piece(reader, piece):
    """Points, faces, face arrays and point arrays of one piece."""
    points = next((reader.array(a) for a in piece.iterfind("Points/DataArray")), None)
    if points is None or points.ndim != 2 or points.shape[1] != 3:
        raise InvalidMesh("a piece has no points with three coordinates")
    points = points.astype(float)
    sizes, corners = _cells(reader, piece.find("Polys"))
    strips = _strips(*_cells(reader, piece.find("Strips")))
    skipped = sum(len(_cells(reader, piece.find(kind))[0]) for kind in ("Verts", "Lines"))
    faces = np.concatenate([triangulate(points, sizes, corners), strips[0]])
    cell = np.concatenate([np.repeat(np.arange(len(sizes)), np.maximum(sizes - 2, 0)),
                           len(sizes) + strips[1]]) + skipped  # fmt: skip
    cells = skipped + len(sizes) + strips[2]
    numbers = {k: v[cell] for k, v in _arrays(reader, piece.find("CellData"), cells).items()}
    return points, faces, numbers, _arrays(reader, piece.find("PointData"), len(points))


def _cells(reader, element):
    """Sizes and corners of the cells of one kind."""
    arrays = {}
    for item in element.iterfind("DataArray") if element is not None else ():
        arrays[item.get("Name")] = reader.array(item)
    corners, ends = arrays.get("connectivity"), arrays.get("offsets")
    if corners is None or ends is None or ends.size == 0:
        return np.zeros(0, int), np.zeros(0, int)
    if corners.ndim != 1 or ends.ndim != 1 or not {corners.dtype.kind, ends.dtype.kind} <= {*"iu"}:
        raise InvalidMesh("its cells are no lists of whole numbers")
    corners, ends = corners.astype(np.int64), ends.astype(np.int64)
    sizes = np.diff(ends, prepend=0)
    if np.any(sizes < 0) or ends[-1] > len(corners):
        raise InvalidMesh("its cells are cut off: they have fewer corners than announced")
    return sizes, corners


def _strips(sizes, corners):
    """Triangles (k, 3) of strips, the strip of each, and the number of strips."""
    faces, owner = [], []
    for number, (size, end) in enumerate(zip(sizes, np.cumsum(sizes))):
        strip = corners[end - size : end]
        for k in range(size - 2):
            faces.append(strip[[k, k + 1, k + 2]] if k % 2 == 0 else strip[[k + 1, k, k + 2]])
            owner.append(number)
    return np.array(faces, int).reshape(-1, 3), np.array(owner, int), len(sizes)


def _arrays(reader, element, count):
    """The arrays by name that have `count` rows."""
    found = {}
    for item in element.iterfind("DataArray") if element is not None else ():
        values = reader.array(item)
        if values is not None and len(values) == count and item.get("Name"):
            found[item.get("Name")] = values
    return found


def _common(parts):
    """Arrays that all pieces have, joined."""
    first = parts[0]
    return {
        name: np.concatenate([part[name] for part in parts])
        for name in first
        if all(name in part and part[name].shape[1:] == first[name].shape[1:] for part in parts)
    }


def vtp_bytes(mesh, scale=1.0, point_data=None):
    """VTP of a TriMesh, with its labels and values at its points; the same bytes each time."""
    count = len(mesh.faces)
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        "<PolyData>",
        f'<Piece NumberOfPoints="{len(mesh.points)}" NumberOfVerts="0" NumberOfLines="0" '
        f'NumberOfStrips="0" NumberOfPolys="{count}">',
        "<PointData>",
        *(_element(name, values) for name, values in (point_data or {}).items()),
        "</PointData>",
        "<CellData>",
    ]
    if len(mesh.labels) > 1 or mesh.labels[:1] != (Patch("surface"),):
        lines.append(_element("label", mesh.face_labels))
    lines += [
        "</CellData>",
        "<Points>", _element("Points", mesh.points * scale), "</Points>",
        "<Polys>",
        _element("connectivity", mesh.faces.ravel().astype(np.int64)),
        _element("offsets", 3 * np.arange(1, count + 1, dtype=np.int64)),
        "</Polys>",
        "</Piece>", "</PolyData>", "</VTKFile>", "",
    ]  # fmt: skip
    return "\n".join(lines).encode("utf-8")


def _element(name, values):
    """A DataArray in base64."""
    values = np.asarray(values)
    if values.dtype.newbyteorder("=") not in NAMES:
        values = values.astype(np.int8 if values.dtype.kind == "b" else float)
    body = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
    text = base64.b64encode(len(body).to_bytes(8, "little") + body).decode("ascii")
    width = values.shape[1] if values.ndim == 2 else 1
    kind = NAMES[values.dtype.newbyteorder("=")]
    return (
        f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{width}" '
        f'format="binary">{text}</DataArray>'
    )
