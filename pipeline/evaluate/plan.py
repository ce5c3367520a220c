"""A proposed sequence for a robot's controller, with the hardware's limits checked; nothing here talks to hardware.

`python -m pipeline.evaluate.plan --table data/merge/cube/soup_can.parquet` plans from the start posture to both objects
held up, for one grasp of the table, and writes plan.json and plan.csv. With `--play` the very same way-points run in
simulation: playback.json says what came of it, playback.png shows it. docs/plan.md explains the files.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.records.errors import UserError
from pipeline.records.parameters import load_parameters

SECTIONS = ["seed", "physics", "evaluate"]


def plan(
    source: Path,
    merged_id: int | None,
    places: tuple[list[float] | None, list[float] | None],
    output: Path,
    dry_run: bool,
) -> None:
    """Plan one sequence, check it, and write it.

    Args:
        source: table of two-object grasps.
        merged_id: row of the table; the first accepted one when None.
        places: x, y (m) and yaw (degrees) of either object; None: where trials put it.
        output: folder to write to.
        dry_run: also run the plan in simulation.

    Raises:
        UserError: an input is unusable, no motion is found, or a limit of the hardware is exceeded.
    """
    parameters = load_parameters(SECTIONS)
    settings, physics = parameters["evaluate"], parameters["physics"]

    from pipeline.evaluate.limits import check_limits
    from pipeline.evaluate.playback import play, playback_strip
    from pipeline.evaluate.proposal import plan_csv, plan_record, propose, squeeze_torque, waypoints_of
    from pipeline.pictures.picture import png_bytes
    from pipeline.records.seeds import item_generator
    from pipeline.records.writing import whole_file, write_json

    grasp, names = _grasp(source, merged_id)
    table = _table(names, places, settings)
    rng = item_generator(parameters["seed"], "plan", *names, grasp.merged_id)
    waypoints = waypoints_of(propose(table, grasp, settings, rng), settings.control_frequency)
    checks = check_limits(waypoints, squeeze_torque(grasp, physics))
    for name in ("plan.csv", "playback.json", "playback.png"):  # of an earlier plan
        (output / name).unlink(missing_ok=True)
    write_json(output / "plan.json", plan_record(table, grasp, str(source), waypoints, checks))
    failed = [check for check in checks if not check.passed]
    if failed:
        more = f" ({len(failed) - 1} more, see {output / 'plan.json'})" if len(failed) > 1 else ""
        raise UserError(f"{failed[0].sentence()}{more}, as no plan.csv is written now.")
    with whole_file(output / "plan.csv") as temporary:
        temporary.write_text(plan_csv(waypoints), encoding="utf-8")
    print(
        f"{len(waypoints.times)} way-points, {waypoints.times[-1]:.1f} s, all limits kept (nearest: "
        f"{max(checks, key=lambda check: check.used).name}, {100 * max(check.used for check in checks):.0f} %); "
        f"wrote plan.json and plan.csv to {output}"
    )
    if dry_run:
        outcome = play(table, waypoints, settings, physics)
        kept = ("success", "success_10cm", "reason", "phase", "height0", "height1", "push1", "steps")
        write_json(output / "playback.json", {name: outcome[name] for name in kept})
        with whole_file(output / "playback.png") as temporary:
            temporary.write_bytes(png_bytes(playback_strip(table, outcome, settings)))
        told = "both objects were lifted and held" if outcome["success"] else f"ended early: {outcome['reason']}"
        print(f"dry run in simulation: {told}; wrote playback.json and playback.png to {output}")


def _grasp(source: Path, merged_id: int | None) -> tuple[Any, tuple[str, str]]:
    """Return the chosen grasp of a table, and the names of its objects."""
    from pipeline.evaluate.grasps import grasp_from_row
    from pipeline.records.tables import MERGED, read_table

    grasps = read_table(source, MERGED, "merge")
    if merged_id is None:
        own = grasps[grasps["rejected_by"] == ""].sort_values("merged_id", kind="stable")
        if own.empty:
            raise UserError(f"{source} holds no accepted grasp; use the table of another pair.")
    else:
        own = grasps[grasps["merged_id"] == merged_id]
        if own.empty:
            raise UserError(f"{source} has no grasp {merged_id}; its grasps are 0 to {len(grasps) - 1}.")
        if own["rejected_by"].iloc[0]:
            raise UserError(
                f"grasp {merged_id} of {source} was refused ({own['rejected_by'].iloc[0]}); choose another."
            )
    row = {str(name): value for name, value in own.iloc[0].items()}
    return grasp_from_row(row), (row["object0"], row["object1"])


def _table(names: tuple[str, str], places: Any, settings: Any) -> Any:
    """Return both prepared objects, standing on the sponge where the options say."""
    from pipeline.evaluate.proposal import StandingObject, Table
    from pipeline.evaluate.scene import SPONGE_SIZE, SPONGE_X, placed, without_grid
    from pipeline.records.objects import load_prepared_object

    first, second = (without_grid(load_prepared_object(name)) for name in names)
    nominal = placed((first, second), settings, np.zeros((2, 3)))
    offsets = np.zeros((2, 3))
    for index, place in enumerate(places):
        if place is not None:
            offsets[index] = [place[0] - nominal[index][0, 3], place[1] - nominal[index][1, 3], np.radians(place[2])]
    poses = placed((first, second), settings, offsets)
    for name, T in zip(names, poses, strict=True):
        if not (abs(T[:2, 3] - [SPONGE_X, 0.0]) <= SPONGE_SIZE / 2).all():
            raise UserError(
                f"{name} would stand at x {T[0, 3]:.3g} m, y {T[1, 3]:.3g} m, beside the sponge (x {SPONGE_X} m and "
                f"y 0 m, +-{SPONGE_SIZE / 2} m); place it there."
            )
    return Table((StandingObject(first, poses[0]), StandingObject(second, poses[1])))


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.evaluate.plan",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--table", type=Path, required=True, help="grasps of a pair, as merge and sample write them")
    parser.add_argument("--merged-id", type=int, help="row of the table (default: the first accepted one)")
    for index in (0, 1):
        parser.add_argument(
            f"--place{index}",
            type=float,
            nargs=3,
            metavar=("X", "Y", "YAW"),
            help=f"where object {index} stands, m and degrees in the robot's base frame (default: as in trials)",
        )
    parser.add_argument("--output", type=Path, default=Path("plan"), help="folder to write to (default: %(default)s)")
    parser.add_argument("--play", action="store_true", help="run the plan in simulation and draw it")
    chosen = parser.parse_args(arguments)
    try:
        plan(chosen.table, chosen.merged_id, (chosen.place0, chosen.place1), chosen.output, chosen.play)
    except UserError as error:
        print(f"plan: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
