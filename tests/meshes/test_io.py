"""Surfaces, tetrahedra and fields come back as they were written; bad files give one sentence."""

import os
import struct

import meshio
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from meshes import InvalidCase, InvalidMesh, Patch, PhaseField, Plane, SymmetryPlane, TriMesh
from meshes.io import (
    load_phase_field,
    load_tet_mesh,
    read_surface,
    save_phase_field,
    save_tet_mesh,
    write_series,
    write_surface,
    write_tets,
)
from meshes.quality import signed_volume
from meshes.structured import bcc_box
from meshes.topology import require_valid
from tests import shapes


def labelled():
    mesh = shapes.cube(1 / 3)
    patches = [Patch("smooth one"), Patch('b "2" \u00e9', Plane((0.6, -0.8, 1e-17), 1 / 7))]
    patches += [Patch(name) for name in ("", "plane 1 2 3", "x+", "end_header")]
    edges = [(0, 1), (2, 3), (7, 6)]
    return TriMesh(mesh.points, mesh.faces, np.repeat(np.arange(6), 2), tuple(patches), edges)


def assert_equal(a, b):
    for name in ("points", "faces", "face_labels", "feature_edges"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert a.labels == b.labels


def write(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize("mesh", [labelled(), shapes.torus(), shapes.cube()])
def test_ply_keeps_everything(tmp_path, mesh):
    write_surface(tmp_path / "a.ply", mesh)
    assert_equal(read_surface(tmp_path / "a.ply"), mesh)


@pytest.mark.parametrize("suffix", ["obj", "off", "STL", "Ply"])
def test_every_format_brings_the_surface_back(tmp_path, suffix):
    mesh = shapes.torus(n_major=9, n_minor=6)
    path = tmp_path / f"a.{suffix}"
    write_surface(path, mesh)
    back = read_surface(path)
    require_valid(back)
    rounding = 1e-6 if suffix == "STL" else 0.0
    np.testing.assert_allclose(
        back.points[back.faces], mesh.points[mesh.faces], rtol=0, atol=rounding
    )
    if suffix != "STL":
        np.testing.assert_array_equal(back.faces, mesh.faces)


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj", "off"])
def test_same_mesh_same_bytes_and_scale(tmp_path, suffix):
    mesh = labelled()
    for name in "ab":
        write_surface(tmp_path / f"{name}.{suffix}", mesh, scale=1000.0)
    first, second = ((tmp_path / f"{name}.{suffix}").read_bytes() for name in "ab")
    assert first == second
    back = read_surface(tmp_path / f"a.{suffix}")
    assert signed_volume(back) == pytest.approx(1e9 / 27, rel=1e-6)
    if suffix == "ply":
        assert back.labels[1].plane == Plane((0.6, -0.8, 1e-17), 1000 / 7)


def test_stl_is_the_format_others_read(tmp_path):
    from stl import mesh as numpy_stl

    sphere = shapes.icosphere(2)
    write_surface(tmp_path / "a.stl", sphere)
    theirs = numpy_stl.Mesh.from_file(str(tmp_path / "a.stl"), calculate_normals=False)
    np.testing.assert_array_equal(theirs.vectors, sphere.points[sphere.faces].astype("f4"))
    middles = theirs.vectors.mean(axis=1)
    unit = middles / np.linalg.norm(middles, axis=1)[:, None]
    assert np.einsum("ij,ij->i", theirs.normals, unit).min() > 0.99
    theirs.save(str(tmp_path / "b.stl"), mode=1)
    assert (tmp_path / "b.stl").read_bytes().startswith(b"solid")
    require_valid(read_surface(tmp_path / "b.stl"))


def test_ply_and_off_of_others(tmp_path):
    mesh = shapes.icosphere(1)
    grid = meshio.Mesh(mesh.points, [("triangle", mesh.faces)])
    for name, options in (("a.ply", {"binary": True}), ("b.ply", {"binary": False}), ("c.off", {})):
        meshio.write(tmp_path / name, grid, **options)
        back = read_surface(tmp_path / name)
        np.testing.assert_array_equal(back.faces, mesh.faces)
        np.testing.assert_allclose(back.points, mesh.points, rtol=1e-15)
    plain = TriMesh(mesh.points, mesh.faces)
    for name in ("d.ply", "d.off", "d.obj"):
        write_surface(tmp_path / name, plain)
        theirs = meshio.read(tmp_path / name)
        np.testing.assert_array_equal(theirs.points, mesh.points)
        np.testing.assert_array_equal(theirs.cells_dict["triangle"], mesh.faces)


ASCII_STL = """solid part of something
 facet normal 0 0 1
  outer loop
   vertex 0 0 -0.0
   vertex 1e0 0 0
   vertex 0 1 0
  endloop
 endfacet
 facet normal 0 0 1
  outer loop
   VERTEX 1 0 0
   vertex 1 1 0
   vertex 0 1 0.0
  endloop
 endfacet
endsolid
"""


def test_ascii_stl_is_welded(tmp_path):
    mesh = read_surface(write(tmp_path / "a.stl", ASCII_STL))
    np.testing.assert_array_equal(mesh.points, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [1, 3, 2]])


def test_binary_stl_whose_header_says_solid(tmp_path):
    write_surface(tmp_path / "a.stl", shapes.cube())
    data = (tmp_path / "a.stl").read_bytes()
    mesh = read_surface(write(tmp_path / "b.stl", b"solid".ljust(80) + data[80:]))
    require_valid(mesh)


def test_stl_faces_that_collapse_are_left_out(tmp_path):
    mesh = shapes.icosphere(1)
    middle = 0.5 * (mesh.points[mesh.faces[0, 0]] + mesh.points[mesh.faces[0, 1]])
    points = np.concatenate([mesh.points, [middle], [middle + 1e-12]])
    # A face so thin that single precision makes one point of two of its corners.
    thin = TriMesh(points, np.concatenate([mesh.faces, [[len(middle), 42, 43]]]))
    write_surface(tmp_path / "a.stl", thin)
    assert len(read_surface(tmp_path / "a.stl").faces) == len(mesh.faces)


OTHER_PLY = """ply
format {format} 1.0
comment made by hand
obj_info nothing
element camera 1
property float fov
element vertex 5
property double x
property float y
property uchar red
property float z
element face 2
property uchar flag
property list uchar {index} vertex_index
property list uchar float texcoord
end_header
"""
VERTICES = [(0, 0, 200, 0), (1, 0, 7, 0), (1, 1, 8, 0), (0, 1, 9, 0), (0.5, 2, 9, 0)]
FACES = [(1, (0, 1, 2, 3), (0.5,)), (2, (3, 2, 4), (0.25, 0.75))]


@pytest.mark.parametrize("index", ["int", "uint32", "short"])
@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_foreign_ply(tmp_path, kind, index):
    head = OTHER_PLY.format(format=kind, index=index).encode()
    if kind == "ascii":
        lines = ["60.0"] + [" ".join(map(str, v)) for v in VERTICES]
        lines += [f"{a} {len(b)} {' '.join(map(str, b))} {len(c)} {' '.join(map(str, c))}"
                  for a, b, c in FACES]  # fmt: skip
        body = "\n".join(lines).encode()
    else:
        order = "<" if "little" in kind else ">"
        code = {"int": "i", "uint32": "I", "short": "h"}[index]
        body = struct.pack(order + "f", 60.0)
        body += b"".join(struct.pack(order + "dfBf", *v) for v in VERTICES)
        for flag, corners, texture in FACES:
            body += struct.pack(order + f"BB{len(corners)}{code}", flag, len(corners), *corners)
            body += struct.pack(order + f"B{len(texture)}f", len(texture), *texture)
    mesh = read_surface(write(tmp_path / "a.ply", head + body))
    np.testing.assert_array_equal(mesh.points[:, :2], [v[:2] for v in VERTICES])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [3, 2, 4]])
    for cut in (len(body) // 2, body.rfind(b" ") if kind == "ascii" else len(body) - 2, 5):
        with pytest.raises(InvalidMesh, match="cut off"):
            read_surface(write(tmp_path / "b.ply", head + body[:cut]))


def test_polygons_become_triangles_of_the_same_area(tmp_path):
    # A square, a pentagon whose fan about the first corner would fold, and a U.
    text = """# a comment
v 0 0 0
v 4 0 0
v 4 4 0
v 0 4 0
v 1 2 0
vn 0 0 1
f 1/1/1 2//1 3/2 4
f -5 -4 -3 -2 -1
"""
    mesh = read_surface(write(tmp_path / "a.obj", text))
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    area = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert len(area) == 5 and area.min() > 0 and area.sum() == pytest.approx(16 + 14)
    u = [(1, 1), (0, 1), (0, 0), (3, 0), (3, 3), (2, 3), (2, 1)]
    text = "OFF\n7 1 0\n" + "".join(f"{x} {y} 5\n" for x, y in u) + "7 0 1 2 3 4 5 6 1.0 0 0\n"
    mesh = read_surface(write(tmp_path / "u.off", text))
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    area = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert len(area) == 5 and area.min() > 0 and area.sum() == pytest.approx(5)


BAD = {
    "empty.stl": ("", "empty"),
    "blank.ply": ("  \n", "empty"),
    "words.stl": ("solid nothing\nendsolid", "no faces"),
    "garbage.stl": ("garbage", "no STL"),
    "short.stl": (b"x" * 80 + struct.pack("<I", 3) + b"0" * 60, "announces 3 triangles.* holds 1"),
    "cut.stl": (ASCII_STL[:150], "cut off"),
    "cut2.stl": (ASCII_STL[:70], "three numbers"),
    "garbage.ply": ("garbage", "does not begin with 'ply'"),
    "head.ply": ("ply\nformat ascii 1.0\nelement vertex 3", "end_header"),
    "head2.ply": ("ply\nformat ascii 1.0\nelement vertex many\nend_header\n", "means nothing"),
    "type.ply": ("ply\nelement vertex 1\nproperty complex x\nend_header\n", "means nothing"),
    "format.ply": ("ply\nformat odd 1.0\nend_header\n", "format 'odd' is unknown"),
    "points.ply": (
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
        "no vertices",
    ),
    "cloud.ply": (
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n1 2 3\n",
        "no faces",
    ),
    "negative.ply": ("ply\nformat ascii 1.0\nelement vertex -1\nend_header\n", "negative count"),
    "word.obj": ("v 0 0 zero\n", "line 1 cannot be read"),
    "two.obj": ("v 0 0 0\nv 1 1\n", "line 2 cannot be read"),
    "index.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "1 face corners refer to points"),
    "none.obj": ("v 0 0 0\n", "no faces"),
    "nan.obj": ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "1 of its 3 vertices are NaN"),
    "infinite.off": ("OFF\n3 1 0\n0 0 inf\n1 0 0\n0 1 0\n3 0 1 2\n", "1 of its 3 vertices"),
    "cut.off": ("OFF\n3 1 0\n0 0 0\n1 0 0\n", "cut off"),
    "word.off": ("OFF\n3 1 0\n0 0 a\n1 0 0\n0 1 0\n3 0 1 2\n", "cannot be read"),
    "binary.off": ("OFF BINARY\n123", "binary OFF"),
    "other.off": ("PLY\n", "does not begin with OFF"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_named_with_what_is_wrong(tmp_path, name):
    data, message = BAD[name]
    with pytest.raises(InvalidMesh, match=message) as caught:
        read_surface(write(tmp_path / name, data))
    assert str(tmp_path / name) in str(caught.value)


def test_missing_and_unknown_files(tmp_path):
    with pytest.raises(InvalidCase, match=r"'.step' is unknown; use one of .stl, .ply"):
        read_surface(tmp_path / "a.step")
    with pytest.raises(InvalidCase, match="cannot be read"):
        read_surface(tmp_path / "a.stl")
    with pytest.raises(InvalidCase, match="is unknown"):
        write_surface(tmp_path / "a.step", shapes.cube())
    with pytest.raises(InvalidCase, match="cannot be written"):
        write_surface(tmp_path / "no folder" / "a.stl", shapes.cube())
    with pytest.raises(InvalidCase, match="tetrahedra are written as"):
        write_tets(tmp_path / "a.vtk", bcc_box((0, 0, 0), (1, 1, 1), (1, 1, 1)))


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj", "off"])
def test_any_truncation_is_read_or_refused(tmp_path, suffix):
    """Never another error than InvalidMesh, wherever the file is cut or a byte is changed."""
    path = tmp_path / f"a.{suffix}"
    write_surface(path, labelled())
    data = path.read_bytes()

    @settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[
        HealthCheck.function_scoped_fixture])  # fmt: skip
    @given(st.integers(0, len(data)), st.integers(0, 255), st.booleans())
    def try_to_read(place, byte, cut):
        damaged = data[:place] if cut else data[:place] + bytes([byte]) + data[place + 1 :]
        try:
            mesh = read_surface(write(path, damaged))
        except InvalidMesh as error:
            assert str(error).startswith(str(path)) and "\n" not in str(error)
        else:
            assert np.isfinite(mesh.points).all() and len(mesh.faces)

    try_to_read()


def test_a_failed_write_leaves_the_old_file_alone(tmp_path, monkeypatch):
    path = tmp_path / "a.stl"
    write_surface(path, shapes.cube())
    before = path.read_bytes()

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(InvalidCase, match="No space left"):
        write_surface(path, shapes.icosphere(2))
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["a.stl"]


def box():
    mesh = bcc_box((0, 0, 0), (1, 2, 3), (2, 3, 2))
    mesh = mesh.with_sets(
        {"load:deck": [3, 1, 2], "support:foot": []},
        {"support:foot": [5, 6]},
        (SymmetryPlane(0, 0.1), SymmetryPlane(2)),
    )
    smooth = (*mesh.patches[:-1], Patch("skin \u00e9"))
    return type(mesh)(
        mesh.points, mesh.tets, mesh.facets, mesh.facet_patch, smooth,
        mesh.facet_sets, mesh.node_sets, mesh.symmetry,
    )  # fmt: skip


def test_tets_and_fields_come_back_exactly(tmp_path):
    mesh = box()
    phase = PhaseField(mesh, np.linspace(0, 1, len(mesh.points)) ** 3)
    save_tet_mesh(tmp_path / "m.npz", mesh)
    save_phase_field(tmp_path / "p.npz", phase)
    again = load_phase_field(tmp_path / "p.npz")
    np.testing.assert_array_equal(again.values, phase.values)
    for back in (load_tet_mesh(tmp_path / "m.npz"), again.mesh):
        for name in ("points", "tets", "facets", "facet_patch"):
            np.testing.assert_array_equal(getattr(back, name), getattr(mesh, name))
        assert back.patches == mesh.patches and back.symmetry == mesh.symmetry
        for group in ("facet_sets", "node_sets"):
            ours, theirs = getattr(mesh, group), getattr(back, group)
            assert list(ours) == list(theirs)
            for key in ours:
                np.testing.assert_array_equal(ours[key], theirs[key])
    save_phase_field(tmp_path / "q.npz", again)
    assert (tmp_path / "q.npz").read_bytes() == (tmp_path / "p.npz").read_bytes()


def test_damaged_archives_are_refused(tmp_path):
    save_tet_mesh(tmp_path / "m.npz", box())
    with pytest.raises(InvalidMesh, match="no phase field on it"):
        load_phase_field(tmp_path / "m.npz")
    data = (tmp_path / "m.npz").read_bytes()
    for damaged in (data[: len(data) // 2], b"", b"nonsense", data[:600] + b"zz" + data[602:]):
        with pytest.raises(InvalidMesh, match=r"x\.npz: "):
            load_tet_mesh(write(tmp_path / "x.npz", damaged))
    with pytest.raises(InvalidMesh, match=r"missing\.npz"):
        load_tet_mesh(tmp_path / "missing.npz")
    np.savez(tmp_path / "other.npz", points=np.zeros((3, 3)))
    with pytest.raises(InvalidMesh, match="no tetrahedral mesh of this program"):
        load_tet_mesh(tmp_path / "other.npz")


def test_vtu_and_series(tmp_path):
    mesh = box()
    path = tmp_path / "fields" / "step 1.vtu"
    path.parent.mkdir()
    fields = {"phi": mesh.points[:, 0], "displacement": 2 * mesh.points}
    write_tets(path, mesh, fields, {"energy": np.arange(len(mesh.tets))})
    back = meshio.read(path)
    np.testing.assert_array_equal(back.points, mesh.points)
    np.testing.assert_array_equal(back.cells_dict["tetra"], mesh.tets)
    np.testing.assert_array_equal(back.point_data["displacement"], 2 * mesh.points)
    np.testing.assert_array_equal(back.cell_data["energy"][0], np.arange(len(mesh.tets)))
    first = path.read_bytes()
    write_tets(path, mesh, fields, {"energy": np.arange(len(mesh.tets))})
    assert path.read_bytes() == first
    write_tets(path, box(), {"phi": -mesh.points[:, 0]})  # another mesh of the same look
    np.testing.assert_array_equal(meshio.read(path).point_data["phi"], -mesh.points[:, 0])
    path.write_bytes(first)
    write_series(tmp_path / "all.pvd", [path, path], times=[0, 2.5])
    text = (tmp_path / "all.pvd").read_text()
    assert text.count('file="fields/step 1.vtu"') == 2 and 'timestep="2.5"' in text
    pyvista = pytest.importorskip("pyvista")
    reader = pyvista.get_reader(str(tmp_path / "all.pvd"))
    assert reader.time_values == [0.0, 2.5]
    reader.set_active_time_value(2.5)
    assert reader.read()[0].n_cells == len(mesh.tets)
