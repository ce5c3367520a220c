"""Photos out of a video: which frames are taken, how they are written, and which videos are refused."""

import subprocess

import cv2
import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from pipeline.reconstruct.video import Motion, Survey, chosen_frames
from tools.captures import main

WIDTH, HEIGHT, FRAMES = 320, 240, 90
# How far the camera has panned at each frame, pixels: slowly, not at all, fast.
PANNED = np.concatenate([np.linspace(0, 80, 40), np.full(20, 80.0), np.linspace(80, 240, 30)])


@pytest.fixture(scope="module")
def wall():
    """A wide picture with texture of all sizes."""
    noise = np.random.default_rng(3).normal(size=(HEIGHT, 2 * WIDTH)).astype(np.float32)
    layers = [cv2.GaussianBlur(noise, None, sigma) * sigma for sigma in (1.5, 4.0, 10.0)]
    return np.clip(128 + 45 * sum(layers), 0, 255).astype(np.uint8)


def at(wall, panned):
    move = np.array([[1, 0, -panned], [0, 1, 0]], np.float32)
    return cv2.warpAffine(wall, move, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)


def filmed(target, frames):
    writer = imageio_ffmpeg.write_frames(
        str(target), (WIDTH, HEIGHT), fps=30, quality=None, output_params=["-crf", "12", "-preset", "ultrafast"]
    )
    writer.send(None)
    for frame in frames:
        writer.send(np.ascontiguousarray(np.repeat(frame[..., None], 3, axis=2)))
    writer.close()
    return target


@pytest.fixture(scope="module")
def video(wall, tmp_path_factory):
    """The pan; every second frame is blurred."""
    frames = [at(wall, panned) for panned in PANNED]
    blurred = [frame if n % 2 == 0 else cv2.GaussianBlur(frame, None, 2.0) for n, frame in enumerate(frames)]
    return filmed(tmp_path_factory.mktemp("video") / "pan.mp4", blurred)


def test_motion_is_that_of_the_picture_and_rest_adds_nothing(wall):
    motion, random = Motion(), np.random.default_rng(1)
    noisy = [np.clip(at(wall, panned) + random.normal(0, 3, (HEIGHT, WIDTH)), 0, 255) for panned in PANNED]
    found = np.array([motion.moved(frame.astype(np.uint8)) for frame in noisy])
    assert np.abs(found - PANNED).max() < 4
    assert abs(found[59] - found[41]) < 0.5


def test_stretches_of_the_way_give_their_sharpest_frame():
    sharp = np.ones(90)
    sharp[[12, 25, 50, 70]] = 2.0
    numbers = chosen_frames(Survey(PANNED, sharp), 4)  # stretches of 60 pixels, middles 15-45, 75-105, 135-165, 195-225
    assert numbers[0] == 12 and numbers[1] == 50 and 135 <= PANNED[numbers[2]] <= 165
    few = chosen_frames(Survey(np.array([0.0, 0.1, 0.9, 1.0]), np.ones(4)), 4)
    assert few == [1, 2]  # nothing lies in the two stretches between


def test_sharp_evenly_spread_frames_are_written(video, wall, tmp_path, capsys):
    assert main(["from-video", str(video), "--out", str(tmp_path / "new"), "--count", "8"]) == 0
    text = capsys.readouterr().out
    assert "tags.yaml" in text and "scene.yaml" in text and "./dev capture check" in text
    written = sorted((tmp_path / "new/images").iterdir())
    assert [path.name for path in written] == [f"frame_{n:03d}.jpg" for n in range(1, 9)]
    truth = np.array([at(wall, panned) for panned in PANNED]).astype(float)
    which = []
    for path in written:
        with Image.open(path) as picture:
            assert picture.size == (WIDTH, HEIGHT)
            which.append(int(np.abs(truth - np.asarray(picture.convert("L"))).mean(axis=(1, 2)).argmin()))
            sizes = [sum(table) for table in picture.quantization.values()]
        assert max(sizes) < 64 * 20  # of quality 92 or more
    places = PANNED[which]
    assert (np.diff(places) >= 0.4 * 240 / 8).all() and (np.diff(places) <= 1.6 * 240 / 8).all()
    still = [n for n in which if 39 <= n <= 59]
    assert all(n % 2 == 0 for n in which if n not in still)  # as frames at rest are the same picture


def test_a_video_filmed_upright_gives_upright_photos(video, wall, tmp_path):
    turned = tmp_path / "turned.mp4"
    ffmpeg = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-display_rotation", "90", "-i", str(video)]
    subprocess.run([*ffmpeg, "-c", "copy", str(turned)], check=True)
    assert main(["from-video", str(turned), "--out", str(tmp_path / "new"), "--count", "3"]) == 0
    with Image.open(tmp_path / "new/images/frame_001.jpg") as picture:
        assert picture.size == (HEIGHT, WIDTH)
        upright = np.rot90(np.asarray(picture.convert("L")).astype(float), -1)
    errors = [np.abs(at(wall, panned) - upright).mean() for panned in PANNED]
    assert min(errors) < 12 and PANNED[int(np.argmin(errors))] < 80


def test_photos_that_are_there_are_kept_unless_forced(video, tmp_path, capsys):
    images = tmp_path / "images"
    images.mkdir()
    (images / "mine.jpg").write_bytes(b"mine")
    assert main(["from-video", str(video), "--out", str(tmp_path), "--count", "3"]) == 2
    assert "--force" in capsys.readouterr().err and (images / "mine.jpg").exists()
    assert main(["from-video", str(video), "--out", str(tmp_path), "--count", "3", "--force"]) == 0
    assert len(list(images.iterdir())) == 3 and not (images / "mine.jpg").exists()


def test_videos_that_give_no_photos_are_refused_in_one_sentence(video, wall, tmp_path, capsys):
    still = filmed(tmp_path / "still.mp4", [at(wall, 0.0)] * 40)
    blank = filmed(tmp_path / "blank.mp4", [np.full((HEIGHT, WIDTH), 128, np.uint8)] * 40)
    text = tmp_path / "text.mp4"
    text.write_text("no video")
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(video.read_bytes()[:-3000])
    cases = [(still, "hardly moves"), (blank, "hardly moves"), (text, "no video"), (cut, "damaged")]
    cases += [(video, "only 90 frames"), (tmp_path / "missing.mp4", "there is no video")]
    for path, words in cases:
        out = tmp_path / f"out_{path.stem}"
        assert main(["from-video", str(path), "--out", str(out), "--count", "100" if path == video else "12"]) == 2
        said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("capture:")]
        assert len(said) == 1 and words in said[0], said
        assert not (out / "images").exists() and not list(out.glob(".*"))
