"""`./dev add-object`: a mesh file becomes an object, or nothing changes and one sentence says why."""

import shutil

import numpy as np
import pytest
import trimesh
import yaml

from pipeline.records.objects import read_prepared_object
from pipeline.records.parameters import read_parameters
from tools import add_object


@pytest.fixture
def project(repository, empty_folder):
    """A folder with parameters that prepare fast."""
    content = yaml.safe_load((repository / "params.yaml").read_text())
    content["prepare"] |= {"distance_cells": 32, "surface_points": 2048}
    (empty_folder / "params.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return empty_folder


@pytest.fixture
def box(project):
    """A file in millimetres, outside of data/raw, under an awkward name."""
    path = project / "My Möbel (2).STL"
    path.write_bytes(trimesh.creation.box((40, 50, 60)).export(file_type="stl"))
    return path


def run(*arguments) -> int:
    return add_object.main([str(argument) for argument in arguments])


def files(folder) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def assert_refused(capsys, folder, arguments, *words):
    before = files(folder)
    capsys.readouterr()
    assert run(*arguments) == 2
    said = capsys.readouterr().err
    lines = [line for line in said.splitlines() if not line.startswith("warning:") and "%|" not in line]
    assert len(lines) == 1 and lines[0].startswith("add-object: "), said
    for word in words:
        assert word in lines[0]
    assert files(folder) == before


def test_a_file_becomes_an_object(project, box, capsys):
    assert run(box, "--style", "both") == 0
    done = capsys.readouterr()
    assert "the longest extent in My Möbel (2).STL is 60, taken as mm" in done.err
    for words in (
        "40.0 x 50.0 x 60.0 mm",
        "120.0 cm3",
        "60.0 g",
        "convex parts  1",
        "40.0 mm wide: fits",
        "./dev repro validate@pinch validate@side`",
    ):
        assert words in done.out
    parameters = read_parameters()
    assert parameters.meshes["my_mobel_2"].model_dump(exclude_unset=True) == {
        "file": "data/raw/my_mobel_2.stl",
        "unit": "mm",
        "up": "+z",
    }
    assert parameters.styles.pinch[-1] == parameters.styles.side[-1] == "my_mobel_2"
    assert (project / "data/raw/my_mobel_2.stl").read_bytes() == box.read_bytes()
    assert (project / "data/prepare/my_mobel_2/picture.png").stat().st_size > 1000
    np.testing.assert_allclose(
        read_prepared_object(project / "data/prepare/my_mobel_2").extents, (0.04, 0.05, 0.06), atol=1e-7
    )


@pytest.mark.slow
def test_the_stage_makes_the_same_bytes_as_the_command(project, box, run_module, repository, capsys):
    options = ("--unit", "cm", "--scale", "0.1", "--up=-y", "--turn", "30", "--density", "250")
    assert run(box, "--style", "side", "--name", "brick", *options) == 0
    assert "taken as" not in capsys.readouterr().err
    before = files(project / "data/prepare/brick")
    shutil.rmtree(project / "data/prepare/brick")
    done = run_module("pipeline.prepare", "--object", "brick", folder=project, env={"PYTHONPATH": str(repository)})
    assert done.returncode == 0, done.stderr
    assert files(project / "data/prepare/brick") == before
    prepared = read_prepared_object(project / "data/prepare/brick")
    assert prepared.mass == pytest.approx(120e-6 * 250, rel=1e-5)  # 40 x 50 x 60 mm
    assert prepared.extents[2] == pytest.approx(0.05, abs=1e-6)


def test_fitting_needs_no_unit(project, box, capsys):
    assert run(box, "--style", "pinch", "--name", "brick", "--fit-longest", "0.09") == 0
    assert "taken as" not in capsys.readouterr().err
    np.testing.assert_allclose(read_prepared_object(project / "data/prepare/brick").extents, (0.06, 0.075, 0.09))


def test_a_second_file_of_that_name_needs_force(project, box, capsys):
    assert run(box, "--style", "pinch", "--name", "brick") == 0
    other = project / "other.stl"
    trimesh.creation.box((30, 30, 30)).export(other)
    assert_refused(capsys, project, (other, "--style", "pinch", "--name", "brick"), "brick", "--force")
    assert run(other, "--style", "pinch", "--name", "brick", "--force") == 0
    assert read_prepared_object(project / "data/prepare/brick").extents == pytest.approx([0.03] * 3, abs=1e-7)
    assert read_parameters().styles.pinch.count("brick") == 1


def test_a_foreign_file_in_data_raw_is_not_overwritten(project, box, capsys):
    (project / "data/raw").mkdir(parents=True)
    (project / "data/raw/brick.stl").write_text("precious")
    assert_refused(capsys, project, (box, "--style", "pinch", "--name", "brick"), "brick.stl is a different file")


def test_a_file_that_lies_in_data_raw_already_stays(project, box):
    (project / "data/raw").mkdir(parents=True)
    shutil.move(box, project / "data/raw/brick.stl")
    assert run("data/raw/brick.stl", "--style", "side") == 0
    assert read_parameters().meshes["brick"].file == "data/raw/brick.stl"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("none.stl",), "is missing"),
        (("folder.stl",), "is a folder"),
        (("loop.stl",), "is missing"),
        (("text.stl",), "no triangle mesh"),
        (("text.step",), "unknown format"),
        (("box.stl", "--name", "../box"), "is not a valid object name"),
        (("box.stl", "--name", "my box"), "is not a valid object name"),
        (("箱.stl",), "no object name"),
        (("box.stl", "--name", "cube"), "another --name"),
        (("box.stl", "--scale", "2", "--fit-longest", "0.1"), "not both"),
        (("box.stl", "--density", "0"), "--density: "),
        (("box.stl", "--unit", "m"), "looks like mm, set `unit: mm`"),
        (("cone.stl", "--up=-z"), "does not stand with -z up"),
        (("two.stl",), "separate bodies"),
    ],
)
def test_a_refusal_is_one_sentence_and_leaves_no_trace(project, box, capsys, arguments, words):
    mesh = trimesh.creation.box((40, 50, 60))
    mesh.export(project / "box.stl")
    mesh.export(project / "箱.stl")
    trimesh.util.concatenate([mesh, mesh.copy().apply_translation([99, 0, 0])]).export(project / "two.stl")
    trimesh.creation.cone(radius=20, height=60).export(project / "cone.stl")
    (project / "folder.stl").mkdir()
    (project / "loop.stl").symlink_to("loop.stl")
    for name in ("text.stl", "text.step"):
        (project / name).write_text("this is no mesh")
    assert_refused(capsys, project, (*arguments, "--style", "pinch"), words)


