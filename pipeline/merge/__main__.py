"""Grasps of two objects, or of as many as `picks` names, in one hand: ``data/merge/<first object>.parquet``.

`python -m pipeline.merge` brings all pairs up to date, `--object cube` merges those that begin with one object by hand.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.digests import digest, file_digest, hand_digest, prepared_digest
from pipeline.records.errors import UserError
from pipeline.records.objects import load_prepared_object
from pipeline.records.parameters import chosen_sequences, load_with_workers
from pipeline.records.tables import MERGED, VALIDATED, of_hand, read_table
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, fingerprints_of, make_by_hand, make_items
from pipeline.stages.outputs import Tables
from pipeline.stages.running import run_stage
from pipeline.stages.seeds import item_generator

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.compute.pool import Work
    from pipeline.hand.model import Hand
    from pipeline.merge.search import Inputs
    from pipeline.pairing.grasps import SingleGrasp
    from pipeline.records.objects import PreparedObject

# Sequences with one first object that are searched side by side: a worker holds their objects.
SIDE_BY_SIDE = 8


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return ["hand", "seed", "styles", "pairs", "picks", "merge", "physics", "validate", "robustness"]


def merge(only: str) -> None:
    """Merge the pairs that are not up to date, or those that begin with one object by hand.

    Raises:
        UserError: an input is missing or damaged, or ``styles.pinch`` does not name the object.
    """
    parameters, workers = load_with_workers(sections())
    sequences, picks = chosen_sequences(parameters, only), parameters["picks"]
    styles = [pick.style for pick in picks]

    digests, refused = fingerprints_of(["/".join(names) for names in sequences], partial(_inputs_digest, styles))
    if only and refused:
        raise UserError(next(iter(refused.values())))
    from pipeline.hand.model import load_hand
    from pipeline.merge.search import merging, summary
    from pipeline.pairing.grasps import distinct_grasps, validated_grasps
    from pipeline.pairing.task import groups_of

    settings = parameters["merge"]
    hand = load_hand(parameters["hand"])
    groups, single = groups_of(hand, picks), of_hand(VALIDATED, hand.name, hand.joint_count)
    tables = Tables(paths.merged_file("").parent, of_hand(MERGED, hand.name, hand.joint_count), ("objects",))
    stage = Stage("merge", "pairs", tables)

    @lru_cache(maxsize=2 * SIDE_BY_SIDE)
    def grasps(number: int, name: str) -> list[SingleGrasp]:
        table = read_table(paths.validated_file(styles[number], name), single, f"validate@{styles[number]}")
        return distinct_grasps(hand, validated_grasps(table), groups, number, settings.distinct_distance)

    def work(keys: Sequence[str], keep: Keep) -> Work[None]:
        objects = {name: load_prepared_object(name) for name in {name for key in keys for name in key.split("/")}}
        inputs = {key: _inputs(hand, parameters, [objects[name] for name in key.split("/")], grasps) for key in keys}

        def finish(key: str, table: pd.DataFrame) -> None:
            keep(key, tables.rows(table))
            print(f"{key.replace('/', ' then ')}: {summary(table)}")
            counts = [len(own) for own in inputs[key].grasps]
            _warn(key, table, settings.grasps_per_pair, list(zip(styles, counts, strict=True)))

        yield from merging(inputs, finish)

    def begin(keys: Sequence[str], keep: Keep) -> list[tuple[str, Any]]:
        wanted = set(keys)
        chosen = [names for names in sequences if "/".join(names) in wanted]
        return [(own[0].split("/")[0], partial(work, own, keep)) for own in _side_by_side(chosen)]

    if only:
        make_by_hand(stage, list(digests), begin, workers)
        return
    del parameters["styles"], parameters["pairs"]
    common = digest(own_fingerprint("merge"), parameters, hand_digest(hand.name))
    make_items(stage, {key: digest(common, key, own) for key, own in digests.items()}, begin, workers, refused)


def _inputs(
    hand: Hand,
    parameters: dict[str, Any],
    objects: Sequence[PreparedObject],
    grasps: Callable[[int, str], Sequence[SingleGrasp]],
) -> Inputs:
    """Return what is searched for some objects, in the order of picking.

    Args:
        grasps: returns the distinct validated grasps of the object with a number in that order, and a name.
    """
    from pipeline.merge.search import Inputs
    from pipeline.pairing.task import task_of
    from pipeline.robustness.measures import measuring

    names, seed = [item.name for item in objects], parameters["seed"]
    task = task_of(
        hand,
        parameters["picks"],
        objects,
        parameters["merge"],
        parameters["physics"],
        parameters["validate"],
        measuring(parameters["robustness"], seed, *names),
    )
    return Inputs(
        task, tuple(grasps(number, name) for number, name in enumerate(names)), item_generator(seed, "merge", *names)
    )


def _side_by_side(sequences: Sequence[tuple[str, ...]]) -> Iterator[list[str]]:
    """Yield the keys of sequences that begin alike, at most ``SIDE_BY_SIDE`` at once."""
    of_first: dict[str, list[str]] = {}
    for names in sequences:
        of_first.setdefault(names[0], []).append("/".join(names))
    for own in of_first.values():
        for place in range(0, len(own), SIDE_BY_SIDE):
            yield own[place : place + SIDE_BY_SIDE]


def _warn(key: str, table: pd.DataFrame, wanted: int, counts: Sequence[tuple[str, int]]) -> None:
    """Say so when fewer grasps were accepted than wanted.

    Args:
        counts: style of the single grasps of each object, and how many there were.
    """
    accepted = int((table["rejected_by"] == "").sum())
    if accepted < wanted:
        known = " and ".join(f"{count} {style}" for style, count in counts)
        print(
            f"warning: {accepted} of {wanted} grasps of {key.replace('/', ' then ')}; there were {known} grasps to "
            "combine.",
            file=sys.stderr,
        )


def _inputs_digest(styles: Sequence[str], key: str) -> str:
    """Return a digest of the objects of a sequence and of their grasps."""
    return digest(
        [
            digest(prepared_digest(name), file_digest(paths.validated_file(style, name), f"validate@{style}"))
            for style, name in zip(styles, key.split("/"), strict=True)
        ]
    )


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.merge", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--object", default="", help="the object that is picked first, a name in params.yaml")
    arguments = parser.parse_args()
    return run_stage("merge", lambda: merge(arguments.object))


if __name__ == "__main__":
    sys.exit(main())
