"""A recording as a film: mp4 or GIF, drawn without a display."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFont

from pipeline.compute.progress import watched
from pipeline.hand.model import Hand
from pipeline.pictures.appearance import Appearance, appearance, moving_poses
from pipeline.pictures.camera import look_at
from pipeline.pictures.picture import CAPTION_HEIGHT, TEXT_SIZE, captioned
from pipeline.records.recordings import About, Recording
from pipeline.records.writing import check_writable, whole_file

FORMATS = (".mp4", ".gif")
CAMERA_POSITION, CAMERA_TARGET, CAMERA_DEGREES = (1.70, -1.00, 0.80), (0.33, -0.03, 0.335), 29.0
REACH = ((0.35, 0.0, 0.4), 0.95)  # ball (centre and radius, m) in which robot and objects cast shadows
LAST_SECONDS = 1.0  # for which the last picture stays, with the outcome below it
STILL = 5e-4  # rad and m; between moments that differ by less, no new picture is drawn
QUALITY = 20  # of x264: constant rate factor; 0 is lossless, 51 the worst
ENCODER = ("-preset", "veryfast", "-threads", "1")  # a third of the default's cost for a few kilobytes more

Picture = NDArray[np.uint8]  # (height, width, 3), sRGB
Poses = list[NDArray[np.float64]]  # see appearance.moving_poses
Draw = Callable[[Poses], Picture]


@dataclass(frozen=True)
class Film:
    """How a video is made."""

    width: int = 480  # pixels
    height: int = 360  # without the line of text
    rate: float = 10.0  # pictures per second


Renderer = Callable[[Appearance, Film], Draw]


def shown_moments(time: NDArray[np.float64], rate: float) -> NDArray[np.int64]:
    """Return for each picture, 1 / ``rate`` s apart, which moment is the nearest: an index into ``time`` (n,), s."""
    wanted = np.arange(time[0], time[-1] + 1e-9, 1 / rate)
    middles = (time[1:] + time[:-1]) / 2
    return np.searchsorted(middles, wanted).astype(np.int64)


def drawn_moments(recording: Recording, shown: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return for each shown moment whose picture serves: its own, or an earlier one's when all stood as now."""
    state = np.concatenate([recording.robot_q, *recording.poses], axis=1)
    serving: list[int] = []
    for moment in shown:
        still = serving and np.abs(state[moment] - state[serving[-1]]).max() < STILL
        serving.append(serving[-1] if still else int(moment))
    return np.array(serving, np.int64)


def write_video(target: Path, recording: Recording, hand: Hand, film: Film, renderer: Renderer) -> int:
    """Write a video; return the number of its pictures.

    Args:
        target: ends in .mp4 or .gif.
        renderer: :func:`raster`, or another one.

    Raises:
        UserError: the file cannot be written, or the renderer cannot be used.
    """
    check_writable(target)
    shown = shown_moments(recording.time, film.rate)
    last = max(round(LAST_SECONDS * film.rate), 1)
    pictures = _pictures(recording, hand, film, renderer, shown)

    def frames() -> Iterator[Picture]:
        for picture, moment in zip(pictures, shown.tolist(), strict=True):
            yield captioned(picture, f"{recording.time[moment]:5.2f} s   {recording.phase[moment]}")
        yield from [captioned(picture, last_caption(recording.about, film.width))] * last

    write = _write_gif if target.suffix == ".gif" else _write_mp4
    count = len(shown) + last
    with whole_file(target) as temporary:
        write(temporary, watched(frames(), count, f"drawing {target.name}"), film)
    return count


def write_film(target: Path, recordings: Sequence[Recording], hand: Hand, film: Film) -> None:
    """Write an mp4 of recordings one after the other, a picture per shown moment, without captions.

    Every picture can be found by its time alone: picture k is shown from k / rate on, and few depend on each other.
    """
    pictures = (
        picture
        for recording in recordings
        for picture in _pictures(recording, hand, film, raster, shown_moments(recording.time, film.rate))
    )
    with whole_file(target) as temporary:
        _write_mp4(temporary, pictures, film, film.height, ("-g", "2"))


def _pictures(
    recording: Recording, hand: Hand, film: Film, renderer: Renderer, shown: NDArray[np.int64]
) -> Iterator[Picture]:
    """Yield a picture per shown moment; a moment at which nothing has moved gets the last one again.

    Raises:
        UserError: the renderer cannot be used.
    """
    draw = renderer(appearance(recording, hand), film)
    drawn = -1
    for serving in drawn_moments(recording, shown).tolist():
        if serving != drawn:
            picture, drawn = draw(moving_poses(recording, hand, serving)), serving
        yield picture


def last_caption(about: About, width: int) -> str:
    """Return what is written below the last picture, ``width`` pixels wide: the outcome, and the trial if that fits."""
    text = f"{about.name}: {about.outcome}"
    return text if ImageFont.load_default(size=TEXT_SIZE).getlength(text) <= width - 16 else about.outcome


def raster(looks: Appearance, film: Film) -> Draw:
    """Return what draws the pictures of a film on the processor alone."""
    from pipeline.pictures.raster import Raster

    camera = look_at(CAMERA_POSITION, CAMERA_TARGET, CAMERA_DEGREES)
    pictures = Raster([*looks.moving, looks.sponge], camera, film.width, film.height, 0.0, REACH)
    return lambda poses: pictures.picture([*poses, looks.sponge.T_world])


def _write_mp4(
    target: Path, frames: Iterable[Picture], film: Film, height: int | None = None, options: Sequence[str] = ()
) -> None:
    """Write H.264 in the form that browsers play, beginning before the whole file is there.

    Args:
        height: of the pictures, pixels; None: that of the film with a caption.
        options: more of the encoder's.
    """
    writer = imageio_ffmpeg.write_frames(
        str(target),
        (film.width, film.height + CAPTION_HEIGHT if height is None else height),
        fps=film.rate,
        codec="libx264",
        macro_block_size=2,
        quality=None,
        output_params=["-f", "mp4", "-crf", str(QUALITY), "-movflags", "+faststart", *ENCODER, *options],
    )
    writer.send(None)
    with contextlib.closing(writer):
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))


def _write_gif(target: Path, frames: Iterable[Picture], film: Film) -> None:
    """Write a GIF with the colours of its first and middle pictures, so that none flickers."""
    pictures = [Image.fromarray(frame) for frame in frames]
    sample = Image.fromarray(np.concatenate([np.asarray(pictures[0]), np.asarray(pictures[len(pictures) // 2])]))
    palette = sample.quantize(256)
    few = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    few[0].save(
        target,
        format="GIF",
        save_all=True,
        append_images=few[1:],
        duration=1000 / film.rate,
        loop=0,
        optimize=False,
        disposal=1,
    )
