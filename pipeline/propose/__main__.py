"""Two-object grasps for two files of your own, meshes or point clouds in metres, z up: `./dev sample`.

`--method model` draws them from the trained model, in seconds. `--method synthesize` makes and tests grasps of each
object and joins them, in minutes, and needs no model. `--method both` ranks the union. All are checked in physics, and
the best come first in grasps.parquet, grasps.json (which names the method) and grasps.html.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from pipeline.records.errors import UserError
from pipeline.records.parameters import load_with_workers
from pipeline.stages.running import command

SECTIONS = (
    "hand",
    "seed",
    "picks",
    "train.sampling",
    "synthesize.energy",
    "synthesize.optimizer",
    "synthesize.pinch",
    "synthesize.side",
    "merge",
    "physics",
    "validate",
    "robustness",
    "evaluate",
)
METHODS = ("model", "synthesize", "both")


def propose(sources: tuple[Path, Path], count: int, output: Path, method: str = "model", chains: int = 96) -> None:
    """Write ``count`` grasps of two objects, ranked, in the frames of their files.

    Args:
        sources: files of the object that is picked first, and of the other one.
        chains: for synthesis, see :func:`pipeline.propose.proposals.by_synthesis`.

    Raises:
        UserError: a file cannot be used, there is no trained model, or no grasp passed the checks.
    """
    parameters, workers = load_with_workers(SECTIONS)

    from pipeline.compute.pool import run_one
    from pipeline.energy.scene import compile_kernels
    from pipeline.hand.model import load_hand
    from pipeline.propose.own_objects import load_own_object
    from pipeline.propose.proposals import by_model, by_synthesis, ranked

    (first, points0, centre0), (second, points1, centre1) = (load_own_object(source) for source in sources)
    if first.name == second.name:
        first, second = replace(first, name=f"{first.name}_0"), replace(second, name=f"{second.name}_1")
    hand, objects = load_hand(parameters["hand"]), (first, second)
    compile_kernels()
    tables = {}
    if method != "synthesize":
        drawing = by_model(parameters, hand, objects, (points0, points1), count)
        tables["model"] = run_one(drawing, workers, "model")
    if method != "model":
        tables["synthesis"] = by_synthesis(parameters, hand, objects, count, chains, workers)
    for name, table in tables.items():
        print(f"{name}: {int((table['rejected_by'] == '').sum())} accepted of {len(table)} checked")
    best = ranked(tables, parameters["evaluate"].least_room, count)
    if best.empty:
        first_reasons = ", ".join(
            f"{name} by {table['rejected_by'].mode().iloc[0]}" for name, table in tables.items() if len(table)
        )
        advice = "try --method both" if method == "model" else "try more --chains, or other objects"
        raise UserError(
            f"no grasp of {first.name} and {second.name} passed the checks "
            f"({f'most were rejected: {first_reasons}' if first_reasons else 'there were none to check'}); {advice}."
        )
    _write(best, objects, (centre0, centre1), hand, output)
    print(f"wrote grasps.parquet, grasps.json and grasps.html to {output}")


def _write(best, objects, centres, hand, output: Path) -> None:  # type: ignore[no-untyped-def]  # noqa: ANN001
    from pipeline.propose.page import grasp_page
    from pipeline.propose.proposals import in_frames_of_files
    from pipeline.records.flat import PAIR_GRASPS, flat
    from pipeline.records.tables import MERGED, arrow_table, of_hand, write_arrow
    from pipeline.records.writing import whole_file, write_json

    methods = best["method"].tolist()
    schema = of_hand(MERGED, hand.name, hand.joint_count)
    rows = flat(arrow_table(best, schema), PAIR_GRASPS).to_pylist()
    with whole_file(output / "grasps.html") as temporary:
        temporary.write_text(grasp_page(rows, objects, hand), encoding="utf-8")
    own_frames = arrow_table(in_frames_of_files(best, centres), schema)
    write_arrow(output / "grasps.parquet", own_frames)
    flat_rows = flat(own_frames, PAIR_GRASPS).to_pylist()
    write_json(output / "grasps.json", [row | {"method": own} for row, own in zip(flat_rows, methods, strict=True)])


def command_line() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = argparse.ArgumentParser(
        prog="./dev sample", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--object0", type=Path, required=True, help="file of the object that is pinched")
    parser.add_argument("--object1", type=Path, required=True, help="file of the object that ring finger and palm hold")
    parser.add_argument("--method", choices=METHODS, default="model", help="(default: %(default)s)")
    parser.add_argument("-n", type=int, default=25, help="grasps wanted (default: %(default)s)")
    parser.add_argument(
        "--chains",
        type=int,
        default=96,
        help="with synthesis: candidates for the first object; the second gets twice as many (default: %(default)s)",
    )
    parser.add_argument("--output", type=Path, default=Path("grasps"), help="folder to write to (default: %(default)s)")
    parser.add_argument("--folder", type=Path, default=Path(), help=argparse.SUPPRESS)  # where ./dev was called
    return parser


@command("sample")
def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = command_line()
    chosen = parser.parse_args(arguments)
    if chosen.n < 1 or chosen.chains < 1:
        parser.error("-n and --chains must be at least 1")
    sources = (chosen.folder / chosen.object0, chosen.folder / chosen.object1)
    propose(sources, chosen.n, chosen.folder / chosen.output, chosen.method, chosen.chains)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
