"""A proposed sequence for a robot's controller, with the hardware's limits checked; nothing here talks to hardware.

`python -m pipeline.plan --table data/merge/cube.parquet --second soup_can` plans from the start posture to
both objects held up, for one grasp of the pair, and writes plan.json and plan.csv. With `--play` the very same
way-points run in simulation: playback.json says what came of it, playback.png shows it. docs/plan.md explains the
files.
Exit code: 0; 1 when the dry run did not hold both objects; 2 when there is no plan, and one sentence says why.

With `--capture NAME` the objects are those that photos show, where they show them; the table is then of grasps of
reconstructed objects, such as data/sample/reconstructed/cube.parquet.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.parameters import load_parameters
from pipeline.records.poses import pose_matrix, transform_points
from pipeline.records.sources import OF_ALL_PAIRS, SOURCES
from pipeline.records.writing import check_writable
from pipeline.stages.running import command

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pipeline.evaluate.grasps import SequenceGrasp
    from pipeline.hand.model import Hand
    from pipeline.plan.proposal import Table
    from pipeline.records.objects import PreparedObject
    from pipeline.records.parameters.evaluate import EvaluateParameters
    from pipeline.records.parameters.picks import PickParameters

PREPARED = tuple(source.folder for source in OF_ALL_PAIRS.values())  # grasps of prepared objects
PHOTOGRAPHED = SOURCES[paths.RECONSTRUCTED].folder  # grasps of objects as photos show them
BASE_HEIGHT = 0.003  # m over an object's lowest point, within which it is taken to stand on the sponge


def sections() -> list[str]:
    """Parameter sections that a plan depends on."""
    return ["hand", "seed", "picks", "physics", "evaluate"]


@dataclass(frozen=True)
class Places:
    """Where things stand: x, y (m) and yaw (degrees) in the robot's base frame; None: where trials put them."""

    objects: tuple[list[float] | None, list[float] | None] = (None, None)
    capture: str | None = None  # name of a reconstruction that says how objects stand to each other
    scene: list[float] | None = None  # its scene frame; None: in the middle of the sponge


@dataclass(frozen=True)
class Choice:
    """Which grasp is carried out."""

    table: Path  # of two-object grasps
    second: str | None = None  # object that is picked second; None: the only one of the table
    merged_id: int | None = None  # None: the first accepted grasp of the pair


def plan(choice: Choice, places: Places, output: Path, dry_run: bool, fr3: bool = False) -> bool:
    """Plan one sequence, check it, write it, and return whether its dry run held both objects (True without one).

    Args:
        choice: the grasp.
        places: where the objects stand.
        output: folder to write to.
        dry_run: also run the plan in simulation.
        fr3: check the arm for the limits of the Franka Research 3, too.

    Raises:
        UserError: an input is unusable, no motion is found, or a limit of the hardware is exceeded.
    """
    parameters = load_parameters(sections())
    settings, physics = parameters["evaluate"], parameters["physics"]

    from pipeline.hand.model import load_hand
    from pipeline.hand.robot import require_arm
    from pipeline.pictures.picture import png_bytes
    from pipeline.plan.fr3 import check_fr3
    from pipeline.plan.limits import check_limits
    from pipeline.plan.playback import play, playback_strip
    from pipeline.plan.proposal import plan_csv, plan_record, propose, squeeze_torque, waypoints_of
    from pipeline.records.writing import whole_file, write_json
    from pipeline.stages.seeds import item_generator

    _check_output(output)
    _check_frames(choice.table, places.capture)
    hand = load_hand(parameters["hand"])
    require_arm(hand)
    grasp, names = _grasp(choice, hand, parameters["picks"])
    table = (
        _captured(names, places, settings) if places.capture else _placed(names, places, parameters["picks"], settings)
    )
    rng = item_generator(parameters["seed"], "plan", *names, grasp.merged_id)
    waypoints = waypoints_of(propose(table, grasp, hand, settings, rng), hand, settings.control_frequency)
    checks = check_limits(hand, waypoints, squeeze_torque(grasp, physics)) + (check_fr3(waypoints) if fr3 else [])
    for name in ("plan.csv", "playback.json", "playback.png"):  # of an earlier plan
        (output / name).unlink(missing_ok=True)
    write_json(output / "plan.json", plan_record(hand, table, grasp, str(choice.table), waypoints, checks))
    failed = [check for check in checks if not check.passed]
    if failed:
        more = f" ({len(failed) - 1} more, see {output / 'plan.json'})" if len(failed) > 1 else ""
        raise UserError(f"{failed[0].sentence()}{more}, as no plan.csv is written now.")
    with whole_file(output / "plan.csv") as temporary:
        temporary.write_text(plan_csv(hand, waypoints), encoding="utf-8")
    print(
        f"{len(waypoints.times)} way-points, {waypoints.times[-1]:.1f} s, all limits kept (nearest: "
        f"{max(checks, key=lambda check: check.used).name}, {100 * max(check.used for check in checks):.0f} %); "
        f"wrote plan.json and plan.csv to {output}"
    )
    if not dry_run:
        return True
    outcome = play(hand, table, waypoints, settings, physics)
    kept = ("success", "success_10cm", "reason", "phase", "heights", "pushes", "steps")
    write_json(output / "playback.json", {name: outcome[name] for name in kept})
    with whole_file(output / "playback.png") as temporary:
        temporary.write_bytes(png_bytes(playback_strip(hand, table, outcome, settings)))
    result = "both objects were lifted and held" if outcome["success"] else f"ended early: {outcome['reason']}"
    print(f"dry run in simulation: {result}; wrote playback.json and playback.png to {output}")
    return bool(outcome["success"])


