"""Objects that come from packages: prepared or refused by themselves, and grasped in the styles that fit them."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from pipeline.prepare.__main__ import prepare
from pipeline.prepare.graspable import Size, fitting_styles
from pipeline.prepare.preparation import prepare_object
from pipeline.prepare.resting import poses, resting_ups, upright
from pipeline.records.catalogue import read_catalogue
from pipeline.records.errors import UserError
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.parameters.objects import MeshParameters
from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.records.paths import CATALOGUE_FILE

COARSE = {"distance_cells": 32, "surface_points": 2048}
BOX = (0.05, 0.06, 0.08)  # rests likeliest on the largest face: 50 mm high


def written(folder: Path, mesh: trimesh.Trimesh, name: str) -> Path:
    path = folder / f"{name}.stl"
    path.write_bytes(mesh.export(file_type="stl"))
    return path


@pytest.fixture
def project(repository, empty_folder):
    """Parameters with one source, whose meshes are there: a box, an empty file, and a sheet."""
    content = yaml.safe_load((repository / "params.yaml").read_text())
    content["prepare"] |= COARSE
    content["assets"] = {
        "things": {"package": "things==1.0", "files": ["*"], "licence": "MIT", "up": "auto", "poses": 2, "unit": "m"}
    }
    (empty_folder / "params.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    folder = empty_folder / "data/assets/things"
    folder.mkdir(parents=True)
    meshes = {
        "box": trimesh.creation.box(BOX),
        "nothing": trimesh.Trimesh(),
        "sheet": trimesh.Trimesh([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0]], [[0, 1, 2]]),
    }
    objects = {}
    for name, mesh in meshes.items():
        written(folder, mesh, f"things_{name}")
        objects[f"things_{name}"] = {"file": f"things_{name}.stl", "path": f"{name}.stl"}
    (folder / "source.json").write_text(json.dumps({"objects": objects}))
    return empty_folder


@pytest.mark.slow
def test_every_object_of_a_package_ends_in_the_catalogue(project):
    for name in ("things_box", "things_box_pose2", "things_nothing", "things_sheet"):
        prepare(name)
    rows = {row["name"]: row for row in read_catalogue(CATALOGUE_FILE)}
    assert {name: row["outcome"] for name, row in rows.items()} == {
        "things_box": "prepared",
        "things_box_pose2": "prepared",
        "things_nothing": "refused",
        "things_sheet": "refused",
    }
    lying, turned = rows["things_box"], rows["things_box_pose2"]
    assert [float(lying[name]) for name in ("width_mm", "depth_mm", "height_mm")] == pytest.approx([60, 80, 50])
    assert float(turned["height_mm"]) == pytest.approx(50)  # the other face of the same size
    assert float(lying["pose_probability"]) == pytest.approx(float(turned["pose_probability"]), abs=1e-3)
    assert "holds no triangle mesh" in rows["things_nothing"]["reason"] and "sheet" in rows["things_sheet"]["reason"]
    assert not (project / "data/prepare/things_nothing/mesh.ply").exists()


@pytest.mark.slow
def test_objects_of_packages_join_the_styles_that_fit_them(project):
    with pytest.raises(UserError, match="run `dvc repro prepare`"):
        load_parameters(["styles"])
    for name in ("things_box", "things_nothing"):
        prepare(name)
    named = read_parameters().styles
    styles = load_parameters(["styles"])["styles"]
    assert styles.pinch == [*named.pinch, "things_box"] and styles.side == [*named.side, "things_box"]
    assert load_parameters(["styles.side"])["styles.side"] == styles.side
    assert "things_nothing" not in {name for pair in read_parameters().with_assets().sequences() for name in pair}


def test_a_damaged_catalogue_is_refused(project):
    CATALOGUE_FILE.parent.mkdir(parents=True)
    CATALOGUE_FILE.write_text("name,source\nthings_box,things\n")
    with pytest.raises(UserError, match="damaged"):
        load_parameters(["styles"])


def heights(mesh: trimesh.Trimesh, most: int) -> list[float]:
    return [float(np.ptp(mesh.vertices @ R[2])) for R, _ in poses(np.asarray(mesh.vertices), most)]


def test_a_cylinder_stands_on_its_end_and_never_rolls():
    # It comes to rest on its side in 93 of 100 throws, but rolls there.
    cylinder = trimesh.creation.cylinder(radius=0.02, height=0.1, sections=64)
    cylinder.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3]))
    np.testing.assert_allclose(heights(cylinder, 3), [0.1, 0.1, 0.04], atol=1e-4)


def test_a_box_stands_on_its_largest_faces_first():
    found = heights(trimesh.creation.box(BOX), 7)
    np.testing.assert_allclose(found, [0.05, 0.05, 0.06, 0.06, 0.08, 0.08], atol=1e-5)


def test_a_pose_that_the_solid_does_not_have_is_refused(project):
    path = project / "data/assets/things/things_box.stl"
    with pytest.raises(UserError, match="no pose 7"):
        prepare_object("box", MeshParameters(file=str(path), unit="m", up="auto", pose=7), PrepareParameters(**COARSE))


def test_a_box_rests_with_the_solid_angles_of_its_faces():
    half = np.array(BOX) / 2
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    found = {tuple(np.round(up, 6)): probability for up, probability in resting_ups(corners)}
    # Solid angle of a rectangle from a point over its middle (4 atan(ab / (d sqrt(a2 + b2 + d2)))), as a share of 4 pi.
    for axis in range(3):
        a, b = np.delete(half, axis)
        share = 4 * np.arctan(a * b / (half[axis] * np.sqrt((half**2).sum()))) / (4 * np.pi)
        up = np.eye(3)[axis]
        for sign in (1, -1):
            assert found[tuple(sign * up + 0.0)] == pytest.approx(share, abs=1e-4)
    assert sum(found.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.6, -0.48, 0.64), (1e-6, 0, -1)])
def test_the_shortest_rotation_brings_a_direction_up(up):
    direction = np.array(up) / np.linalg.norm(up)
    R = upright(direction)
    np.testing.assert_allclose(R @ direction, [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(R) == pytest.approx(1)
    angle = np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1))
    assert angle == pytest.approx(np.arccos(np.clip(direction[2], -1, 1)), abs=1e-4)


def test_styles_follow_the_measured_sizes():
    assert fitting_styles(Size(0.057, 0.057, 0.105)) == ["pinch", "side"]
    assert fitting_styles(Size(0.2, 0.3, 0.1)) == []
    assert fitting_styles(Size(0.04, 0.04, 0.025)) == ["pinch"]  # too low for the ring finger
    assert fitting_styles(Size(0.04, 0.04, 0.015)) == []
    assert fitting_styles(Size(0.038, 0.089, 0.175)) == ["pinch"]  # YCB's sugar box; no side grasp was ever found
