"""The folder of a capture: everything wrong with it is one sentence that names the file."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml
from PIL import Image

from pipeline.reconstruct.normal_maps import normal_files, read_normals, shrunk_normals
from pipeline.reconstruct.photos import read_grey, read_photos, shrunk
from pipeline.records.captures import Intrinsics, Scene, read_capture, read_truth
from pipeline.records.errors import UserError
from pipeline.records.tag_layouts import TagLayout


@pytest.fixture
def copy(capture_folder, tmp_path):
    return shutil.copytree(capture_folder, tmp_path / "copy")


def change(path, key, value):
    content = yaml.safe_load(path.read_text())
    section = content
    *folders, last = key.split(".")
    for folder in folders:
        section = section[int(folder) if folder.isdigit() else folder]
    if value is None:
        del section[last]
    else:
        section[last] = value
    path.write_text(yaml.safe_dump(content))


def test_a_rendered_capture_is_valid_and_hides_nothing(capture_folder):
    capture = read_capture(capture_folder)
    assert len(capture.images) == 16 and set(capture.scene.objects) == {"block", "can"}
    assert {path.name for path in capture_folder.iterdir()} == {"images", "tags.yaml", "scene.yaml", "gt"}
    for path in capture.images:
        with Image.open(path) as picture:
            assert not picture.getexif() and "comment" not in picture.info
    # A ruler's accuracy: whole millimetres.
    for item in capture.scene.objects.values():
        millimetres = np.array([*item.position, *item.box]) * 1000
        assert np.allclose(millimetres, np.round(millimetres))
    truth = read_truth(capture_folder)
    assert truth is not None and truth.rendered and set(truth.surfaces) == {"block", "can"}


@pytest.mark.parametrize(
    ("file", "key", "value", "words"),
    [
        ("tags.yaml", "size", -1, "tags.yaml: size"),
        ("tags.yaml", "sizes", 0.05, "unknown key"),
        ("tags.yaml", "family", "tag99", "tags.yaml: family"),
        ("tags.yaml", "convention", None, "tags.yaml: convention"),
        ("tags.yaml", "tags", "somewhere", "or the word anywhere"),
        ("tags.yaml", "tags", None, "either tags or board"),
        ("tags.yaml", "board", {"kind": "grid", "columns": 2, "rows": 2, "gap": 0.01}, "either tags or board"),
        ("tags.yaml", "board", {"kind": "charuco", "columns": 2, "rows": 2, "gap": 0.01}, "has `square`"),
        ("tags.yaml", "tags", {999: {"position": [0, 0, 0]}}, "has no tag 999"),
        ("tags.yaml", "tags", {}, "tags.yaml: tags"),
        ("scene.yaml", "objects", {}, "scene.yaml: objects"),
        ("scene.yaml", "objects.can.box", [60, 60, 80], "is not a size in metres"),
        ("scene.yaml", "objects.can.position", [-0.06, -0.04], "overlap"),
        ("scene.yaml", "objects.can.positon", [0, 0], "unknown key"),
        ("scene.yaml", "objects.can.box", [-0.06, 0.06, 0.08], "is not a size in metres"),
        ("tags.yaml", "tags.0.position", [float("nan"), 0, 0], "finite number"),
        ("tags.yaml", "tags.0", {"position": [0, 0, 0], "quaternion": [0, 0, 0, 0]}, "length 1"),
        ("tags.yaml", "tags.0.quaternion", [1, 0, 0, 0], "not both"),
    ],
)
def test_wrong_texts_are_refused(copy, file, key, value, words):
    change(copy / file, key, value)
    with pytest.raises(UserError, match=words.replace("(", r"\(")) as caught:
        read_capture(copy)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("- 1", "is empty or not a mapping"),
        ("size: 2026-99-99", "not valid YAML"),
        ("a: " + 5000 * "[", "not valid YAML"),
        ("!!python/object/apply:os.system ['exit 1']", "could not determine a constructor"),
        ("tags:\n  0: {position: [0, 0, 0]}\n  0: {position: [1, 0, 0]}", "0 occurs twice"),
    ],
)
def test_texts_that_are_no_plain_yaml_are_refused(copy, text, words):
    (copy / "tags.yaml").write_text(text)
    with pytest.raises(UserError, match=f"tags.yaml .*{words}") as caught:
        read_capture(copy)
    assert "\n" not in str(caught.value)


def scene_of(*places):
    """Long, thin boxes at (x, y, yaw)."""
    return {
        "objects": {
            name: {"position": [x, y], "yaw_degrees": yaw, "box": [0.2, 0.02, 0.05]}
            for name, (x, y, yaw) in zip("ab", places, strict=True)
        }
    }


@pytest.mark.parametrize(
    ("second", "apart"),
    [
        ((0.0, 0.021, 0.0), True),
        ((0.0, 0.012, 0.0), False),
        ((0.03, 0.0, 90.0), False),  # a cross whose middles are farther apart than both are wide
        ((0.112, 0.0, 90.0), True),
        ((0.0, 0.06, 45.0), False),
        ((0.0, 0.09, 45.0), True),
    ],
)
def test_boxes_are_apart_or_overlap_as_they_are_turned(copy, second, apart):
    (copy / "scene.yaml").write_text(yaml.safe_dump(scene_of((0.0, 0.0, 0.0), second)))
    if apart:
        assert set(read_capture(copy).scene.objects) == {"a", "b"}
    else:
        with pytest.raises(UserError, match="boxes of a and b overlap"):
            read_capture(copy)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ([475.0, 475.0, 240.0, 180.0], "OPENCV has 8 of them, not 4"),
        ([-475.0, 475.0, 240.0, 180.0, 0, 0, 0, 0], "focal lengths are positive"),
        ([475.0, 475.0, 1240.0, 180.0, 0, 0, 0, 0], "principal point lies in the picture"),
    ],
)
def test_impossible_cameras_are_refused(copy, parameters, words):
    text = {"model": "OPENCV", "width": 480, "height": 360, "parameters": parameters}
    (copy / "intrinsics.yaml").write_text(yaml.safe_dump(text))
    with pytest.raises(UserError, match=f"intrinsics.yaml: .*{words}"):
        read_capture(copy)


@pytest.mark.parametrize("missing", ["tags.yaml", "scene.yaml", "images"])
def test_missing_parts_are_named(copy, missing):
    target = copy / missing
    shutil.rmtree(target) if target.is_dir() else target.unlink()
    with pytest.raises(UserError, match=missing):
        read_capture(copy)


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(UserError, match="nowhere is missing; put photos there"):
        read_capture(tmp_path / "nowhere")


def test_pictures_of_other_kinds_are_refused_by_name_and_by_content(copy):
    first = copy / "images/photo_000.jpg"
    (copy / "images/extra.TIFF").write_bytes(b"II*")
    with pytest.raises(UserError, match="neither JPEG nor PNG nor HEIC.*convert"):
        read_capture(copy)
    (copy / "images/extra.TIFF").unlink()
    first.write_bytes(b"GIF" + bytes(100))
    with pytest.raises(UserError, match="photo_000.jpg is no JPEG, PNG or HEIC"):
        read_photos(read_capture(copy), 480)


def test_a_damaged_photo_is_named(copy):
    path = copy / "images/photo_003.jpg"
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(UserError, match="photo_003.jpg is damaged"):
        read_photos(read_capture(copy), 480)


def test_the_focal_length_comes_from_exif(copy):
    path = copy / "images/photo_001.jpg"
    with Image.open(path) as picture:
        exif = picture.getexif()
        exif.get_ifd(0x8769)[0xA405] = 26
        picture.save(path, exif=exif)
    capture = read_capture(copy)
    photos = read_photos(replace(capture, images=capture.images[:3]), 240)
    assert [photo.focal for photo in photos] == [None, pytest.approx(26 / 43.27 * 300), None]


def test_sixteen_bits_are_read_as_eight(copy):
    path = copy / "images/photo_003.jpg"
    grey = read_grey(path)
    Image.fromarray(grey.astype(np.uint16) * 257).save(copy / "deep.png")
    assert np.array_equal(read_grey(copy / "deep.png"), grey)


@pytest.mark.parametrize("name", ["masks/photo_003.jpg", "masks/photo_003.npy", "normals/photo_003.jpg"])
def test_what_would_not_be_used_is_named(copy, name):
    (copy / name).parent.mkdir()
    (copy / name).write_bytes(b"")
    with pytest.raises(UserError, match=f"{name} is not used"):
        read_capture(copy)


@pytest.mark.parametrize("content", [b"", b"ply\nformat ascii 1.0\n", b"no mesh"])
def test_damaged_truth_is_named(copy, content):
    from pipeline.reconstruct.reconstruction import true_surfaces

    (copy / "gt/can.ply").write_bytes(content)
    with pytest.raises(UserError, match="gt/can.ply"):
        true_surfaces(read_truth(copy))


def test_two_photos_of_one_name_are_refused(copy):
    shutil.copy(copy / "images/photo_003.jpg", copy / "images/photo_003.png")
    with pytest.raises(UserError, match="two photos named photo_003"):
        read_capture(copy)


@pytest.mark.parametrize("name", ["masks/photo_099.png", "normals/photo_000.jpg.npy"])
def test_what_belongs_to_no_photo_is_named(copy, name):
    (copy / name).parent.mkdir()
    (copy / name).write_bytes(b"")
    with pytest.raises(UserError, match=f"{name} belongs to no photo"):
        read_capture(copy)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (np.zeros((10, 10, 3), np.float32), "has 10 x 10 pixels, its photo 480 x 360"),
        (np.zeros((360, 480), np.float32), "has shape"),
        (np.full((360, 480, 3), np.nan, np.float32), "three finite numbers"),
        (b"no array", "is no normal map"),
        (b"", "is no normal map"),
        (np.array([{}], dtype=object), "is no normal map .*allow_pickle"),
    ],
)
def test_wrong_normal_maps_are_refused_before_the_long_work(copy, content, words):
    (copy / "normals").mkdir()
    target = copy / "normals/photo_003.npy"
    target.write_bytes(content) if isinstance(content, bytes) else np.save(target, content)
    capture = read_capture(copy)
    photo = read_photos(replace(capture, images=capture.images[3:6]), 480)[0]
    with pytest.raises(UserError, match=f"photo_003.npy {words}|photo_003.npy .*{words}"):
        normal_files(capture, [photo])


def test_normal_maps_are_read_as_unit_vectors(copy):
    (copy / "normals").mkdir()
    towards = np.zeros((360, 480, 3), np.float32)
    towards[:, 10:] = [0, -1.2, -1.6]
    np.save(copy / "normals/photo_000.npy", towards)
    Image.fromarray(np.uint8(np.round((np.array([0, -0.6, -0.8]) + 1) / 2 * 255)) + np.zeros((4, 5, 3), np.uint8)).save(
        copy / "normals/photo_001.png"
    )
    Image.new("RGB", (5, 4)).save(copy / "normals/photo_002.png")
    assert (read_normals(copy / "normals/photo_002.png") == 0).all(), "black is unknown"
    first, second = (read_normals(copy / f"normals/{name}") for name in ("photo_000.npy", "photo_001.png"))
    assert (first[:, :10] == 0).all() and np.allclose(first[:, 10:], [0, -0.6, -0.8], atol=1e-6)
    assert np.allclose(second, [0, -0.6, -0.8], atol=0.01)


def test_exif_orientation_is_honoured(copy):
    path = copy / "images/photo_000.jpg"
    upright = read_grey(path)
    with Image.open(path) as picture:
        turned, exif = picture.transpose(Image.Transpose.ROTATE_90), picture.getexif()
        exif[0x0112] = 6  # to be shown turned by 90 degrees clockwise
        turned.save(path, exif=exif, quality=98)
    again = read_grey(path)
    assert again.shape == upright.shape
    assert np.abs(again.astype(float) - upright).mean() < 3


def test_conventions_differ_by_half_a_turn():
    text = {"family": "tag36h11", "size": 0.06, "tags": {0: {"position": [0.1, 0.2, 0.0], "yaw_degrees": 90}}}
    ours = TagLayout.model_validate({**text, "convention": "opencv"}).corners()[0]
    theirs = TagLayout.model_validate({**text, "convention": "apriltag"}).corners()[0]
    # Top left of a tag turned by 90 degrees counter-clockwise lies at -x, -y of its middle.
    assert np.allclose(ours[0], [0.07, 0.17, 0])
    assert np.allclose(ours[[2, 3, 0, 1]], theirs)


def test_the_examples_of_the_documentation_are_valid(repository, copy):
    text = (repository / "docs/capture.md").read_text()
    blocks = re.findall(r"^```yaml\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    tags, scene, marked, captures = blocks
    (copy / "tags.yaml").write_text(tags)
    (copy / "scene.yaml").write_text(scene)
    capture = read_capture(copy)
    upright = capture.tags.corners()[2]
    assert np.allclose(upright[0] - upright[3], [0, 0, 0.06], atol=1e-5), "a tag that stands has its top above"
    assert set(capture.scene.objects) == {"cube"}
    without_tags = Scene.model_validate(yaml.safe_load(marked))
    assert set(without_tags.objects) == {"apple"} and without_tags.scale.metres == 0.297
    assert yaml.safe_load(captures)["captures"]["mine"] == {"folder": "data/raw/my_capture"}


@pytest.mark.parametrize(("room", "option"), [("capture", "--name"), ("reconstruct", "--capture")])
def test_an_unknown_name_is_one_sentence(run_module, room, option):
    done = run_module(f"pipeline.{room}", option, "nowhere")
    assert done.returncode == 2 and "nowhere" in done.stderr and done.stderr.count("\n") == 1


def test_shrinking_keeps_the_middle_of_every_block():
    """The mean of a plane over a block is its value in the middle: (x, y) comes to (x / 3, y / 3)."""
    x, y = np.meshgrid(np.arange(14) + 0.5, np.arange(10) + 0.5)
    found = shrunk(np.stack([2 * x - y, x + 3 * y], axis=-1), 3)
    x, y = (3 * value for value in np.meshgrid(np.arange(4) + 0.5, np.arange(3) + 0.5))
    assert np.allclose(found, np.stack([2 * x - y, x + 3 * y], axis=-1))


def test_large_photos_are_shrunk_with_masks_normals_and_lens(copy):
    import pycolmap

    for kind in ("masks", "normals"):
        (copy / kind).mkdir()
    mask = np.full((360, 480), 255, np.uint8)
    mask[7, 8] = 0
    Image.fromarray(mask).save(copy / "masks/photo_000.png")
    normals = np.zeros((360, 480, 3), np.float32)
    normals[:, 1:] = [0.0, -0.6, -0.8]
    normals[0:3, 3:5] = 0.0
    np.save(copy / "normals/photo_000.npy", normals)
    capture = read_capture(copy)
    photo = read_photos(replace(capture, images=capture.images[:3]), 200)[0]
    assert photo.size == (160, 120) and photo.file_size == (480, 360) and photo.times == 3
    assert np.argwhere(~photo.usable).tolist() == [[2, 2]], "a block counts when all of it may be used"
    (path,) = normal_files(capture, [photo]).values()
    small = shrunk_normals(read_normals(path), photo.times)
    assert np.allclose(small[1, 0], [0.0, -0.6, -0.8]) and not small[0, 1].any()

    directions = np.array([[0.1, -0.2, 1.0], [-0.3, 0.25, 1.0], [0.0, 0.0, 1.0]])
    lenses = {"SIMPLE_RADIAL": [460.0, 230.0, 190.0, 0.1], "OPENCV": [460, 470, 230, 190, -0.1, 0.03, 1e-3, -1e-3]}
    for model, parameters in lenses.items():
        whole = Intrinsics(model=model, width=480, height=360, parameters=parameters)
        small = whole.shrunk(photo.times)
        assert (small.width, small.height) == photo.size
        cameras = [
            pycolmap.Camera(model=model, width=lens.width, height=lens.height, params=lens.parameters)
            for lens in (whole, small)
        ]
        in_whole, in_small = (np.asarray(camera.img_from_cam(directions)) for camera in cameras)
        assert np.allclose(in_whole, 3 * in_small)
