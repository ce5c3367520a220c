"""`python -m pipeline.merge`: two-object grasps of all pairs from validated single grasps."""

from __future__ import annotations

import argparse
import sys
from itertools import product

from pipeline.records import paths
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.running import run_stage


def sections() -> list[str]:
    """Sections of ``params.yaml`` that this stage depends on."""
    return ["seed", "styles", "merge", "physics", "validate"]


def merge() -> None:
    """Merge all pairs and write ``data/merge``, whole or not at all."""
    parameters = load_parameters(sections())
    workers = read_parameters().compute.workers
    styles, seed = parameters["styles"], parameters["seed"]

    from pipeline.merge.combination import Pair
    from pipeline.merge.grasps import distinct_grasps, validated_grasps
    from pipeline.merge.pairs import merge_pair, summary
    from pipeline.records.objects import load_prepared_object
    from pipeline.records.seeds import item_generator
    from pipeline.records.tables import MERGED, VALIDATED, read_table, write_table
    from pipeline.records.writing import whole_folder

    grasps = {
        (style, name): distinct_grasps(
            validated_grasps(read_table(paths.validated_file(style, name), VALIDATED, f"validate-{style}@{name}")),
            parameters["merge"].distinct_distance,
        )
        for style in ("pinch", "side")
        for name in getattr(styles, style)
    }
    objects = {name: load_prepared_object(name) for name in dict.fromkeys([*styles.pinch, *styles.side])}
    tables = {}
    for first, second in product(styles.pinch, styles.side):
        pair = Pair(objects[first], objects[second], parameters["merge"], parameters["physics"], parameters["validate"])
        generator = item_generator(seed, "merge", first, second)
        firsts, seconds = grasps["pinch", first], grasps["side", second]
        table = tables[first, second] = merge_pair(pair, firsts, seconds, generator, workers)
        print(f"{first} then {second}: {summary(table)}")
        if not (table["rejected_by"] == "").any():
            print(
                f"warning: no two-object grasp of {first} then {second}; there were {len(firsts)} pinch and "
                f"{len(seconds)} side grasps to combine.",
                file=sys.stderr,
            )
    # Nothing is computed inside: an error in there is explained as one of writing.
    with whole_folder(paths.MERGE_FOLDER) as folder:
        for (first, second), table in tables.items():
            write_table(folder / paths.merged_file(first, second).name, table, MERGED)


def main() -> int:
    """Run the command."""
    argparse.ArgumentParser(prog="python -m pipeline.merge", description=__doc__).parse_args()
    return run_stage("merge", merge)


if __name__ == "__main__":
    sys.exit(main())
