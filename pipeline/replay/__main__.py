"""One trial again, alone: compared with its row, recorded, and played in a browser or written as a video.

`./dev replay synthesized/cube/soup_can/3` runs trial 3 of the pair cube and soup can with synthesized grasps, says
whether the outcome is that of the table to the last bit, and plays it at http://127.0.0.1:8080. With `--video FILE.mp4`
(or .gif) it writes a video instead. A recording (replays/*.parquet) in place of the trial is played without physics.
`--check 20` runs 20 trials of all tables again and only compares. Exit code 1: an outcome differs; 2: a trial cannot be
run as it was.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.evaluate.recorder import Recorder
from pipeline.evaluate.rerun import EXAMPLE, TrialName, differences, drawn_trials, known_trials, run_again, trial_name
from pipeline.hand.model import load_hand
from pipeline.pictures.film import FORMATS, Film, write_video
from pipeline.records.parameters import read_parameters
from pipeline.records.recordings import About, Recording, read_recording, write_recording
from pipeline.replay.renderers import RENDERERS
from pipeline.stages.running import command

if TYPE_CHECKING:
    from collections.abc import Sequence

SAME, DIFFERENT = 0, 1  # exit codes
RECORDINGS = Path("replays")


@dataclass(frozen=True)
class Showing:
    """What becomes of a recording."""

    video: Path | None
    film: Film
    renderer: str
    view: bool
    host: str
    port: int


def recording_file(name: TrialName) -> Path:
    """Where the recording of a trial is written."""
    return RECORDINGS / f"{'-'.join([name.source, *name.objects])}-{name.number}.parquet"


def replay(name: TrialName) -> tuple[Recording, int]:
    """Run one trial, say how it went, record it; return the recording and the exit code."""
    recorder = Recorder()
    inputs, row, differing = run_again(name, load_hand(read_parameters().hand), recorder)
    outcome = "success" if row["success"] else f"failed: {row['reason']}"
    verdict = "the same outcome, to the last bit, as in" if not differing else "ANOTHER outcome than in"
    print(f"{name}: {verdict} {name.table} ({outcome}, {row['steps']} steps of physics)")
    if differing:
        print(
            f"columns that differ: {', '.join(differing)}; `dvc status {name.stage}` says what has changed since the "
            "table was made"
        )
    objects = tuple(item.name for item in inputs.objects)
    shown = outcome if not differing else f"{outcome} (the table holds another outcome)"
    recording = recorder.recording(About(str(name), objects, shown, inputs.settings.sponge_height))
    target = recording_file(name)
    write_recording(target, recording)
    print(f"{target}: {len(recording.time)} moments, {recording.time[-1]:.2f} s")
    return recording, DIFFERENT if differing else SAME


def check(count: int, draw: int) -> int:
    """Run ``count`` trials of all tables again, each alone; return the exit code."""
    from pipeline.compute.fan_out import fan_out

    known = known_trials()
    chosen = drawn_trials(known, count, draw)
    parameters = read_parameters()
    again = partial(differences, load_hand(parameters.hand))
    found = fan_out(again, chosen, parameters.compute.workers, "trials again")
    for name, differing in zip(chosen, found, strict=True):
        print(f"{name}: {'differs in ' + ', '.join(differing) if differing else 'same'}")
    wrong = sum(bool(differing) for differing in found)
    print(
        f"{len(chosen) - wrong} of {len(chosen)} trials, drawn from {len(known)}, have the same outcome to the last bit"
    )
    return DIFFERENT if wrong else SAME


def show(recording: Recording, how: Showing) -> None:
    """Write the video, or play in a browser."""
    hand = load_hand(read_parameters().hand)
    if how.video:
        count = write_video(how.video, recording, hand, how.film, RENDERERS[how.renderer])
        print(f"{how.video}: {count} pictures, {how.film.rate:g} per second")
    if how.view:
        from pipeline.replay.viewer import Viewer

        viewer = Viewer(recording, hand, how.host, how.port)
        print(f"{viewer.address} plays it (Ctrl-C ends it)", flush=True)
        viewer.run()


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if not match or not all(64 <= int(part) <= 3840 and int(part) % 2 == 0 for part in match.groups()):
        raise argparse.ArgumentTypeError(f"{text!r}: write WIDTHxHEIGHT, both even, 64 to 3840, such as 640x480")
    return int(match[1]), int(match[2])


def _rate(text: str) -> float:
    value = float(text)
    if not 1 <= value <= 50:
        raise argparse.ArgumentTypeError(f"{text}: choose 1 to 50")
    return value


def _video(text: str) -> Path:
    if Path(text).suffix not in FORMATS:
        raise argparse.ArgumentTypeError(f"{text!r} must end in {' or '.join(FORMATS)}")
    return Path(text)


def command_line() -> argparse.ArgumentParser:
    """Return the options."""
    parser = argparse.ArgumentParser(
        prog="./dev replay", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "trial", nargs="?", help=f"source/first/second/number, such as {EXAMPLE}; or a recording of an earlier replay"
    )
    parser.add_argument("--check", type=int, metavar="N", help="run N trials of all tables again and compare")
    parser.add_argument("--draw", type=int, default=0, help="another number draws other trials (default: %(default)s)")
    parser.add_argument("--video", type=_video, metavar="FILE", help="write FILE.mp4 or FILE.gif, and do not play")
    parser.add_argument(
        "--size", type=_size, default=(480, 360), metavar="WxH", help="of the video, pixels (default: 480x360)"
    )
    parser.add_argument("--fps", type=_rate, default=10.0, help="pictures per second (default: %(default)s)")
    parser.add_argument(
        "--renderer",
        choices=list(RENDERERS),
        default=next(iter(RENDERERS)),
        help="of the video; sapien needs a Vulkan driver (default: %(default)s)",
    )
    parser.add_argument("--no-view", action="store_true", help="do not play: only compare and record")
    parser.add_argument("--port", type=int, default=8080, help="to play on; the next free one (default: %(default)s)")
    parser.add_argument("--host", default="127.0.0.1", help="to play on (default: %(default)s, this machine only)")
    return parser


@command("replay")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = command_line()
    chosen = parser.parse_args(arguments)
    if (chosen.trial is None) == (chosen.check is None):
        parser.error(f"name a trial, such as {EXAMPLE}, or give --check N")
    if chosen.check is not None and (chosen.check < 1 or chosen.video):
        parser.error("--check takes a number from 1 on, and goes without --video")
    if not 1 <= chosen.port <= 65535:
        parser.error("--port must be 1 to 65535")
    film = Film(width=chosen.size[0], height=chosen.size[1], rate=chosen.fps)
    how = Showing(chosen.video, film, chosen.renderer, not (chosen.no_view or chosen.video), chosen.host, chosen.port)
    if chosen.check is not None:
        return check(chosen.check, chosen.draw)
    if Path(chosen.trial).suffix == ".parquet":
        recording, code = read_recording(Path(chosen.trial)), SAME
    else:
        recording, code = replay(trial_name(chosen.trial))
    show(recording, how)
    return code


if __name__ == "__main__":
    raise SystemExit(main())