@pytest.mark.parametrize(
    ("stem", "name"),
    [("Mug", "mug"), ("My Mug (2)", "my_mug_2"), ("3D-Tasse_größer", "d_tasse_groer"), ("..", ""), ("杯", "")],
)
def test_names_are_made_of_file_names(stem, name):
    assert add_object.plain_name(stem) == name


def test_an_object_stands_by_itself_and_gets_the_styles_that_fit(project, capsys):
    path = project / "brick.stl"
    path.write_bytes(trimesh.creation.box((60, 45, 80)).export(file_type="stl"))
    assert run(path, "--style", "auto", "--unit", "mm", "--up", "auto") == 0
    assert "60.0 x 80.0 x 45.0 mm" in capsys.readouterr().out
    parameters = read_parameters()
    assert parameters.meshes["brick"].up == "auto"
    assert "brick" in parameters.styles.pinch and "brick" in parameters.styles.side


def test_what_fits_no_style_is_refused_unless_one_is_named(project, capsys):
    path = project / "slab.stl"
    path.write_bytes(trimesh.creation.box((200, 300, 150)).export(file_type="stl"))
    assert_refused(capsys, project, [path, "--style", "auto", "--unit", "mm"], "fits no style", "200.0 mm wide")
    assert run(path, "--style", "pinch", "--unit", "mm") == 0
