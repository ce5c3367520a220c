"""Files that people have, beside those of well-kept programs: the folder faults/mesh-formats."""

import base64
import io
import json
import struct
import zipfile

import DracoPy
import numpy as np
import pytest
import trimesh

from pipeline.prepare.sources import load_triangles, raw_mesh
from pipeline.records.errors import UserError
from pipeline.records.geometry import read_geometry, read_geometry_file
from pipeline.records.gltf import joined, split
from pipeline.records.packages import files_beside, shape_in, unit_in, up_axis
from pipeline.records.parameters.objects import MeshParameters
from pipeline.records.polygons import cut

BOX = (0.04, 0.12, 0.06)
VOLUME = 0.04 * 0.12 * 0.06


def box():
    return trimesh.creation.box(BOX)


def volume(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume


def glb(**changes):
    """A box as GLB whose header is changed."""
    header, binary = split(box().export(file_type="glb"))
    return joined(header | changes, binary)


# Concave outlines, counter-clockwise, with their areas.
OUTLINES = {
    "l": ([(0, 0), (20, 0), (20, 40), (60, 40), (60, 60), (0, 60)], 60 * 60 - 40 * 40),
    "u": ([(0, 0), (60, 0), (60, 50), (45, 50), (45, 15), (15, 15), (15, 50), (0, 50)], 60 * 50 - 30 * 35),
    "arrow": ([(0, 0), (30, 10), (0, 20), (10, 10)], 200),  # 300 of the triangle less 100
}


def prism(outline, height=30.0):
    """Vertices and polygons of an upright prism."""
    points, count = np.array(outline, float), len(outline)
    vertices = np.concatenate([np.column_stack([points, np.full(count, z)]) for z in (0.0, height)])
    sides = [[i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
    return vertices, [list(reversed(range(count))), list(range(count, 2 * count)), *sides]


def as_off(vertices, polygons, head="OFF"):
    rows = [head, f"{len(vertices)} {len(polygons)} 0", "# a remark"]
    rows += [" ".join(f"{value:f}" for value in vertex) for vertex in vertices]
    rows += [" ".join(map(str, [len(polygon), *polygon, 200, 30, 30])) for polygon in polygons]
    return "\n".join(rows).encode()


def as_obj(vertices, polygons, relative=False):
    rows = ["v " + " ".join(f"{value:f}" for value in vertex) for vertex in vertices]
    for polygon in polygons:
        corners = [corner - len(vertices) if relative else corner + 1 for corner in polygon]
        rows.append("f " + " ".join(f"{corner}//1" for corner in corners))
    return "\n".join(rows).encode()


@pytest.mark.parametrize("name", OUTLINES)
@pytest.mark.parametrize("kind", ["off", "obj", "relative"])
def test_concave_polygons_are_cut_within_their_outline(name, kind):
    outline, area = OUTLINES[name]
    vertices, polygons = prism(outline)
    content = as_off(vertices, polygons) if kind == "off" else as_obj(vertices, polygons, kind == "relative")
    mesh = read_geometry(content, "off" if kind == "off" else "obj")
    assert mesh.is_watertight and volume(mesh) == pytest.approx(30 * area)
    flat = np.abs(mesh.face_normals[:, 2]) > 0.5
    assert mesh.area_faces[flat].sum() == pytest.approx(2 * area), "triangles lie outside of the outline"


def test_a_cut_polygon_keeps_its_direction_in_any_plane():
    outline, area = OUTLINES["u"]
    points = np.column_stack([np.array(outline, float), np.zeros(len(outline))])
    for turn in trimesh.transformations.random_rotation_matrix(), np.diag([1.0, -1, -1, 1]):
        vertices = points @ turn[:3, :3].T
        faces = np.array(cut(vertices, range(len(outline))))
        normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
        np.testing.assert_allclose(normals.sum(axis=0) / 2, area * turn[:3, 2], atol=1e-6)
        assert np.linalg.norm(normals, axis=1).sum() / 2 == pytest.approx(area)


@pytest.mark.parametrize(
    ("change", "count"),
    [
        (lambda content: content + b"written by a scanner" * 9, 12),
        (lambda content: content[:80] + struct.pack("<I", 0) + content[84:], 12),
        (lambda content: b"solid " + content[6:], 12),
    ],
    ids=["trailing", "count zero", "solid"],
)
def test_stl_whose_header_and_body_disagree(change, count):
    mesh = read_geometry(change(box().export(file_type="stl")), "stl")
    assert len(mesh.faces) == count and volume(mesh) == pytest.approx(VOLUME, rel=1e-6)


@pytest.mark.parametrize(
    ("content", "kind", "sentence"),
    [
        (box().export(file_type="stl")[:-60], "stl", "cut off: it announces 12 triangles and holds 10"),
        (b"\0" * 84, "stl", "holds no triangle"),
        (glb(extensionsRequired=["EXT_meshopt_compression"]), "glb", "requires the extension EXT_meshopt_compression"),
        (as_off(*prism(OUTLINES["l"][0]))[:-60], "off", "ends before all|fewer corners"),
        (as_off(*prism(OUTLINES["l"][0]), head="4OFF"), "off", "other than three dimensions"),
    ],
)
def test_what_is_not_read_is_named_by_its_reason(tmp_path, content, kind, sentence):
    path = tmp_path / f"thing.{kind}"
    path.write_bytes(content)
    with pytest.raises(UserError, match=f"^meshes.thing: .*{sentence}.*; export the shape again"):
        load_triangles(path, "meshes.thing")


def with_morph_target():
    header, binary = split(box().export(file_type="glb"))
    header["accessors"].append({"componentType": 5126, "count": 8, "type": "VEC3"})
    header["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": len(header["accessors"]) - 1}]
    return joined(header, binary)


def with_draco():
    encoded = DracoPy.encode(np.asarray(box().vertices, np.float32), np.asarray(box().faces, np.uint32))
    encoded += b"\0" * (-len(encoded) % 4)
    extension = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "extensions": extension}]}],
        "accessors": [
            {"componentType": 5126, "count": 8, "type": "VEC3"},
            {"componentType": 5125, "count": 36, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": len(encoded)}],
        "buffers": [{"byteLength": len(encoded)}],
        "extensionsRequired": ["KHR_draco_mesh_compression"],
    }
    return joined(header, encoded)


@pytest.mark.parametrize("content", [with_morph_target(), with_draco()], ids=["morph target", "draco"])
def test_glb_with_more_than_triangles(content):
    mesh = read_geometry(content, "glb")
    np.testing.assert_allclose(mesh.extents, BOX, atol=1e-3 * max(BOX))
    assert volume(mesh) == pytest.approx(VOLUME, rel=1e-2)


def test_draco_that_is_none_says_so():
    header, binary = split(with_draco())
    with pytest.raises(ValueError, match="compressed with Draco and cannot be unpacked"):
        read_geometry(joined(header, b"\1" * len(binary)), "glb")


def write_gltf(folder, uri=None):
    header, binary = split(glb())
    (folder / "thing data.bin").write_bytes(binary)
    inline = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    header["buffers"] = [{"byteLength": len(binary), "uri": inline if uri == "data" else uri or "thing%20data.bin"}]
    path = folder / "thing.gltf"
    path.write_text(json.dumps(header))
    return path


@pytest.mark.parametrize("uri", [None, "data"])
def test_gltf_with_its_numbers_beside_or_in_it(tmp_path, uri):
    path = write_gltf(tmp_path, uri)
    assert volume(read_geometry_file(path)) == pytest.approx(VOLUME, rel=1e-6)
    assert files_beside(path) == ([] if uri else [tmp_path / "thing data.bin"])
    assert shape_in(path).kind == "glb"


@pytest.mark.parametrize("uri", ["../secret.bin", "/etc/passwd", "https://example.org/a.bin", "absent.bin", ".."])
def test_gltf_reaches_no_other_place(tmp_path, uri):
    folder = tmp_path / "in"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(b"0" * 1000)
    with pytest.raises(UserError, match="beside it"):
        load_triangles(write_gltf(folder, uri), "meshes.thing")


def test_gltf_follows_no_link(tmp_path):
    path = write_gltf(tmp_path, "link.bin")
    (tmp_path / "link.bin").symlink_to(tmp_path / "thing data.bin")
    with pytest.raises(ValueError, match="no file that can be read"):
        read_geometry_file(path)


def zipped(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def test_zip_of_one_mesh(tmp_path):
    members = {"box/thing.stl": box().export(file_type="stl"), "box/licence.txt": "MIT", "__MACOSX/._thing.stl": "x"}
    path = zipped(tmp_path / "thing.zip", members)
    assert volume(read_geometry_file(path)) == pytest.approx(VOLUME, rel=1e-6)
    write_gltf(tmp_path)
    beside = {f"a/{name}": (tmp_path / name).read_bytes() for name in ("thing.gltf", "thing data.bin")}
    assert volume(read_geometry_file(zipped(tmp_path / "gltf.zip", beside))) == pytest.approx(VOLUME, rel=1e-6)


@pytest.mark.parametrize(
    ("members", "sentence"),
    [
        ({}, "holds 0 meshes"),
        ({"a.stl": b"", "b.obj": b""}, r"holds 2 meshes \(a.stl, b.obj\): unpack it and name one"),
        ({"a.stl": b"\0" * (2**30 + 10)}, "unpacks to more than 1024 MB"),
    ],
    ids=["none", "two", "bomb"],
)
def test_zip_of_anything_else(tmp_path, members, sentence):
    with pytest.raises(UserError, match=sentence):
        load_triangles(zipped(tmp_path / "thing.zip", members), "meshes.thing")


def threemf(unit="millimeter", before=""):
    vertices = "".join(f'<vertex x="{x:f}" y="{y:f}" z="{z:f}"/>' for x, y, z in 1000 * box().vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in box().faces)
    model = (
        f'<?xml version="1.0"?>{before}<model unit="{unit}" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        '<object id="1" type="model"><mesh>'
        f"<vertices>{vertices}</vertices><triangles>{faces}</triangles></mesh></object></resources>"
        '<build><item objectid="1"/></build></model>'
    )
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("3D/3dmodel.model", model)
    return target.getvalue()


def collada(up="Z_UP", before=""):
    points = " ".join(f"{value:f}" for value in 100 * box().vertices.ravel())
    corners = " ".join(map(str, box().faces.ravel()))
    return (
        f'<?xml version="1.0"?>{before}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f'<asset><unit name="centimeter" meter="0.01"/><up_axis>{up}</up_axis></asset><library_geometries>'
        f'<geometry id="g"><mesh><source id="p"><float_array id="a" count="24">{points}</float_array><technique_common>'
        '<accessor source="#a" count="8" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>'
        '<param name="Z" type="float"/></accessor></technique_common></source><vertices id="v"><input '
        'semantic="POSITION" source="#p"/></vertices><triangles count="12"><input semantic="VERTEX" source="#v" '
        f'offset="0"/><p>{corners}</p></triangles></mesh></geometry></library_geometries><library_visual_scenes>'
        '<visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    ).encode()


@pytest.mark.parametrize(
    ("kind", "content", "longest", "unit", "up"),
    [
        ("3mf", threemf(), 120, 1e-3, "+z"),
        ("3mf", threemf("inch"), 120, 0.0254, "+z"),
        ("dae", collada(), 12, 0.01, "+z"),
        ("dae", collada("Y_UP"), 12, 0.01, "+y"),
        ("glb", glb(), 0.12, None, "+y"),
        ("stl", box().export(file_type="stl"), 0.12, None, "+z"),
    ],
)
def test_units_and_up_axes_of_formats(tmp_path, kind, content, longest, unit, up):
    path = tmp_path / f"thing.{kind}"
    path.write_bytes(content)
    shape = shape_in(path)
    assert read_geometry_file(path).extents.max() == pytest.approx(longest, rel=1e-5)
    assert unit_in(shape) == unit and up_axis(shape) == up
    raw = raw_mesh(MeshParameters(file="data/raw/thing", scale=0.1), "thing", read_from=path)
    assert raw.up == up and np.ptp(raw.vertices, axis=0).max() == pytest.approx(0.1 * longest * (unit or 1), rel=1e-5)


@pytest.mark.parametrize("make", [threemf, collada])
def test_entities_are_not_expanded(tmp_path, make):
    bomb = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    with pytest.raises(ValueError, match="defines entities"):
        read_geometry(make(before=bomb), "3mf" if make is threemf else "dae")


def test_a_point_cloud_is_called_one(tmp_path):
    path = tmp_path / "cloud.ply"
    path.write_bytes(trimesh.PointCloud(np.random.default_rng(0).random((50, 3))).export(file_type="ply"))
    with pytest.raises(UserError, match=r"is a point cloud \(50 points, no triangles\); .*dev sample --object0"):
        load_triangles(path, "meshes.thing")
