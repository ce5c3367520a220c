"""Films one successful trial for the report: ``reports/film``.

`python -m pipeline.evaluate.film` takes the first pair with a successful trial, in the order of the sources and of
params.yaml, runs that trial again and draws it. `trial.json` says which one it is, or that none succeeded.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import islice
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.opening_film import FOLDER, VIDEO, write_about
from pipeline.records.parameters import load_parameters
from pipeline.records.writing import whole_folder
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.evaluate.rerun import TrialName
    from pipeline.hand.model import Hand
    from pipeline.pictures.film import Film
    from pipeline.records.recordings import Recording

WIDTH, HEIGHT, RATE = 400, 300, 8.0  # pixels, pictures per second: some 300 KB, which ride in the page
MOST_RUN_AGAIN = 3  # trials, where some do not succeed again: their table may come from another processor


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the film depends on."""
    return ["hand", "seed", "styles", "pairs", "reconstructed", "picks", "physics", "evaluate"]


def successful_trials(parameters: dict[str, Any]) -> Iterator[TrialName]:
    """Yield the first successful trial of every pair or longer sequence that has one.

    Raises:
        UserError: a table of trials is missing or damaged.
    """
    from pipeline.evaluate.inputs import sequences_of
    from pipeline.evaluate.rerun import TrialName
    from pipeline.records.kept import kept_table
    from pipeline.records.sources import SOURCES
    from pipeline.records.tables import TRIALS, rows_of

    for source in SOURCES:
        for objects in sequences_of(source, parameters):
            rows = rows_of(kept_table(paths.trials_file(source, objects[0]), TRIALS, f"evaluate@{source}"), objects)
            good = rows[rows["success"].astype(bool)]
            if len(good):
                yield TrialName(source, objects, int(good["trial"].min()))


def filmed(name: TrialName, hand: Hand) -> Recording | None:
    """Run a trial again and return its recording; None where it does not succeed this time.

    Raises:
        UserError: it cannot be run as it was.
    """
    from pipeline.evaluate.recorder import Recorder
    from pipeline.evaluate.rerun import run_again
    from pipeline.records.recordings import About

    recorder = Recorder()
    inputs, row, differing = run_again(name, hand, recorder)
    if differing:
        print(f"{name} went otherwise than in {name.table}: {', '.join(differing)}")
    if not row["success"]:
        return None
    objects = tuple(item.name for item in inputs.objects)
    return recorder.recording(About(str(name), objects, "success", inputs.settings.sponge_height))


def write_film(film: Film) -> None:
    """Run a successful trial again and write what the report shows of it.

    Raises:
        UserError: an input is missing or damaged, or the folder cannot be written to.
    """
    from pipeline.hand.model import load_hand
    from pipeline.hand.robot import require_arm
    from pipeline.pictures.film import raster, write_video

    parameters = load_parameters(sections())
    hand = load_hand(parameters["hand"])
    require_arm(hand)
    names = islice(successful_trials(parameters), MOST_RUN_AGAIN)
    found = next(((name, recording) for name in names if (recording := filmed(name, hand))), None)
    with whole_folder(FOLDER) as folder:
        if found is None:
            write_about(folder, None)
            return
        name, recording = found
        write_about(folder, (name.source, name.objects, name.number))
        write_video(folder / VIDEO, recording, hand, film, raster)


def work() -> None:
    """Write the film of the report."""
    from pipeline.pictures.film import Film

    write_film(Film(WIDTH, HEIGHT, RATE))


def main() -> int:
    """Parse the command line and run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.evaluate.film",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.parse_args()
    return run_stage("film", work)


if __name__ == "__main__":
    raise SystemExit(main())