def _check_output(output: Path) -> None:
    """Refuse what is no folder to write to."""
    if output.is_file():
        raise UserError(f"{output} is a file; name a folder with --output.")
    check_writable(output)


def _check_frames(source: Path, capture: str | None) -> None:
    """Refuse the pipeline's own tables where their object frames are not those of the chosen objects.

    The frame of a reconstructed object has another origin than that of the prepared one of the same name.
    """

    def inside(folder: Path) -> bool:
        return source.resolve().is_relative_to(folder.resolve())

    if capture is None and inside(PHOTOGRAPHED):
        raise UserError(f"{source} holds grasps of objects as photos show them; name their capture with --capture.")
    if capture is not None and any(map(inside, PREPARED)):
        raise UserError(
            f"{source} holds grasps of prepared objects, whose frames are not those of the capture {capture}; leave "
            f"--capture out, or use a table of {PHOTOGRAPHED}."
        )


def _grasp(choice: Choice, hand: Hand, picks: Sequence[PickParameters]) -> tuple[SequenceGrasp, tuple[str, str]]:
    """Return the chosen grasp of a table, and the names of its objects."""
    from pipeline.evaluate.grasps import grasp_from_row
    from pipeline.pairing.task import groups_of
    from pipeline.records.parameters import OBJECT_NAME
    from pipeline.records.tables import MERGED, of_hand, read_table, rows_of

    source = choice.table
    try:
        grasps = read_table(source, of_hand(MERGED, hand.name, hand.joint_count), "merge")
    except UserError as error:  # whose advice is for the stages' own files
        raise UserError(
            f"{source} is missing or no table of two-object grasps; name one of {', '.join(map(str, PREPARED))} or "
            f"{PHOTOGRAPHED}, or of `python -m pipeline.sample`."
        ) from error
    pairs = list(dict.fromkeys(() if names is None else tuple(names) for names in grasps["objects"]))
    if any(len(names) != 2 for names in pairs):
        raise UserError(f"{source} has rows that are not about two objects each; use a table of pairs.")
    for name in dict.fromkeys(name for names in pairs for name in names):
        if not isinstance(name, str) or not OBJECT_NAME.fullmatch(name):  # names become folders
            raise UserError(f"{source} names an object {name!r}; names have small letters, digits and underscores.")
    second = _second(choice, list(dict.fromkeys(second for _, second in pairs)))
    names = next((first, other) for first, other in pairs if other == second)
    pair = rows_of(grasps, names)
    if choice.merged_id is None:
        own = pair[pair["rejected_by"] == ""].sort_values("merged_id", kind="stable")
        if own.empty:
            raise UserError(f"{source} holds no accepted grasp of this pair; choose another pair.")
    else:
        own = pair[pair["merged_id"] == choice.merged_id]
        if own.empty:
            raise UserError(
                f"{source} has no grasp {choice.merged_id} of this pair; its grasps are 0 to {len(pair) - 1}."
            )
        if own["rejected_by"].iloc[0]:
            raise UserError(
                f"grasp {choice.merged_id} of {source} was refused ({own['rejected_by'].iloc[0]}); choose another."
            )
    row = {str(name): value for name, value in own.iloc[0].items()}
    return grasp_from_row(row, hand, groups_of(hand, picks)), names


def _second(choice: Choice, seconds: list[str]) -> str:
    """Return the object that is picked second, one of those in the table."""
    if choice.second in seconds:
        return choice.second
    if not seconds:
        raise UserError(f"{choice.table} holds no grasp at all; use the table of another object.")
    if choice.second is None and len(seconds) == 1:
        return seconds[0]
    asked = "holds several pairs" if choice.second is None else f"has no grasps that pick {choice.second} second"
    raise UserError(f"{choice.table} {asked}; choose one of {', '.join(seconds)} with --second.")


