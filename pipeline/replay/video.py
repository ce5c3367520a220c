"""A recording as a film: mp4 or GIF, drawn without a display."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFont

from pipeline.compute.fan_out import fan_out
from pipeline.compute.progress import watched
from pipeline.compute.shared import Shared
from pipeline.hand.model import Hand
from pipeline.pictures.camera import look_at
from pipeline.pictures.picture import CAPTION_HEIGHT, TEXT_SIZE, captioned
from pipeline.pictures.render import render
from pipeline.records.errors import UserError
from pipeline.records.writing import check_writable, whole_file
from pipeline.replay.appearance import Appearance, appearance, bodies_at, moving_poses
from pipeline.replay.recording import About, Recording

FORMATS = (".mp4", ".gif")
RENDERERS = ("auto", "rays", "sapien")
CAMERA_POSITION, CAMERA_TARGET, CAMERA_DEGREES = (1.70, -1.00, 0.80), (0.33, -0.03, 0.335), 29.0
LAST_SECONDS = 1.0  # for which the last picture stays, with the outcome below it
STILL = 5e-4  # rad and m; between moments that differ by less, no new picture is drawn
QUALITY = 20  # of x264: constant rate factor; 0 is lossless, 51 the worst

Picture = NDArray[np.uint8]  # (height, width, 3), sRGB
Poses = list[NDArray[np.float64]]  # see appearance.moving_poses


@dataclass(frozen=True)
class Film:
    """How a video is made."""

    width: int = 480  # pixels
    height: int = 360  # without the line of text
    rate: float = 10.0  # pictures per second


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


def write_video(
    target: Path, recording: Recording, hand: Hand, film: Film, renderer: str, workers: int
) -> tuple[int, str]:
    """Write a video; return the number of its pictures, and what drew them.

    Args:
        target: ends in .mp4 or .gif.
        renderer: ``rays``, ``sapien``, or ``auto``: SAPIEN's where it finds a driver.
        workers: processes that cast rays; see ``compute.fan_out``.

    Raises:
        UserError: the file cannot be written, or the renderer cannot be used.
    """
    check_writable(target)
    pictures, shown, chosen = _pictures(recording, hand, film, renderer, workers)
    frames = [
        (picture, f"{recording.time[moment]:5.2f} s   {recording.phase[moment]}")
        for picture, moment in zip(pictures, shown.tolist(), strict=True)
    ]
    frames += [(frames[-1][0], last_caption(recording.about, film.width))] * max(round(LAST_SECONDS * film.rate), 1)
    write = _write_gif if target.suffix == ".gif" else _write_mp4
    with whole_file(target) as temporary:
        write(temporary, watched(map(_frame, frames), len(frames), f"writing {target.name}"), film)
    return len(frames), chosen


def write_film(target: Path, recordings: Sequence[Recording], hand: Hand, film: Film, workers: int) -> None:
    """Write an mp4 of recordings one after the other, a picture per shown moment, without captions.

    Every picture can be found by its time alone: picture k is shown from k / rate on, and few depend on each other.
    """
    frames = [png for recording in recordings for png in _pictures(recording, hand, film, "rays", workers)[0]]
    with whole_file(target) as temporary:
        _write_mp4(temporary, (_decoded(png) for png in frames), film, film.height, ("-g", "2"))


def _pictures(
    recording: Recording, hand: Hand, film: Film, renderer: str, workers: int
) -> tuple[list[bytes], NDArray[np.int64], str]:
    """Return a PNG per shown moment, the moments, and what drew them."""
    shown = shown_moments(recording.time, film.rate)
    serving = drawn_moments(recording, shown)
    looks = appearance(recording, hand)
    distinct = list(dict.fromkeys(serving.tolist()))
    chosen = _choose(renderer)
    draw = _draw_with_sapien if chosen == "sapien" else _draw_with_rays
    drawn = draw(looks, [moving_poses(recording, hand, moment) for moment in distinct], film, workers)
    pictures = dict(zip(distinct, drawn, strict=True))
    return [pictures[served] for served in serving.tolist()], shown, chosen


def last_caption(about: About, width: int) -> str:
    """Return what is written below the last picture, ``width`` pixels wide: the outcome, and the trial if that fits."""
    text = f"{about.name}: {about.outcome}"
    return text if ImageFont.load_default(size=TEXT_SIZE).getlength(text) <= width - 16 else about.outcome


def _choose(renderer: str) -> str:
    if renderer == "rays":
        return "rays"
    from pipeline.replay.sapien_camera import why_unusable

    reason = why_unusable()
    if reason and renderer == "sapien":
        raise UserError(f"SAPIEN's renderer cannot be used ({reason}); take `--renderer rays`.")
    return "rays" if reason else "sapien"


def _draw_with_sapien(looks: Appearance, moments: Sequence[Poses], film: Film, workers: int) -> list[bytes]:
    """Return PNGs of moments, drawn in this process whatever ``workers`` is."""
    from pipeline.replay.sapien_camera import SapienCamera

    camera = SapienCamera(looks, film.width, film.height, (CAMERA_POSITION, CAMERA_TARGET, CAMERA_DEGREES))
    return [_png(camera.picture(poses)) for poses in watched(moments, len(moments), "drawing with SAPIEN")]


def _draw_with_rays(looks: Appearance, moments: Sequence[Poses], film: Film, workers: int) -> list[bytes]:
    """Return PNGs of moments."""
    with Shared((looks, film)) as shared:
        return fan_out(partial(_ray_cast, shared), moments, workers, "drawing")


def _ray_cast(shared: Shared[tuple[Appearance, Film]], poses: Poses) -> bytes:
    """Return a PNG of one moment."""
    looks, film = shared.value
    camera = look_at(CAMERA_POSITION, CAMERA_TARGET, CAMERA_DEGREES)
    return _png(render(bodies_at(looks, poses), camera, film.width, film.height, floor=0.0))


def _png(picture: Picture) -> bytes:

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="PNG", compress_level=1)
    return buffer.getvalue()


def _frame(content: tuple[bytes, str]) -> Picture:
    """Return a picture, given as PNG, with its caption."""
    png, caption = content
    return captioned(_decoded(png), caption)


def _decoded(png: bytes) -> Picture:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


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
        output_params=["-f", "mp4", "-crf", str(QUALITY), "-movflags", "+faststart", *options],
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
