"""A folder ready for a data hub: `./dev publish-dataset FOLDER` publishes the grasps of this clone.

The folder gets accepted grasps as parquet by split, the objects' meshes, README.md with the header that hubs read,
croissant.json, checksums, the trained model with a card, and trials as a LeRobot v3 data set. Nothing is uploaded.
Exit code: 0; 2 when something is missing, and one sentence says what; the folder is written whole or not at all.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.hands import ALLEGRO
from pipeline.records.parameters import read_parameters
from pipeline.records.reading import read_json
from pipeline.records.sources import OF_ALL_PAIRS, SOURCES
from pipeline.records.writing import check_writable, json_text, whole_folder
from pipeline.share.croissant import croissant
from pipeline.share.grasps import grasps_of, pairs_asked_for
from pipeline.share.hub_card import dataset_card, model_card
from pipeline.share.project import open_project
from pipeline.share.publication import (
    CARD,
    CROISSANT,
    TEST,
    TRAIN,
    Split,
    write_checksums,
    write_split,
)
from pipeline.stages.running import command

if TYPE_CHECKING:
    from pipeline.evaluate.rerun import TrialName

TITLE = "Sequential grasping: two objects in one hand"
NAME = "sequential-grasping"
VERSION = "1.0.0"
URL = "https://example.org/sequential-grasping"  # where nobody has said another place
FREE, NAMED = "MIT", "CC-BY-4.0"  # of recipes, and of scans whose authors must be named
MODEL_FILES = ("model.safetensors", "model.json", "history.csv")


def command_line() -> argparse.ArgumentParser:
    """Return the parser."""
    parser = argparse.ArgumentParser(
        prog="./dev publish-dataset", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("output", type=Path, metavar="FOLDER", help="to write; it must not exist yet")
    parser.add_argument("--folder", type=Path, default=Path(), help=argparse.SUPPRESS)  # where ./dev was called
    parser.add_argument("--title", default=TITLE, help="of the data set (default: %(default)s)")
    parser.add_argument("--url", default=URL, help="where the data set will be found (default: %(default)s)")
    parser.add_argument(
        "--trials", type=int, default=4, metavar="N", help="record N trials again (default: 4; 0: none)"
    )
    parser.add_argument("--no-video", action="store_true", help="trials without a film, which takes most of the time")
    parser.add_argument("--fps", type=int, default=10, help="rows and pictures of trials per second (default: 10)")
    return parser


def publish(chosen: argparse.Namespace) -> Path:
    """Write the folder and return it.

    Raises:
        UserError: the folder is there already, or results are missing.
    """
    target: Path = chosen.folder / chosen.output
    if target.exists():
        raise UserError(f"{target} is there already; remove it or name another folder.")
    if not 1 <= chosen.fps <= 50 or chosen.trials < 0:
        raise UserError("--fps must be 1 to 50, and --trials 0 or more.")
    check_writable(target)
    config = _model_config()
    with whole_folder(target) as folder:
        splits, names = _write_grasps(folder, config)
        objects = _write_objects(folder, names)
        licence = NAMED if any("CC" in own["licence"] for own in objects) else FREE
        if config is not None:
            _write_model(folder / "model", config, chosen.title)
        recorded = _write_trials(folder / "trials", chosen) if chosen.trials else 0
        if Path("reports/dataset.md").is_file():
            shutil.copyfile("reports/dataset.md", folder / "dataset.md")
        card = dataset_card(chosen.title, licence, splits, objects, recorded, config is not None)
        (folder / CARD).write_text(card, encoding="utf-8")
        text = f"{sum(own.rows for own in splits)} grasps of two objects in one Allegro hand, checked in physics."
        (folder / CROISSANT).write_text(json_text(croissant(NAME, text, licence, chosen.url, VERSION, _date(), splits)))
        write_checksums(folder)
    counts = ", ".join(f"{own.rows} {own.source} ({own.name})" for own in splits)
    print(f"{target}: {counts}; {len(objects)} objects; {recorded} trials; model: {'yes' if config else 'no'}")
    return target


def _date() -> str:
    """Return the day of the clone's last commit, or today where there is none."""
    commit = subprocess.run(["git", "log", "-1", "--format=%cs"], capture_output=True, text=True)
    return commit.stdout.strip() or date.today().isoformat()


