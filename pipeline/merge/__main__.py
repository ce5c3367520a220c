"""`python -m pipeline.merge --object cube`: two-object grasps of all pairs that begin with this object.

Writes one table per second object into ``data/merge/<object>``.
"""

from __future__ import annotations

import argparse
import sys

from pipeline.records import paths
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.running import run_stage


def sections() -> list[str]:
    """Sections of ``params.yaml`` that this stage depends on."""
    return ["seed", "styles", "merge", "physics", "validate"]


def merge(first: str) -> None:
    """Merge all pairs that begin with ``first`` and write their folder, whole or not at all.

    Raises:
        UserError: an input is missing or damaged, or ``styles.pinch`` does not name the object.
    """
    parameters = load_parameters(sections())
    workers = read_parameters().compute
    seed, second_objects = parameters["seed"], parameters["styles"].after(first)

    from pipeline.merge.pairs import merge_pairs, ready_firsts, summary
    from pipeline.pairing.combination import Pair
    from pipeline.pairing.grasps import SingleGrasp, distinct_grasps, validated_grasps
    from pipeline.pairing.readiness import settling_physics
    from pipeline.records.objects import load_prepared_object
    from pipeline.records.seeds import item_generator
    from pipeline.records.tables import MERGED, VALIDATED, read_table, write_table
    from pipeline.records.writing import whole_folder

    settings, checks = parameters["merge"], [parameters[name] for name in ("merge", "physics", "validate")]

    def grasps(style: str, name: str) -> list[SingleGrasp]:
        table = read_table(paths.validated_file(style, name), VALIDATED, f"validate-{style}@{name}")
        return distinct_grasps(validated_grasps(table), settings.distinct_distance)

    firsts, seconds = grasps("pinch", first), {name: grasps("side", name) for name in second_objects}
    objects = {name: load_prepared_object(name) for name in dict.fromkeys([first, *second_objects])}
    pairs = {name: Pair(objects[first], objects[name], *checks) for name in seconds}
    generators = {name: item_generator(seed, "merge", first, name) for name in second_objects}
    ready = ready_firsts(objects[first], settling_physics(*checks), firsts, workers)
    tables = merge_pairs(pairs, ready, seconds, generators, workers)
    for second, table in tables.items():
        print(f"{first} then {second}: {summary(table)}")
        accepted = int((table["rejected_by"] == "").sum())
        if accepted < settings.grasps_per_pair:
            print(
                f"warning: {accepted} of {settings.grasps_per_pair} two-object grasps of {first} then {second}; "
                f"there were {len(firsts)} pinch and {len(seconds[second])} side grasps to combine.",
                file=sys.stderr,
            )
    # Nothing is computed inside: an error in there is explained as one of writing.
    with whole_folder(paths.merged_folder(first)) as folder:
        for second, table in tables.items():
            write_table(folder / paths.merged_file(first, second).name, table, MERGED)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.merge", description=__doc__)
    parser.add_argument("--object", required=True, help="the object that is picked first, a name in params.yaml")
    arguments = parser.parse_args()
    return run_stage(f"merge@{arguments.object}", lambda: merge(arguments.object))


if __name__ == "__main__":
    sys.exit(main())
