"""URDFs as they are found: in folders and packages, with other meshes, without inertia, with more than one root."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.hand.model import hand_of_file
from pipeline.hand.standard import standard_urdf
from pipeline.hand.urdf import frame_matrix, rpy_of
from pipeline.records.errors import UserError
from tests.hand.toy import urdf_text, write_toy

BALL = '<sphere radius="0.008"/>'
COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
  <library_geometries><geometry id="g"><mesh>
    <source id="p"><float_array id="a" count="12">0 0 0 0.02 0 0 0 0.02 0 0 0 0.02</float_array>
      <technique_common><accessor source="#a" count="4" stride="3">
        <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
      </accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/>
      <p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene>
  </library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""


def with_tip(shape: str) -> str:
    text = urdf_text()
    assert BALL in text
    return text.replace(BALL, shape, 1)


def tetrahedron() -> trimesh.Trimesh:
    corners = 0.02 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    return trimesh.Trimesh(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@pytest.mark.parametrize("ending", ["obj", "stl", "glb", "dae", "ascii.stl"])
def test_meshes_of_all_kinds_become_what_every_loader_reads(tmp_path: Path, ending: str) -> None:
    file = tmp_path / f"tip.{ending}"
    if ending == "dae":
        file.write_text(COLLADA)
    elif ending == "ascii.stl":
        file.write_text(trimesh.exchange.stl.export_stl_ascii(tetrahedron()))
    else:
        tetrahedron().export(file)
    hand = hand_of_file(write_toy(tmp_path / "toy", {"contacts": {}}, with_tip(f'<mesh filename="../{file.name}"/>')))
    mesh = ElementTree.fromstring(hand.standard_urdf).find("link/collision/geometry/mesh")
    loaded = trimesh.load_mesh(mesh.get("filename"))
    assert Path(mesh.get("filename")).suffix in (".obj", ".stl")
    np.testing.assert_allclose(loaded.convex_hull.volume, 0.02**3 / 6, rtol=1e-5)
    assert "left_tip" in hand.shape_fits


def test_meshes_of_a_package_are_found_beside_or_above_the_urdf(tmp_path: Path) -> None:
    (tmp_path / "my_hand" / "meshes").mkdir(parents=True)
    tetrahedron().export(tmp_path / "my_hand" / "meshes" / "tip.stl")
    named = with_tip('<mesh filename="package://my_hand/meshes/tip.stl"/>')
    hand = hand_of_file(write_toy(tmp_path / "my_hand" / "urdf", {"contacts": {}}, named))
    assert str(tmp_path / "my_hand" / "meshes" / "tip.stl") in hand.standard_urdf
    missing = with_tip('<mesh filename="package://my_hand/meshes/palm.stl"/>')
    with pytest.raises(UserError, match="there is no mesh package://my_hand/meshes/palm.stl in the folder"):
        hand_of_file(write_toy(tmp_path / "my_hand" / "broken", {"contacts": {}}, missing))


def test_a_folder_with_one_urdf_is_enough(tmp_path: Path) -> None:
    folder = tmp_path / "toy"
    hand = hand_of_file(write_toy(folder, {"urdf": {"path": "."}}))
    assert hand.urdf.name == "toy.urdf"
    (folder / "second.urdf").write_text(urdf_text())
    with pytest.raises(UserError, match="has second.urdf, toy.urdf; name one URDF or MJCF under `urdf` there"):
        hand_of_file(write_toy(tmp_path / "other", {"urdf": {"path": str(folder)}}))


def test_missing_inertia_follows_from_the_shapes(tmp_path: Path) -> None:
    file = tmp_path / "box.urdf"
    file.write_text(
        '<robot name="r"><link name="a"><collision><origin xyz="1 0 0"/><geometry><box size="0.1 0.2 0.3"/></geometry>'
        '</collision></link><link name="b"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/>'
        '<limit lower="0" upper="1"/></joint></robot>'
    )
    link, bare = standard_urdf(file, None, 500.0).findall("link")
    mass = 500.0 * 0.1 * 0.2 * 0.3
    assert float(link.find("inertial/mass").get("value")) == pytest.approx(mass)
    assert float(link.find("inertial/origin").get("xyz").split()[0]) == pytest.approx(1.0)
    found = {name: float(value) for name, value in link.find("inertial/inertia").attrib.items()}
    assert found["ixx"] == pytest.approx(mass / 12 * (0.2**2 + 0.3**2))
    assert found["izz"] == pytest.approx(mass / 12 * (0.1**2 + 0.2**2)) and found["ixy"] == pytest.approx(0, abs=1e-12)
    assert float(bare.find("inertial/mass").get("value")) > 0  # engines refuse what moves without mass


def test_several_roots_ask_for_one_and_a_floating_root_is_left_out(tmp_path: Path) -> None:
    two = urdf_text().replace("</robot>", '<link name="table"/></robot>')
    with pytest.raises(UserError, match=r"has 2 root links \(plate, table\), .* `urdf.root`"):
        hand_of_file(write_toy(tmp_path / "two", urdf=two))
    hand = hand_of_file(write_toy(tmp_path / "named", {"urdf": {"path": "toy.urdf", "root": "plate"}}, two))
    assert hand.root == "plate"
    with pytest.raises(UserError, match="has no link 'palm'; correct `urdf.root`"):
        hand_of_file(write_toy(tmp_path / "wrong", {"urdf": {"path": "toy.urdf", "root": "palm"}}, two))
    floating = urdf_text().replace(
        "</robot>",
        '<link name="space"/><joint name="free" type="floating"><parent link="space"/><child link="plate"/></joint>'
        "</robot>",
    )
    assert hand_of_file(write_toy(tmp_path / "floating", urdf=floating)).root == "plate"


def test_angles_of_rotations_give_them_back() -> None:
    rng = np.random.default_rng(0)
    for rpy in [*rng.uniform(-np.pi, np.pi, (20, 3)), [0.3, np.pi / 2, 0.7], [0.3, -np.pi / 2, 0.7]]:
        R = frame_matrix([0, 0, 0], rpy)[:3, :3]
        np.testing.assert_allclose(frame_matrix([0, 0, 0], rpy_of(R))[:3, :3], R, atol=1e-12)
