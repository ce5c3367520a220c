"""Several objects in one hand: `python -m pipeline.several.demonstration --sequence conf/several/three.yaml`.

Prepares the objects of a sequence, finds grasps of each with the part of the hand that is given to it, joins them, and
picks all objects one after the other in robot trials. Writes singles_<object>.parquet, joined.parquet, trials.parquet,
summary.json and trial.png to the output folder. docs/more-than-two.md explains them.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

from pipeline.records.parameters import Parameters, read_parameters, require_allegro
from pipeline.records.parameters.several import SeveralParameters, read_sequence
from pipeline.stages.running import command


def task_of(sequence: SeveralParameters, objects: tuple[Any, ...], parameters: Parameters) -> Any:
    """Return what is to be joined."""
    from pipeline.pairing.combination import Task
    from pipeline.several.singles import support_of

    perturbation = parameters.evaluate.perturbation
    return Task(
        objects=objects,
        groups=tuple(tuple(pick.fingers) for pick in sequence.picks),
        supports=tuple(support_of(pick, perturbation) for pick in sequence.picks),
        merge=parameters.merge.model_copy(update={"approach_lengths": sequence.approach_lengths}),
        physics=parameters.physics,
        validate=parameters.validate_,
        approach_clearance=sequence.approach_clearance,
    )


def counts(values: Any) -> dict[str, int]:
    """Return how often each value occurs, most frequent first."""
    return dict(Counter(values).most_common())


def demonstrate(source: Path, output: Path, workers: int | None) -> None:
    """Carry out a whole sequence and write everything.

    Raises:
        UserError: the description is unusable, an object cannot be prepared, or the folder cannot be written to.
    """
    sequence, parameters = read_sequence(source), read_parameters()
    require_allegro(parameters)
    processes = parameters.compute if workers is None else workers

    import pandas as pd

    from pipeline.compute.fan_out import fan_out
    from pipeline.pairing.grasps import validated_grasps
    from pipeline.pictures.picture import png_bytes
    from pipeline.prepare.preparation import prepare_object
    from pipeline.records.tables import JOINED, JOINED_TRIALS, VALIDATED, write_table
    from pipeline.records.writing import whole_file, write_json
    from pipeline.several.joining import join_all, ready_grasps
    from pipeline.several.pictures import trial_sheet
    from pipeline.several.singles import single_grasps
    from pipeline.several.trials import posts_of, run_trial, trial_inputs
    from pipeline.stages.seeds import item_generator

    objects = tuple(prepare_object(pick.name, pick.shape, parameters.prepare) for pick in sequence.picks)
    summary: dict[str, Any] = {}
    singles = []
    for number, (pick, prepared) in enumerate(zip(sequence.picks, objects, strict=True)):
        table = single_grasps(number, prepared, sequence, parameters, processes)
        write_table(output / f"singles_{pick.name}.parquet", table, VALIDATED)
        singles.append(validated_grasps(table))
        summary[f"single.{pick.name}"] = counts(table["rejected_by"])
        print(f"{pick.name} with {'+'.join(pick.fingers)}: {len(singles[-1])} of {len(table)} grasps validated")
    task = task_of(sequence, objects, parameters)
    generator = item_generator(sequence.seed, "several", "join", *(pick.name for pick in sequence.picks))
    joined = join_all(task, ready_grasps(task, singles, processes), sequence, generator, processes)
    write_table(output / "joined.parquet", joined, JOINED)
    summary["joined"] = counts(joined["rejected_by"])
    print(f"{int((joined['rejected_by'] == '').sum())} of {len(joined)} combinations hold all {len(objects)} objects")
    settings = parameters.evaluate.model_copy(update={"lift_height": sequence.lift_height})
    inputs = trial_inputs(joined, objects, sequence, settings, parameters.physics)
    rows = fan_out(run_trial, inputs, processes, "trials")
    write_table(output / "trials.parquet", pd.DataFrame(rows, columns=JOINED_TRIALS.names), JOINED_TRIALS)
    summary["trials"] = {"success": sum(row["success"] for row in rows), "of": len(rows)}
    summary["reasons"] = counts(row["reason"] for row in rows)
    write_json(output / "summary.json", summary)
    shown = next((row for row in rows if row["success"]), rows[0])
    with whole_file(output / "trial.png") as temporary:
        temporary.write_bytes(
            png_bytes(trial_sheet(shown, objects, posts_of(tuple(sequence.picks)), parameters.evaluate))
        )
    print(f"{summary['trials']['success']} of {len(rows)} trials lifted and held all objects; wrote {output}")


@command("several")
def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.several.demonstration",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--sequence", type=Path, required=True, help="description, such as conf/several/three.yaml")
    parser.add_argument("--output", type=Path, default=Path("several"), help="folder to write to (default: several)")
    parser.add_argument("--workers", type=int, help="processes (default: compute.workers of params.yaml)")
    chosen = parser.parse_args(arguments)
    demonstrate(chosen.sequence, chosen.output, chosen.workers)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
