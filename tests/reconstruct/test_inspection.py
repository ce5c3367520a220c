"""`./dev capture check` says what is wrong, and nothing when nothing is."""

import shutil

import pytest
import yaml
from PIL import Image, ImageFilter

from pipeline.reconstruct.inspection import layout_sentences
from pipeline.records.captures import read_capture
from tools.captures import main


@pytest.fixture
def copy(capture_folder, tmp_path):
    return shutil.copytree(capture_folder, tmp_path / "copy")


@pytest.fixture
def check(tmp_path):
    """The command, with the picture out of the way; returns the exit code."""
    return lambda folder: main(["check", str(folder), "--picture", str(tmp_path / "picture.png")])


def test_a_good_capture_is_called_so(capture_folder, check, capsys):
    assert check(capture_folder) == 0
    assert "no problems found" in capsys.readouterr().out


def test_blur_exposure_few_photos_and_lonely_tags_are_told(copy, check, capsys):
    for number in range(11, 16):
        (copy / f"images/photo_{number:03d}.jpg").unlink()
    with Image.open(copy / "images/photo_002.jpg") as picture:
        blurred = picture.filter(ImageFilter.GaussianBlur(4))
    blurred.save(copy / "images/photo_002.jpg")
    with Image.open(copy / "images/photo_004.jpg") as picture:
        burnt = picture.point(lambda value: min(255, 3 * value))
    burnt.save(copy / "images/photo_004.jpg")
    shutil.copy(copy / "images/photo_005.jpg", copy / "images/photo_006.jpg")
    layout = yaml.safe_load((copy / "tags.yaml").read_text())
    layout["tags"][77] = {"position": [0.3, 0.3, 0]}
    (copy / "tags.yaml").write_text(yaml.safe_dump(layout))
    assert check(copy) == 1
    text = capsys.readouterr().out
    for words in (
        "only 11 photos",
        "photo_002 is blurred",
        "photo_004 is",
        "white",
        "Tag 77 is seen in 0 photos",
        "photo_005 and photo_006 are the same",
    ):
        assert words in text, text


def test_hidden_tags_are_no_problem_and_a_wrong_family_is_named(copy, check, capsys):
    layout = yaml.safe_load((copy / "tags.yaml").read_text())
    layout["tags"][77] = {"position": [-0.07, -0.04, 0]}  # under the block
    (copy / "tags.yaml").write_text(yaml.safe_dump(layout))
    assert check(copy) == 0, capsys.readouterr().out
    layout = {"family": "aruco_4x4_50", "size": 0.06, "tags": {0: {"position": [0, 0, 0]}}}
    (copy / "tags.yaml").write_text(yaml.safe_dump(layout))
    assert check(copy) == 2
    assert "the photos show tag36h11; write that there" in capsys.readouterr().err


def test_sizes_that_disagree_are_told(sightings, capture_folder):
    layout = read_capture(capture_folder).tags
    assert layout_sentences(sightings, layout) == []
    (size,) = layout_sentences(sightings, layout.model_copy(update={"size": 0.045}))
    assert "only 60 mm fit" in size
    (turned,) = layout_sentences(sightings, layout.model_copy(update={"convention": "apriltag"}))
    assert "convention" in turned


def test_what_cannot_be_read_is_one_sentence(copy, check, capsys):
    (copy / "tags.yaml").unlink()
    assert check(copy) == 2
    assert capsys.readouterr().err.count("\n") == 1
