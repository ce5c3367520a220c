"""From where photos look at an object, what is missing, and the picture of it."""

import io

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image

from pipeline.reconstruct.cameras import PosedPhoto
from pipeline.reconstruct.check_picture import frustum
from pipeline.reconstruct.coverage import box_pixels, coverage_sentences, looks_at, looks_at_all, widest_gap
from pipeline.reconstruct.lens import Lens
from pipeline.reconstruct.photos import Photo
from pipeline.records.captures import Scene, SceneObject, read_capture
from pipeline.records.tag_layouts import TagLayout
from tests.reconstruct.drawn import camera_around, photo_of, pixels_of, sheet_picture
from tools.captures import main

SIZE, FOCAL = (640, 480), 600.0
CUBE = SceneObject(position=(0.0, 0.0), box=(0.06, 0.06, 0.06))
AROUND = [(azimuth, height) for azimuth in range(0, 360, 30) for height in (30, 60)]


def posed(directions, distance=0.4):
    lens, grey = Lens.guessed(*SIZE, FOCAL), np.zeros(SIZE[::-1], np.uint8)
    return [
        PosedPhoto(Photo(f"photo_{at}", grey, None, SIZE), lens, camera_around(*direction, distance))
        for at, direction in enumerate(directions)
    ]


def told(directions, distance=0.4):
    return coverage_sentences(looks_at_all(Scene(objects={"cube": CUBE}), posed(directions, distance)))


def test_directions_and_sizes_are_those_of_the_cameras():
    flat = SceneObject(position=(0.0, 0.0), box=(0.05, 0.04, 1e-9))  # so that the box's middle is the origin
    looks = looks_at(flat, 0.0, posed([(10, 30), (200, 55), (350, 89)]))
    assert np.allclose(looks.azimuths, [10, 200, 350], atol=1e-3)
    assert np.allclose(looks.heights, [30, 55, 89], atol=1e-3)
    pixels = pixels_of(flat.corners(0.0, 0.0), camera_around(10, 30, 0.4), FOCAL, SIZE)
    assert looks.shares[0] == pytest.approx(np.ptp(pixels, axis=0).max() / 640, abs=1e-6)


def test_photos_that_do_not_show_the_box_do_not_count():
    aside = SceneObject(position=(3.0, 0.0), box=(0.06, 0.06, 0.06))
    assert looks_at(aside, 0.0, posed(AROUND)).names == ()
    behind = SceneObject(position=(0.5, 0.0), box=(0.06, 0.06, 0.06))  # of a camera at (0.35, 0)
    assert box_pixels(behind, 0.0, posed([(0, 30)])[0]) is None


@pytest.mark.parametrize(
    ("azimuths", "gap"),
    [
        ([0, 90, 180, 270], (0, 90)),
        ([350, 10, 20], (20, 330)),
        ([5], (5, 360)),
        ([], (0, 360)),
        ([-10, 200], (350, 210)),
    ],
)
def test_the_widest_gap_goes_around_the_circle(azimuths, gap):
    assert widest_gap(np.array(azimuths, float)) == pytest.approx(gap)


def test_what_is_missing_is_told_and_nothing_where_nothing_is():
    assert told(AROUND) == []
    (gap,) = told([(azimuth, height) for azimuth, height in AROUND if not 60 <= azimuth <= 150])
    assert "from azimuths 30 to 180 degrees" in gap
    (low,) = told([(azimuth, 55) for azimuth, _ in AROUND])
    assert "No photo is low" in low
    (high,) = told([(azimuth, 30) for azimuth, _ in AROUND])
    assert "No photo is high" in high
    (far,) = told(AROUND, distance=1.5)
    assert "too far" in far
    assert len(told([(0, 89), *((azimuth, 30) for azimuth in range(0, 200, 20))])) == 1  # from above is no side
    (unseen,) = coverage_sentences(looks_at_all(Scene(objects={"cube": CUBE}), []))
    assert "shows cube" in unseen


def test_a_frustum_is_where_the_camera_is_and_looks_where_it_looks():
    (view,) = posed([(0, 30)])
    points = frustum(view, 0.1)
    assert np.allclose(points[0], [0.4 * np.cos(np.pi / 6), 0, 0.2])
    assert np.allclose(points[1:].mean(axis=0), points[0] * 0.75)  # a quarter of the way to the origin
    assert np.allclose(np.linalg.norm(points[2] - points[1]), 0.1 * 640 / FOCAL)


@pytest.fixture
def drawn(tmp_path):
    """A capture of six photos of a sheet of tags from one side."""
    folder = tmp_path / "drawn"
    (folder / "images").mkdir(parents=True)
    board = {"kind": "grid", "columns": 3, "rows": 4, "gap": 0.01}
    tags = {"family": "aruco_4x4_50", "size": 0.04, "board": board}
    (folder / "tags.yaml").write_text(yaml.safe_dump(tags))
    (folder / "scene.yaml").write_text(
        yaml.safe_dump({"objects": {"cube": {"position": [0, 0], "box": [0.06, 0.06, 0.06]}}})
    )
    layout = TagLayout.model_validate(tags)
    sheet = sheet_picture(layout, 0.17, 0.22)
    for at, azimuth in enumerate(range(0, 120, 20)):
        photo = photo_of(sheet, camera_around(azimuth, 35 + 5 * at, 0.4), FOCAL, SIZE)
        cv2.imwrite(str(folder / f"images/photo_{at}.png"), photo)
    return folder


def test_check_writes_one_picture_and_advice(drawn, tmp_path, capsys):
    target = tmp_path / "new/picture.png"
    assert main(["check", str(drawn), "--picture", str(target)]) == 1
    text = capsys.readouterr().out
    assert "No photo shows cube from azimuths 100 to 0 degrees" in text and str(target) in text
    with Image.open(io.BytesIO(target.read_bytes())) as picture:
        assert picture.format == "PNG" and min(picture.size) >= 800
        assert len(picture.convert("RGB").resize((64, 64)).getcolors(4096)) > 100  # not blank
    assert {path.name for path in drawn.iterdir()} == {"images", "tags.yaml", "scene.yaml"}
    assert len(read_capture(drawn).images) == 6


def test_check_draws_what_it_can_where_the_tags_tell_no_camera(drawn, tmp_path, capsys):
    blank = np.full((SIZE[1], SIZE[0]), 128, np.uint8)
    for path in (drawn / "images").iterdir():
        cv2.imwrite(str(path), blank)
    target = tmp_path / "picture.png"
    assert main(["check", str(drawn), "--picture", str(target)]) == 1
    assert "The tags tell no camera" in capsys.readouterr().out and target.exists()
