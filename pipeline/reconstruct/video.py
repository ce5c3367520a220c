"""Photos out of a video: frames that are sharp, and spread evenly over what the camera moved."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.reconstruct.inspection import sharpness_of
from pipeline.records.errors import UserError

SEARCHED = 640  # pixels, longer side of the frames that are searched; half of it where motion is followed
FEATURES, LEAST_FOLLOWED = 200, 12  # points that are followed, and without which a frame tells no motion
STEP = 2.0  # pixels of motion after which points are chosen anew, so that noise does not add up
LEAST_MOTION = 0.1  # of the longer side, summed over the video
MIDDLE = 0.5  # of a stretch, from which its frame is taken: two frames are half a stretch apart or more
WHOLE = 0.9  # of the length that the file states, that must be readable
JPEG_QUALITY = 95
SQUARE_PIXELS = "scale=trunc(iw*sar+0.5):ih,setsar=1"


@dataclass(frozen=True)
class Survey:
    """What every frame of a video was found to be; the arrays are (n,)."""

    moved: NDArray[np.float64]  # by how much the picture has moved until then, in parts of its longer side
    sharpness: NDArray[np.float64]


def _frames(path: Path, form: str, filters: str) -> Iterator[Any]:
    """Yield what imageio-ffmpeg tells of a video, then every frame (h, w) or (h, w, 3), upright.

    Raises:
        UserError: it is no video, or damaged.
    """
    logging.getLogger("imageio_ffmpeg").setLevel(logging.ERROR)  # it warns of every change of size
    parameters = ["-vf", filters, "-fps_mode", "passthrough"]
    channels = 1 if form == "gray" else 3
    reader = imageio_ffmpeg.read_frames(
        str(path), pix_fmt=form, bits_per_pixel=8 * channels, input_params=["-nostdin"], output_params=parameters
    )
    with contextlib.closing(reader):
        try:
            told = next(reader)
            yield told
            width, height = told["size"]
            shape = (height, width) if channels == 1 else (height, width, channels)
            for frame in reader:
                yield np.frombuffer(frame, np.uint8).reshape(shape)
        except (OSError, RuntimeError, ValueError, LookupError, AssertionError, StopIteration) as error:
            raise UserError(
                f"{path} is no video that can be read, or damaged; copy it from the camera again."
            ) from error


class Motion:
    """How far a picture has moved since the first one, along its way."""

    def __init__(self) -> None:
        self._sum, self._since = 0.0, 0.0
        self._reference: NDArray[np.uint8] | None = None
        self._previous: NDArray[np.uint8] | None = None

    def moved(self, grey: NDArray[np.uint8]) -> float:
        """Return the way (pixels) up to the next frame (h, w): the mean over all points that can be followed.

        The mean, as before a resting camera only some of the points move.
        """
        if self._reference is None or self._previous is None:
            self._reference = self._previous = grey
            return 0.0
        way = _mean_motion(self._reference, grey)
        if way is None:  # too far from the reference: go on from the frame before
            self._sum, self._reference = self._sum + self._since, self._previous
            way = _mean_motion(self._reference, grey) or 0.0
        self._previous, self._since = grey, way
        if way > STEP:
            self._sum, self._since, self._reference = self._sum + way, 0.0, grey
        return self._sum + self._since


def _mean_motion(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float | None:
    """Return by how many pixels points move between two frames (h, w), on average; None if too few can be followed."""
    points = cv2.goodFeaturesToTrack(one, FEATURES, 0.01, 5)
    if points is None or len(points) < LEAST_FOLLOWED:
        return None
    there, found, _ = cv2.calcOpticalFlowPyrLK(one, other, points, np.zeros_like(points))
    back, again, _ = cv2.calcOpticalFlowPyrLK(other, one, there, np.zeros_like(there))
    followed = (found.ravel() > 0) & (again.ravel() > 0)
    followed &= np.linalg.norm((back - points)[:, 0], axis=1) < 0.5
    if followed.sum() < max(LEAST_FOLLOWED, len(points) // 4):
        return None
    return float(np.linalg.norm((there - points)[followed, 0], axis=1).mean())


def survey(path: Path, watch: Callable[[Iterable[Any], int], Iterable[Any]]) -> Survey:
    """Return how far the picture has moved at every frame, and how sharp each is.

    Args:
        watch: yields the frames unchanged, given about how many there are.

    Raises:
        UserError: the file is no video, damaged, or ends early.
    """
    if not path.is_file():
        raise UserError(f"there is no video {path}; check the name.")
    side = f"scale=w='if(gte(iw,ih),min(iw,{SEARCHED}),-2)':h='if(gte(iw,ih),-2,min(ih,{SEARCHED}))'"
    frames = _frames(path, "gray", f"{SQUARE_PIXELS},{side}")
    told = next(frames)
    expected = float(told["duration"]) * float(told["fps"])
    motion, moved, sharp = Motion(), [], []
    for grey in watch(frames, round(expected)):
        sharp.append(sharpness_of(grey))
        small = np.asarray(cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8)
        moved.append(motion.moved(small) / max(small.shape))
    if len(moved) < WHOLE * expected - 2:
        raise UserError(
            f"{path} is damaged: of about {expected:.0f} frames only {len(moved)} can be read; copy it from the camera "
            "again."
        )
    return Survey(np.array(moved), np.array(sharp))


def chosen_frames(found: Survey, count: int) -> list[int]:
    """Return the numbers of at most ``count`` frames: of equal stretches of the way, the sharpest in the middle.

    A stretch that no frame lies in, as the camera moved too fast, gives none.
    """
    stretch = float(found.moved[-1]) / count
    chosen = []
    for number in range(count):
        off = np.abs(found.moved / stretch - number - 0.5)
        own = np.flatnonzero(off <= MIDDLE / 2)
        if not len(own):
            own = np.flatnonzero(off < 0.5)
        if len(own):
            chosen.append(int(own[found.sharpness[own].argmax()]))
    return chosen


def check_survey(path: Path, found: Survey, count: int) -> None:
    """Refuse a video that cannot give as many photos.

    Raises:
        UserError: it is too short, or hardly moves.
    """
    if len(found.moved) < count:
        raise UserError(
            f"{path} has only {len(found.moved)} frames; film for a minute all around the objects, or ask for fewer "
            "photos (--count)."
        )
    if found.moved[-1] < LEAST_MOTION:
        raise UserError(
            f"{path} hardly moves (by {found.moved[-1]:.1%} of the picture in all), or shows nothing that can be "
            "followed; walk around the objects, or turn the sheet, while filming."
        )


def write_frames(path: Path, numbers: Sequence[int], folder: Path) -> None:
    """Write frames of a video at full size as ``frame_001.jpg`` and so on, in their order.

    Raises:
        UserError: the video is damaged.
    """
    wanted = "+".join(f"eq(n\\,{number})" for number in numbers)
    frames = _frames(path, "rgb24", f"select='{wanted}',{SQUARE_PIXELS}")
    next(frames)
    written = 0
    for colours in frames:
        written += 1
        Image.fromarray(colours).save(folder / f"frame_{written:03d}.jpg", quality=JPEG_QUALITY, subsampling=0)
    if written != len(numbers):
        raise UserError(f"{path} is damaged: {written} of {len(numbers)} frames could be read twice; copy it again.")
