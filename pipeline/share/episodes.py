"""Trials as a LeRobot v3 data set: what the robot measured and its targets, where objects were, phases, task and film.

Layout, as LeRobot 0.4 reads it::

    meta/info.json, meta/stats.json         features and their statistics
    meta/tasks.parquet, meta/subtasks.parquet   texts of the tasks, and of the phases
    meta/episodes/chunk-000/file-000.parquet    an episode per row
    data/chunk-000/file-000.parquet             a moment per row
    videos/observation.images.scene/chunk-000/file-000.mp4   all episodes one after the other
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.evaluate.execution import Run
from pipeline.evaluate.recorder import Recorder
from pipeline.evaluate.rerun import TrialName, run_again
from pipeline.hand.model import Hand
from pipeline.hand.robot import robot_joint_names
from pipeline.pictures.film import Film, shown_moments, write_film
from pipeline.records.errors import UserError
from pipeline.records.recordings import About, Recording
from pipeline.records.writing import json_text

VERSION = "v3.0"  # of LeRobot's format
ROBOT = "panda_allegro_right"
CAMERA = "observation.images.scene"
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
FIRST = FILE.format(chunk_index=0, file_index=0)
NUMBERS = ("timestamp", "frame_index", "episode_index", "index", "task_index", "subtask_index")
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")


@dataclass
class TargetRecorder(Recorder):
    """Writes down every moment of a run, and the targets of the robot then."""

    targets: list[NDArray[np.float64]] = field(default_factory=list)

    def __call__(self, run: Run) -> None:
        """Write down one moment."""
        super().__call__(run)
        self.targets.append(np.concatenate([run.posture.arm, run.posture.hand]))


@dataclass(frozen=True)
class Episode:
    """A trial over time."""

    name: TrialName
    row: dict[str, Any]  # of the table of trials
    recording: Recording
    targets: NDArray[np.float64]  # (n, R) rad, targets of the robot at each of the n moments of the recording

    @property
    def task(self) -> str:
        """What was to be done, as a sentence."""
        first, *others = (name.replace("_", " ") for name in self.name.objects)
        return (
            f"Pick up the {first} and keep it in the hand"
            + "".join(f", then pick up the {name}" for name in others)
            + "."
        )


def record(name: TrialName, hand: Hand) -> Episode:
    """Run a trial of the tables again and record it.

    Raises:
        UserError: an input is missing or has changed, or the trial goes otherwise than in its table.
    """
    recorder = TargetRecorder()
    inputs, row, differing = run_again(name, hand, recorder)
    if differing:
        raise UserError(
            f"{name} goes otherwise here than in {name.table} (in {', '.join(differing)}); run "
            f"`dvc repro {name.stage}` for a table of this machine, or leave trials out with --trials 0."
        )
    outcome = "success" if row["success"] else f"failed: {row['reason']}"
    about = About(str(name), tuple(item.name for item in inputs.objects), outcome, inputs.settings.sponge_height)
    return Episode(name, row, recorder.recording(about), np.array(recorder.targets))


def columns_of(episodes: Sequence[Episode], rate: float) -> dict[str, NDArray[Any]]:
    """Return the columns of all moments that are shared, ``rate`` per second."""
    tasks = list(dict.fromkeys(episode.task for episode in episodes))
    phases = phases_of(episodes)
    parts: list[dict[str, NDArray[Any]]] = []
    begin = 0
    for number, episode in enumerate(episodes):
        shown = shown_moments(episode.recording.time, rate)
        count = len(shown)
        parts.append(
            {
                "observation.state": episode.recording.robot_q[shown].astype(np.float32),
                "observation.environment_state": np.concatenate(episode.recording.poses[:, shown], axis=1).astype(
                    np.float32
                ),
                "action": episode.targets[shown].astype(np.float32),
                "timestamp": (np.arange(count) / rate).astype(np.float32),
                "frame_index": np.arange(count),
                "episode_index": np.full(count, number),
                "index": begin + np.arange(count),
                "task_index": np.full(count, tasks.index(episode.task)),
                "subtask_index": np.array([phases.index(episode.recording.phase[moment]) for moment in shown]),
            }
        )
        begin += count
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def phases_of(episodes: Sequence[Episode]) -> list[str]:
    """Return the names of all phases, in the order in which they come."""
    return list(dict.fromkeys(phase for episode in episodes for phase in episode.recording.phase))


def write_episodes(folder: Path, episodes: Sequence[Episode], hand: Hand, film: Film, videos: bool) -> None:
    """Write a data set; the same trials give the same bytes, but for the video.

    Args:
        film: its rate is that of the rows, too.
        videos: with a film of every episode.
    """
    if len({len(episode.name.objects) for episode in episodes}) > 1:
        raise UserError("the trials are of two objects and of more; choose sources with as many objects.")
    columns = columns_of(episodes, film.rate)
    lengths = np.bincount(columns["episode_index"], minlength=len(episodes))
    for path in ("meta/episodes/chunk-000", "data/chunk-000"):
        (folder / path).mkdir(parents=True)
    pq.write_table(_table(columns), folder / f"data/{FIRST}.parquet", compression="zstd")
    tasks = list(dict.fromkeys(episode.task for episode in episodes))
    for name, texts in (("task", tasks), ("subtask", phases_of(episodes))):
        numbered = pd.DataFrame({f"{name}_index": np.arange(len(texts))}, index=pd.Index(texts, name=name))
        numbered.to_parquet(folder / f"meta/{name}s.parquet")
    rows = [
        _episode_row(number, episode, columns, lengths, film.rate, videos) for number, episode in enumerate(episodes)
    ]
    pq.write_table(pa.Table.from_pylist(rows), folder / f"meta/episodes/{FIRST}.parquet", compression="zstd")
    (folder / "meta/stats.json").write_text(json_text({name: statistics(values) for name, values in columns.items()}))
    info = information(episodes, columns, hand, film, videos)
    (folder / "meta/info.json").write_text(json_text(info))
    if videos:
        target = folder / f"videos/{CAMERA}/{FIRST}.mp4"
        target.parent.mkdir(parents=True)
        write_film(target, [episode.recording for episode in episodes], hand, film)


def _table(columns: dict[str, NDArray[Any]]) -> pa.Table:
    arrays = {}
    for name, values in columns.items():
        if values.ndim == 1:
            arrays[name] = pa.array(values)
        else:
            arrays[name] = pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
    return pa.table(arrays)


def statistics(values: NDArray[Any]) -> dict[str, list[float]]:
    """Return minimum, maximum, mean, standard deviation and count of columns (n,) or (n, m)."""
    rows = np.asarray(values, np.float64).reshape(len(values), -1)
    found = {name: getattr(rows, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
    return found | {"count": [len(rows)]}


def _episode_row(
    number: int,
    episode: Episode,
    columns: dict[str, NDArray[Any]],
    lengths: NDArray[np.int64],
    rate: float,
    videos: bool,
) -> dict[str, Any]:
    begin = int(lengths[:number].sum())
    row: dict[str, Any] = {
        "episode_index": number,
        "tasks": [episode.task],
        "length": int(lengths[number]),
        "dataset_from_index": begin,
        "dataset_to_index": begin + int(lengths[number]),
        "data/chunk_index": 0,
        "data/file_index": 0,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
        "trial": str(episode.name),
        "merged_id": int(episode.row["merged_id"]),
        "success": bool(episode.row["success"]),
        "reason": str(episode.row["reason"]),
    }
    if videos:
        row |= {
            f"videos/{CAMERA}/chunk_index": 0,
            f"videos/{CAMERA}/file_index": 0,
            f"videos/{CAMERA}/from_timestamp": begin / rate,
            f"videos/{CAMERA}/to_timestamp": (begin + int(lengths[number])) / rate,
        }
    own = columns["episode_index"] == number
    for name, values in columns.items():
        row |= {f"stats/{name}/{kind}": numbers for kind, numbers in statistics(values[own]).items()}
    return row


def information(
    episodes: Sequence[Episode], columns: dict[str, NDArray[Any]], hand: Hand, film: Film, videos: bool
) -> dict[str, Any]:
    """Return the content of ``info.json``."""
    joints = list(robot_joint_names(hand))
    places = [f"object{number}.{part}" for number in range(len(episodes[0].name.objects)) for part in POSE]
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(names)], "names": names}
        for name, names in (
            ("observation.state", joints),
            ("observation.environment_state", places),
            ("action", joints),
        )
    }
    features |= {
        name: {"dtype": "float32" if name == "timestamp" else "int64", "shape": [1], "names": None} for name in NUMBERS
    }
    if videos:
        facts = {"height": film.height, "width": film.width, "codec": "h264", "pix_fmt": "yuv420p", "fps": film.rate}
        features[CAMERA] = {
            "dtype": "video",
            "shape": [film.height, film.width, 3],
            "names": ["height", "width", "channels"],
            "info": {f"video.{name}": value for name, value in facts.items()}
            | {"video.channels": 3, "video.is_depth_map": False, "has_audio": False},
        }
    return {
        "codebase_version": VERSION,
        "robot_type": ROBOT,
        "total_episodes": len(episodes),
        "total_frames": len(columns["index"]),
        "total_tasks": len({episode.task for episode in episodes}),
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": int(film.rate),
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": f"data/{FILE}.parquet",
        "video_path": f"videos/{{video_key}}/{FILE}.mp4" if videos else None,
        "features": features,
    }