def _placed(
    names: tuple[str, str], places: Places, picks: Sequence[PickParameters], settings: EvaluateParameters
) -> Table:
    """Return both prepared objects, standing on the sponge where the options say."""
    from pipeline.evaluate.scene import placed
    from pipeline.plan.proposal import StandingObject, Table
    from pipeline.records.kept import kept_object

    objects = [kept_object(name, grid=False) for name in names]
    nominal = placed(picks, objects, settings, np.zeros((2, 3)))
    offsets = np.zeros((2, 3))
    for index, place in enumerate(places.objects):
        if place is not None:
            offsets[index] = [place[0] - nominal[index][0, 3], place[1] - nominal[index][1, 3], np.radians(place[2])]
    standing = [StandingObject(*each) for each in zip(objects, placed(picks, objects, settings, offsets), strict=True)]
    for item in standing:
        _check_on_sponge(item.prepared.name, item.prepared, item.T_world_object)
    return Table(tuple(standing))


def _captured(names: tuple[str, str], places: Places, settings: EvaluateParameters) -> Table:
    """Return all objects of a capture as photos show them, standing on the sponge as they stood on their support."""
    from pipeline.plan.proposal import StandingObject, Table
    from pipeline.records.reconstructions import load_reconstructed_object, load_reconstruction_metrics
    from pipeline.shapes.solids import object_of_reconstruction
    from pipeline.shapes.workplace import SPONGE_X

    assert places.capture
    x, y, degrees = places.scene or (SPONGE_X, 0.0, 0.0)
    T_world_scene = pose_matrix(
        (x, y, 0.0), (np.cos(np.radians(degrees) / 2), 0.0, 0.0, np.sin(np.radians(degrees) / 2))
    )
    shown = load_reconstruction_metrics(places.capture)["objects"]
    absent = [name for name in names if name not in shown]
    if absent:
        raise UserError(
            f"the capture {places.capture} does not show {absent[0]}, but {', '.join(sorted(shown))}; "
            "use the table of a pair of these."
        )
    standing = {}
    for name in shown:
        item = load_reconstructed_object(places.capture, name)
        prepared = object_of_reconstruction(item, grid=False)
        T = T_world_scene @ item.T_scene_object
        T[2, 3] = settings.sponge_height - prepared.bottom
        _check_on_sponge(name, prepared, T)
        standing[name] = StandingObject(prepared, T)
    others = tuple(item for name, item in standing.items() if name not in names)
    return Table((standing[names[0]], standing[names[1]]), others)


def _check_on_sponge(name: str, prepared: PreparedObject, T: NDArray[np.float64]) -> None:
    """Refuse a place where what an object stands on would reach over the edge; ``T`` (4, 4) is its pose."""
    from pipeline.shapes.workplace import SPONGE_SIZE, SPONGE_X

    base = prepared.vertices[prepared.vertices[:, 2] < prepared.bottom + BASE_HEIGHT]
    inside = np.abs(transform_points(T, base)[:, :2] - [SPONGE_X, 0.0]) <= SPONGE_SIZE / 2
    if not inside.all():  # also where a place is not a number
        raise UserError(
            f"{name} would stand at x {T[0, 3]:.3g} m, y {T[1, 3]:.3g} m, not wholly on the sponge (x {SPONGE_X} m and "
            f"y 0 m, +-{SPONGE_SIZE / 2} m); place it there."
        )


@command("plan")
def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.plan",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--table", type=Path, required=True, help="grasps, as merge and sample write them")
    parser.add_argument("--second", metavar="OBJECT", help="picked second; needed where the table has several pairs")
    parser.add_argument("--merged-id", type=int, help="grasp of the pair (default: the first accepted one)")
    for index in (0, 1):
        parser.add_argument(
            f"--place{index}",
            type=float,
            nargs=3,
            metavar=("X", "Y", "YAW"),
            help=f"where object {index} stands, m and degrees in the robot's base frame (default: as in trials)",
        )
    parser.add_argument("--capture", help="a reconstructed capture, a name in params.yaml: objects and their places")
    parser.add_argument(
        "--scene",
        type=float,
        nargs=3,
        metavar=("X", "Y", "YAW"),
        help="with --capture: its scene frame in the robot's base frame (default: the middle of the sponge)",
    )
    parser.add_argument("--output", type=Path, default=Path("plan"), help="folder to write to (default: %(default)s)")
    parser.add_argument("--play", action="store_true", help="run the plan in simulation and draw it")
    parser.add_argument("--fr3", action="store_true", help="check the arm for the limits of the Franka Research 3, too")
    chosen = parser.parse_args(arguments)
    if chosen.capture and (chosen.place0 or chosen.place1) or chosen.scene and not chosen.capture:
        parser.error("give --place0 and --place1, or --capture and --scene")
    places = Places((chosen.place0, chosen.place1), chosen.capture, chosen.scene)
    choice = Choice(chosen.table, chosen.second, chosen.merged_id)
    return 0 if plan(choice, places, chosen.output, chosen.play, chosen.fr3) else 1


if __name__ == "__main__":
    raise SystemExit(main())
