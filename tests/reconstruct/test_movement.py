"""An object that was moved divides its photos in two; gloss and faint texture do not."""

import numpy as np
import pytest

from pipeline.reconstruct.movement import check_at_rest, moved_before
from pipeline.reconstruct.plane_sweep import DepthMap, Window
from pipeline.records.errors import UserError

PAIRS = [(a, b) for b in range(16) for a in range(b) if b - a < 5 or b - a > 12]


def test_photos_before_and_after_a_move_contradict_each_other():
    pairs = {(a, b): (a < 9) != (b < 9) for a, b in PAIRS}
    first, share = moved_before(pairs)
    assert first == 9 and share == 1


@pytest.mark.parametrize("share", [0.1, 0.3, 0.6])
def test_contradictions_anywhere_are_no_move(share):
    random = np.random.default_rng(0)
    for _ in range(50):
        assert moved_before({pair: bool(random.random() < share) for pair in PAIRS}) is None


def test_one_photo_that_differs_is_no_move():
    assert moved_before({(a, b): 5 in (a, b) for a, b in PAIRS}) is None
    assert moved_before({}) is None


def test_likeness_and_depths_tell_and_the_photo_is_named():
    names = [f"photo_{k:03d}" for k in range(16)]
    empty = np.zeros((4, 4), np.float32)

    def maps(moved: int) -> list[DepthMap]:
        return [
            DepthMap(
                view,
                Window(0, 0, 4, 4),
                empty,
                empty,
                tuple((other, 0.3 if (view < moved) != (other < moved) else 0.9) for a, other in PAIRS if a == view),
            )
            for view in range(16)
        ]

    check_at_rest("can", [], maps(0), names)
    with pytest.raises(UserError, match="can was moved between the photos.*before photo_008 and"):
        check_at_rest("can", [], maps(8), names)
    depths = [(a, b, 0.6 if (a < 4) != (b < 4) else 0.01) for a, b in PAIRS]
    with pytest.raises(UserError, match="before photo_004 and"):
        check_at_rest("can", depths, maps(0), names)
