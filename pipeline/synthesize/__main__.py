"""Synthesize grasp candidates in one style: ``data/synthesize/<style>/<object>.parquet``.

`python -m pipeline.synthesize --style pinch` brings all objects of the style up to date, `--object cube` makes the
candidates of one by hand.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.digests import digest, hand_digest, prepared_digest
from pipeline.records.errors import UserError
from pipeline.records.objects import load_prepared_object
from pipeline.records.parameters import load_with_workers
from pipeline.records.parameters.picks import narrowed, pick_of, waiting_fingers
from pipeline.records.tables import CANDIDATES, of_hand
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, fingerprints_of, make_by_hand, make_items
from pipeline.stages.outputs import Tables
from pipeline.stages.running import run_stage

if TYPE_CHECKING:
    from pipeline.compute.pool import Work
    from pipeline.records.parameters.synthesize import StyleParameters


def sections(style: str) -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return [
        "hand",
        "seed",
        f"styles.{style}",
        "picks",
        "synthesize.energy",
        "synthesize.optimizer",
        f"synthesize.{style}",
    ]


def synthesize(style: str, only: str) -> None:
    """Make the candidates of the objects that are not up to date, or of one by hand."""
    parameters, workers = load_with_workers(sections(style))
    names = [only] if only else parameters.pop(f"styles.{style}")
    digests, refused = fingerprints_of(names, prepared_digest)
    if only and refused:
        raise UserError(refused[only])
    picks, base = parameters.pop("picks"), parameters.pop(f"synthesize.{style}")

    def asked(name: str) -> tuple[StyleParameters, tuple[str, ...]]:
        """Return the settings for an object, and the fingers that are straight, as they pick other objects later."""
        number = pick_of(picks, style, name)
        return (base, ()) if number is None else (narrowed(base, picks[number]), waiting_fingers(picks, number))

    from pipeline.hand.model import load_hand
    from pipeline.synthesize.candidates import Request, synthesis

    hand = load_hand(parameters["hand"])
    hand.style(style)
    tables = Tables(paths.candidates_file(style, "").parent, of_hand(CANDIDATES, hand.name, hand.joint_count))
    stage = Stage(f"synthesize@{style}", "objects", tables)

    def work(name: str, keep: Keep) -> Work[None]:
        settings, waiting = asked(name)
        request = Request(
            prepared=load_prepared_object(name),
            style=style,
            run_seed=parameters["seed"],
            energy=parameters["synthesize.energy"],
            optimizer=parameters["synthesize.optimizer"],
            settings=settings,
            waiting=waiting,
            hand=hand,
        )
        keep(name, tables.rows((yield from synthesis(request))))

    def begin(names: Sequence[str], keep: Keep) -> list[tuple[str, Any]]:
        return [(name, partial(work, name, keep)) for name in names]

    if only:
        make_by_hand(stage, names, begin, workers)
        return
    common = digest(own_fingerprint("synthesize"), parameters, hand_digest(hand.name))
    fingerprints = {name: digest(common, name, asked(name), own) for name, own in digests.items()}
    make_items(stage, fingerprints, begin, workers, refused)


def main(arguments: list[str] | None = None) -> int:
    """Parse the command line and run the stage."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.synthesize", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--style", required=True, choices=("pinch", "side"), help="which fingers hold the object")
    parser.add_argument("--object", default="", help="name of a prepared object")
    options = parser.parse_args(arguments)
    return run_stage(f"synthesize@{options.style}", lambda: synthesize(options.style, options.object))


if __name__ == "__main__":
    sys.exit(main())
