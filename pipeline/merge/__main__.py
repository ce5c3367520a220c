"""Two-object grasps of all pairs: ``data/merge/<first object>.parquet``.

`python -m pipeline.merge` brings all pairs up to date, `--object cube` merges those that begin with one object by hand.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

from pipeline.records import paths
from pipeline.records.digests import digest, file_digest, hand_digest, prepared_digest
from pipeline.records.objects import load_prepared_object
from pipeline.records.parameters import chosen_pairs, load_with_workers
from pipeline.records.parameters.hand import ALLEGRO
from pipeline.records.tables import MERGED, VALIDATED, read_table
from pipeline.stages.code import own_fingerprint
from pipeline.stages.items import Keep, Stage, make_by_hand, make_items
from pipeline.stages.outputs import Tables
from pipeline.stages.running import run_stage
from pipeline.stages.seeds import item_generator

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.compute.pool import Work
    from pipeline.pairing.grasps import SingleGrasp

# Second objects whose pairs with one first object are searched side by side: a worker holds that many.
SIDE_BY_SIDE = 8


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return ["seed", "styles", "pairs", "merge", "physics", "validate"]


def merge(only: str) -> None:
    """Merge the pairs that are not up to date, or those that begin with one object by hand.

    Raises:
        UserError: an input is missing or damaged, or ``styles.pinch`` does not name the object.
    """
    parameters, workers = load_with_workers(sections())
    partners, seed = chosen_pairs(parameters, only), parameters["seed"]
    pairs = [(first, second) for first, seconds in partners.items() for second in seconds]
    digests = {f"{first}/{second}": digest(_digest("pinch", first), _digest("side", second)) for first, second in pairs}
    from pipeline.merge.pairs import merging, summary
    from pipeline.pairing.combination import Pair
    from pipeline.pairing.grasps import distinct_grasps, validated_grasps
    from pipeline.pairing.readiness import settling_physics

    settings, checks = parameters["merge"], [parameters[name] for name in ("merge", "physics", "validate")]
    tables = Tables(paths.merged_file("").parent, MERGED, ("object1",))
    stage = Stage("merge", "pairs", tables)

    @lru_cache(maxsize=2 * SIDE_BY_SIDE)
    def grasps(style: str, name: str) -> list[SingleGrasp]:
        table = read_table(paths.validated_file(style, name), VALIDATED, f"validate@{style}")
        return distinct_grasps(validated_grasps(table), settings.distinct_distance)

    def work(first: str, seconds: Sequence[str], keep: Keep) -> Work[None]:
        objects = {name: load_prepared_object(name) for name in dict.fromkeys([first, *seconds])}

        def finish(second: str, table: pd.DataFrame) -> None:
            keep(f"{first}/{second}", tables.rows(table))
            print(f"{first} then {second}: {summary(table)}")
            accepted = int((table["rejected_by"] == "").sum())
            if accepted < settings.grasps_per_pair:
                print(
                    f"warning: {accepted} of {settings.grasps_per_pair} two-object grasps of {first} then {second}; "
                    f"there were {len(grasps('pinch', first))} pinch and {len(grasps('side', second))} side grasps "
                    "to combine.",
                    file=sys.stderr,
                )

        yield from merging(
            {name: Pair(objects[first], objects[name], *checks) for name in seconds},
            settling_physics(*checks),
            grasps("pinch", first),
            {name: grasps("side", name) for name in seconds},
            {name: item_generator(seed, "merge", first, name) for name in seconds},
            finish,
        )

    def begin(keys: Sequence[str], keep: Keep) -> list[tuple[str, Any]]:
        works = []
        for first, seconds in partners.items():
            own = [second for second in seconds if f"{first}/{second}" in keys]
            for place in range(0, len(own), SIDE_BY_SIDE):
                works.append((first, partial(work, first, own[place : place + SIDE_BY_SIDE], keep)))
        return works

    if only:
        make_by_hand(stage, list(digests), begin, workers)
        return
    del parameters["styles"], parameters["pairs"]
    common = digest(own_fingerprint("merge"), parameters, hand_digest(ALLEGRO))
    make_items(stage, {key: digest(common, key, own) for key, own in digests.items()}, begin, workers)


def _digest(style: str, name: str) -> str:
    return digest(prepared_digest(name), file_digest(paths.validated_file(style, name), f"validate@{style}"))


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
