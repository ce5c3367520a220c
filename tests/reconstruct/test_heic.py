"""HEIC photos are read like their JPEG twins."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.reconstruct.photos import exif_focal, read_colours, read_grey
from pipeline.records.errors import UserError

# Taken as phones do: stored lying (128 x 96), to be turned clockwise by 90 degrees (EXIF orientation 6, and HEIC's own
# instruction), 26 mm as on film. Upright, red grows to the right and green downwards, as `upright` says. Encoded by
# libheif with x265 at quality 80.
HEIC = Path(__file__).with_name("sideways.heic")
ORIENTATION, EXIF, FILM = 0x0112, 0x8769, 0xA405


def upright():
    u, v = np.meshgrid(np.arange(96) / 96, np.arange(128) / 128)
    return np.stack([40 + 180 * u, 40 + 180 * v, np.full_like(u, 90)], axis=-1).round().astype(np.uint8)


@pytest.fixture
def jpeg(tmp_path):
    lying = Image.fromarray(np.ascontiguousarray(np.rot90(upright())))
    exif = Image.Exif()
    exif[ORIENTATION] = 6
    exif.get_ifd(EXIF)[FILM] = 26
    lying.save(tmp_path / "twin.jpg", quality=95, exif=exif)
    return tmp_path / "twin.jpg"


def test_heic_and_its_twin_are_alike(jpeg):
    pytest.importorskip("pi_heif")
    for path in (jpeg, HEIC):
        colours = read_colours(path)
        assert colours.shape == (128, 96, 3)
        assert np.abs(colours.astype(int) - upright()).mean() < 3 and np.abs(colours.astype(int) - upright()).max() < 16
        assert exif_focal(path) == pytest.approx(26 / 43.27 * 160)  # the diagonal of 96 x 128
    assert np.abs(read_grey(jpeg).astype(int) - read_grey(HEIC)).max() < 8


def test_heic_is_known_by_its_content_and_a_damaged_one_is_named(tmp_path):
    pytest.importorskip("pi_heif")
    shutil.copy(HEIC, tmp_path / "renamed.jpg")
    assert np.array_equal(read_grey(tmp_path / "renamed.jpg"), read_grey(HEIC))
    (tmp_path / "cut.heic").write_bytes(HEIC.read_bytes()[:1200])
    with pytest.raises(UserError, match="cut.heic is damaged"):
        read_grey(tmp_path / "cut.heic")


def test_without_the_package_one_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pi_heif", None)
    with pytest.raises(UserError, match=r"sideways.heic is a HEIC photo; install .*\[heic\]"):
        read_grey(HEIC)
