"""Values at vertices: carried over by closest points, and through files."""

import itertools

import numpy as np
import pytest
import pyvista
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

from meshes import InvalidMesh, Patch, TriMesh
from meshes.attributes import interpolate
from meshes.face_labels import is_label_name, numbered_labels
from meshes.io import read_surface, read_surface_data, write_surface
from tests.shapes import cube, icosphere


def linear(points):
    return points @ [1.0, -2.0, 3.0] + 4.0


def on_cube(count, rng):
    points = rng.random((count, 3))
    side = rng.integers(0, 3, count)
    points[np.arange(count), side] = rng.integers(0, 2, count)
    return points


def test_a_linear_field_on_plane_faces_is_exact():
    mesh, rng = cube(), np.random.default_rng(0)
    points = on_cube(500, rng)
    data = {"t": linear(mesh.points), "v": np.outer(linear(mesh.points), [1, 2])}
    carried = interpolate(mesh, data, points)
    assert carried["t"] == pytest.approx(linear(points), abs=1e-12)
    assert carried["v"] == pytest.approx(np.outer(linear(points), [1, 2]), abs=1e-12)


def test_a_linear_field_on_spheres_converges_with_order_two():
    """The closest point of the flat triangles lies off the sphere by at most h^2 / 8."""
    points = np.random.default_rng(0).standard_normal((20000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    errors = []
    for level in (1, 2, 3):
        mesh = icosphere(level)
        carried = interpolate(mesh, {"t": linear(mesh.points)}, points)["t"]
        errors.append(np.abs(carried - linear(points)).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx([2.0, 2.0], abs=0.15) and errors[-1] < 0.02


def test_types_are_kept_each_in_its_way():
    mesh = TriMesh([[0, 0, 0], [4, 0, 0], [0, 4, 0]], [[0, 1, 2]])
    data = {
        "red": np.array([0, 100, 200], np.uint8),
        "id": np.array([7, 8, 9]),
        "t": np.array([0, 1, 2], np.float32),
        "n": np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]),
        "gap": np.array([1.0, np.nan, 3.0]),
    }
    found = interpolate(mesh, data, np.array([[1.0, 0, 0], [0.0, 3.0, 0.0]]))
    assert found["red"].tolist() == [25, 150] and found["red"].dtype == np.uint8
    assert found["id"].tolist() == [7, 9] and found["t"].dtype == np.float32
    assert np.linalg.norm(found["n"], axis=1) == pytest.approx([1.0, 1.0])
    assert np.isnan(found["gap"][0]) and interpolate(mesh, {}, mesh.points) == {}


def test_along_a_seam_each_side_keeps_its_own():
    """Doubled vertices (as for textures) with other values on the other side."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0],
                       [2, 0, 0], [2, 1, 0]], float)  # fmt: skip
    mesh = TriMesh(points, [[0, 1, 2], [0, 2, 3], [4, 6, 7], [4, 7, 5]])
    values = np.array([0, 0, 0, 0, 5, 5, 5, 5.0])
    found = interpolate(mesh, {"u": values}, np.array([[0.999, 0.5, 0], [1.001, 0.5, 0]]))
    assert found["u"].tolist() == [0.0, 5.0]


def data_of(mesh):
    return {
        "temperature": linear(mesh.points).astype(np.float32),
        "velocity": np.outer(linear(mesh.points), [1.0, 2.0, 3.0]),
        "Normals": mesh.points / np.linalg.norm(mesh.points, axis=1)[:, None],
        "number": np.arange(len(mesh.points), dtype=np.int32),
        "red": (np.arange(len(mesh.points)) % 256).astype(np.uint8),
    }


@pytest.mark.parametrize("suffix", ["ply", "vtp"])
def test_files_bring_values_and_labels_back(tmp_path, suffix):
    sphere = icosphere(2)
    labels = tuple(Patch(str(k)) for k in range(3))
    mesh = TriMesh(sphere.points, sphere.faces, np.arange(len(sphere.faces)) // 107, labels)
    write_surface(tmp_path / f"a.{suffix}", mesh, point_data=data_of(mesh))
    back, data = read_surface_data(tmp_path / f"a.{suffix}")
    np.testing.assert_array_equal(back.points, mesh.points)
    np.testing.assert_array_equal(back.face_labels, mesh.face_labels)
    assert back.labels == labels and data.keys() == data_of(mesh).keys()
    for name, values in data_of(mesh).items():
        np.testing.assert_array_equal(data[name], values)
        assert data[name].dtype == values.dtype
    theirs = pyvista.read(tmp_path / f"a.{suffix}")
    np.testing.assert_allclose(theirs.points, mesh.points, atol=1e-7)
    if suffix == "vtp":
        np.testing.assert_array_equal(theirs.cell_data["label"], mesh.face_labels)
        np.testing.assert_array_equal(theirs.point_data["velocity"], data["velocity"])
    again = tmp_path / f"b.{suffix}"
    write_surface(again, back, point_data=data)
    assert again.read_bytes() == (tmp_path / f"a.{suffix}").read_bytes()


def theirs():
    """A surface of VTK's with values, and cut into strips."""
    sphere = pyvista.Sphere(theta_resolution=12, phi_resolution=12)
    sphere.point_data["t"] = linear(sphere.points)
    sphere.point_data["v"] = np.asarray(sphere.points, np.float64)
    sphere.cell_data["RegionId"] = np.arange(sphere.n_cells) // 100
    return sphere


def write_theirs(path, mesh, mode=2, compressor="ZLib", encoded=1, header=32, order=1):
    writer = vtkXMLPolyDataWriter()
    writer.SetInputData(mesh)
    writer.SetDataMode(mode)  # words, base64 inline, appended
    writer.SetEncodeAppendedData(encoded)
    writer.SetHeaderType(header)
    writer.SetByteOrder(order)
    writer.SetBlockSize(512)
    getattr(writer, f"SetCompressorTypeTo{compressor}")()
    writer.SetFileName(str(path))
    writer.Write()


def test_vtp_as_vtk_writes_it(tmp_path):
    sphere = theirs()
    path = tmp_path / "a.vtp"
    for how in itertools.product((0, 1, 2), ("None", "ZLib", "LZMA"), (0, 1), (32, 64), (0, 1)):
        write_theirs(path, sphere, *how)
        mesh, data = read_surface_data(path)
        np.testing.assert_array_equal(mesh.faces, sphere.regular_faces)
        np.testing.assert_array_equal(mesh.face_labels, sphere.cell_data["RegionId"])
        np.testing.assert_allclose(mesh.points, sphere.points, atol=1e-6)
        np.testing.assert_allclose(data["t"], sphere.point_data["t"], rtol=1e-6)
        np.testing.assert_allclose(data["v"], sphere.point_data["v"], atol=1e-6)
    write_theirs(path, sphere.strip())
    triangles = {frozenset(face) for face in read_surface(path).faces.tolist()}
    assert triangles == {frozenset(face) for face in sphere.regular_faces.tolist()}


def test_damaged_vtp_is_refused_in_one_sentence(tmp_path):
    path, cut = tmp_path / "a.vtp", tmp_path / "b.vtp"
    contents = []
    for mode, compressor, encoded in ((0, "ZLib", 1), (1, "None", 1), (2, "ZLib", 0)):
        write_theirs(path, theirs(), mode, compressor, encoded)
        contents.append(path.read_bytes())

    @settings(max_examples=150, deadline=None, derandomize=True, suppress_health_check=[
        HealthCheck.function_scoped_fixture])  # fmt: skip
    @given(st.sampled_from(contents), st.floats(0, 1), st.integers(0, 255), st.booleans())
    def try_to_read(data, share, byte, shorten):
        place = int(share * (len(data) - 1))
        damaged = data[:place] + (b"" if shorten else bytes([byte]) + data[place + 1 :])
        cut.write_bytes(damaged)
        try:
            mesh = read_surface(cut)
        except InvalidMesh as error:
            assert str(error).startswith(str(cut)) and "\n" not in str(error)
        else:
            assert np.isfinite(mesh.points).all() and len(mesh.faces)

    try_to_read()
    for words in (b"<VTKFile type='ImageData'/>", b"<VTKFile type='PolyData'/>", b"PLY"):
        cut.write_bytes(words)
        with pytest.raises(InvalidMesh, match=r"VTKFile|Piece|no VTP"):
            read_surface(cut)


FOREIGN_PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property float quality
property uchar red
element face 4
property list uchar int vertex_indices
property int material_index
end_header
0 0 0 0.5 1
1 0 0 1.5 2
0 1 0 2.5 3
0 0 1 3.5 255
3 0 2 1 7
3 0 1 3 7
3 1 2 3 2
3 0 3 2 2
"""


def test_labels_and_values_of_others(tmp_path):
    (tmp_path / "a.ply").write_text(FOREIGN_PLY)
    mesh, data = read_surface_data(tmp_path / "a.ply")
    assert mesh.face_labels.tolist() == [7, 7, 2, 2] and mesh.labels[7] == Patch("7")
    assert data["quality"].tolist() == [0.5, 1.5, 2.5, 3.5]
    assert data["red"].dtype == np.uint8 and data["red"].tolist() == [1, 2, 3, 255]
    for text in ("usemtl {}", "g {}", "o {}"):
        lines = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", text.format("stone")]
        lines += ["f 1 3 2", "f 1 2 4", text.format("wood"), "f 2 3 4", "f 1 4 3"]
        (tmp_path / "a.obj").write_text("\n".join(lines))
        mesh = read_surface(tmp_path / "a.obj")
        names = [mesh.labels[k].name for k in mesh.face_labels]
        assert names == ["stone", "stone", "wood", "wood"]
        write_surface(tmp_path / "b.obj", mesh)
        back = read_surface(tmp_path / "b.obj")
        assert [back.labels[k].name for k in back.face_labels] == names
    triangle = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex {1} 0 0\nvertex {0} 1 0\n"
    triangle += "endloop\nendfacet\n"
    solids = [f"solid {n}\n{triangle.format(k, k + 1)}endsolid {n}\n"
              for k, n in enumerate(("left part", "right part"))]  # fmt: skip
    (tmp_path / "a.stl").write_text("".join(solids))
    mesh = read_surface(tmp_path / "a.stl")
    assert [p.name for p in mesh.labels] == ["left part", "right part"]
    assert mesh.face_labels.tolist() == [0, 1]


def test_what_is_a_label_and_what_is_not():
    yes = ["label", "Labels", "RegionId", "material_index", "face_label", "PartID", "cell region"]
    assert [name for name in yes if not is_label_name(name)] == []
    assert not any(is_label_name(name) for name in ("temperature", "red", "quality", "flags", ""))
    assert numbered_labels(np.arange(5000)) is None  # the number of each face
    assert numbered_labels(np.zeros(9)) is None and numbered_labels([0.5, 1.5, 1.5]) is None
    labels, index = numbered_labels(np.array([10**9, -1, -1, 10**9, 5, 5]))
    assert [labels[k].name for k in index] == ["1000000000", "-1", "-1", "1000000000", "5", "5"]
