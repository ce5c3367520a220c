"""Tags as people print them are found in their own families, and their corners are where they are."""

import cv2
import numpy as np
import pytest

from pipeline.reconstruct.detection import all_tags, family_seen, seen_tags
from pipeline.records.tag_layouts import TAG_FAMILIES, Board, TagLayout
from tests.reconstruct.drawn import camera_around, photo_of, pixels_of, sheet_picture

SIZE = (800, 600)


def grid(family: str, columns: int = 4, rows: int = 3, **more) -> TagLayout:
    board = Board(kind="grid", columns=columns, rows=rows, gap=0.012)
    return TagLayout(family=family, size=0.03, convention="opencv", board=board, **more)


def photo(layout: TagLayout, size=SIZE, focal: float = 800.0) -> tuple[np.ndarray, np.ndarray]:
    T = camera_around(50, 50, 0.3)
    return photo_of(sheet_picture(layout, 0.3, 0.24), T, focal, size), T


@pytest.mark.parametrize("family", ["tag36h11", "tag25h9", "tag16h5", *(f"aruco_{n}x{n}_250" for n in (4, 5, 6, 7))])
def test_every_family_is_found_where_it_is(family):
    layout = grid(family)
    grey, T = photo(layout)
    seen = seen_tags(grey, layout).tags
    assert set(seen) == set(range(12))
    errors = [
        np.linalg.norm(seen[number] - pixels_of(corners, T, 800.0, SIZE), axis=1)
        for number, corners in layout.corners().items()
    ]
    assert np.median(errors) < 0.1 and np.max(errors) < 0.4


@pytest.mark.parametrize("convention", ["opencv", "apriltag"])
def test_a_border_of_two_cells_and_either_way_up(convention):
    board = Board(kind="aprilgrid", columns=4, rows=3, gap=0.009)
    layout = TagLayout(family="tag36h11", size=0.03, convention=convention, border=2, board=board)
    grey, T = photo(layout)
    seen = seen_tags(grey, layout).tags
    assert len(seen) == 12
    for number, corners in seen.items():
        assert np.abs(corners - pixels_of(layout.corners()[number], T, 800.0, SIZE)).max() < 0.4


def test_a_large_photo_is_searched_before_it_is_shrunk():
    """Corners are as exact as in the photo as it was stored, in pixels of the one that is worked with."""
    layout = grid("tag36h11", 6, 6)
    layout = layout.model_copy(update={"size": 0.018, "board": layout.board.model_copy(update={"gap": 0.006})})
    size, focal = (2700, 2100), 2600.0
    T = camera_around(30, 60, 0.42)
    grey = photo_of(sheet_picture(layout, 0.2, 0.2), T, focal, size)
    seen = seen_tags(grey, layout, 3).tags
    assert len(seen) == 36
    off = [
        np.linalg.norm(3 * seen[number] - pixels_of(corners, T, focal, size), axis=1)
        for number, corners in layout.corners().items()
    ]
    assert np.median(off) < 0.15


def test_small_tags_are_found():
    layout = grid("tag36h11", 5, 4)
    T = camera_around(20, 40, 0.75)
    grey = photo_of(sheet_picture(layout, 0.3, 0.24), T, 560.0, SIZE)
    side = np.linalg.norm(np.diff(pixels_of(layout.corners()[0], T, 560.0, SIZE)[:2], axis=0))
    assert side < 24
    assert len(seen_tags(grey, layout).tags) >= 19


def test_a_number_that_is_seen_twice_is_said_and_not_used():
    layout = grid("tag36h11")
    grey, _ = photo(layout)
    doubled = np.concatenate([grey, grey], axis=1)
    seen = seen_tags(doubled, layout)
    assert seen.tags == {} and seen.repeated == tuple(range(12))
    assert len(all_tags(doubled, "tag36h11")) == 24


@pytest.mark.parametrize(("stated", "shown"), [("tag36h11", "aruco_5x5_1000"), ("aruco_4x4_50", "tag25h9")])
def test_another_family_is_named(stated, shown):
    grey, _ = photo(grid(shown))
    assert not seen_tags(grey, grid(stated, 1, 1)).tags
    assert family_seen([grey], stated) == shown


def test_a_blank_photo_shows_no_family():
    assert family_seen([np.full((300, 400), 128, np.uint8)], "tag36h11") is None


@pytest.mark.parametrize("shape", [(5, 7), (4, 6), (6, 5)])
def test_boards_lie_as_opencv_draws_them(shape):
    columns, rows = shape
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_250)
    boards = {
        "grid": (cv2.aruco.GridBoard(shape, 0.03, 0.01, dictionary), 0.04 * columns - 0.01, 0.04 * rows - 0.01),
        "charuco": (cv2.aruco.CharucoBoard(shape, 0.04, 0.03, dictionary), 0.04 * columns, 0.04 * rows),
    }
    for kind, (theirs, width, height) in boards.items():
        length = {"square": 0.04} if kind == "charuco" else {"gap": 0.01}
        board = Board(kind=kind, columns=columns, rows=rows, **length)
        ours = TagLayout(family="aruco_6x6_250", size=0.03, board=board).corners()
        assert len(ours) == len(theirs.getIds())
        for number, corners in zip(theirs.getIds().ravel(), theirs.getObjPoints(), strict=True):
            x, y, z = np.asarray(corners).T  # theirs: origin at the top left, y down
            assert np.allclose(ours[number], np.stack([x - width / 2, height / 2 - y, z], axis=1), atol=1e-7)


def test_families_hold_as_many_tags_as_opencv_s():
    from pipeline.records.tag_layouts import opencv_name

    for family, (count, cells) in TAG_FAMILIES.items():
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(family)))
        assert (len(dictionary.bytesList), dictionary.markerSize) == (count, cells)