def _model_config() -> Mapping[str, Any] | None:
    """Return the content of ``model.json``, None where no model was trained."""
    source = paths.MODEL_FOLDER / "model.json"
    return read_json(source, "run `dvc repro train` to make it again") if source.is_file() else None


def _write_grasps(folder: Path, config: Mapping[str, Any] | None) -> tuple[list[Split], list[str]]:
    """Write the tables of all sources that there are; return them, and the names of all objects."""
    from pipeline.model.held_out import unseen_rows

    splits = []
    with open_project(".") as project:
        pairs = pairs_asked_for(project)
        for source in OF_ALL_PAIRS:
            if not any(SOURCES[source].table(first).is_file() for first, _ in pairs):
                continue
            grasps = grasps_of(project, pairs, [source], only_accepted=True)
            if not SOURCES[source].of_single_grasps or config is None:
                parts = {TRAIN if SOURCES[source].of_single_grasps else TEST: grasps}
            else:
                unseen = unseen_rows(grasps, config["held_out"])
                parts = {TRAIN: grasps[~unseen], TEST: grasps[unseen]}
            splits += [write_split(folder, source, name, own) for name, own in parts.items() if len(own)]
    if not splits:
        raise UserError(
            f"there are no accepted grasps in {SOURCES['synthesized'].folder}; run `dvc repro merge` first."
        )
    return splits, sorted({name for pair in pairs for name in pair})


def _write_objects(folder: Path, names: Sequence[str]) -> list[dict[str, str]]:
    """Copy the meshes and return name, source and licence of each object."""
    found = []
    (folder / "objects").mkdir()
    for name in names:
        own = paths.prepared_folder(name)
        provenance = read_json(own / "object.json", "run `dvc repro prepare` to make it")["provenance"]
        shutil.copyfile(own / "mesh.ply", folder / f"objects/{name}.ply")
        found.append({"name": name, "source": str(provenance["source"]), "licence": str(provenance["licence"])})
    return found


def _write_model(folder: Path, config: Mapping[str, Any], title: str) -> None:
    folder.mkdir()
    for name in MODEL_FILES:
        shutil.copyfile(paths.MODEL_FOLDER / name, folder / name)
    summary = json.loads(paths.SUMMARY_FILE.read_text()) if paths.SUMMARY_FILE.is_file() else {}
    (folder / CARD).write_text(model_card(title, config, summary), encoding="utf-8")


def _write_trials(folder: Path, chosen: argparse.Namespace) -> int:
    """Record trials, as evenly spread over the tables as can be, and return how many."""
    from functools import partial

    from pipeline.compute.fan_out import fan_out
    from pipeline.evaluate.rerun import known_trials
    from pipeline.hand.model import load_hand
    from pipeline.pictures.film import Film
    from pipeline.share.episodes import record, write_episodes

    workers = read_parameters().compute.workers
    hand = load_hand(ALLEGRO)
    standard = [name for name in known_trials() if name.source in OF_ALL_PAIRS]
    names = _spread(standard, chosen.trials)
    episodes = fan_out(partial(record, hand=hand), names, workers, "record")
    folder.mkdir()
    write_episodes(folder, episodes, hand, Film(320, 240, chosen.fps), not chosen.no_video)
    return len(episodes)


def _spread(names: Sequence[TrialName], count: int) -> list[TrialName]:
    """Return ``count`` of the trials, all if there are fewer, at equal distances."""
    if count >= len(names):
        return list(names)
    return [names[(2 * index + 1) * len(names) // (2 * count)] for index in range(count)]


@command("publish-dataset")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    publish(command_line().parse_args(arguments))
    return 0


if __name__ == "__main__":
    sys.exit(main())
