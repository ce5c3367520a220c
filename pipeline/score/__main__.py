"""Score grasps of others: `python -m pipeline.score FILE --object MESH` asks the physics that our own grasps pass.

Reads DexGraspNet's, BODex's, DexGraspBench's, FRoGGeR's and SeqMultiGrasp's files, and JSON or CSV of any origin;
docs/lab.md describes them. Nothing that a file says is executed. Writes scores.csv, a row per grasp, and scores.html, a
page to look at. With two objects, --object is given twice, in the order of picking.
Exit code: 0; 2 when nothing could be scored, and one sentence says why.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.records.errors import UserError
from pipeline.records.parameters import Parameters, read_parameters
from pipeline.records.writing import check_writable, whole_file
from pipeline.stages.running import command

if TYPE_CHECKING:
    from pipeline.hand.model import Hand
    from pipeline.score.foreign import ForeignFile
    from pipeline.score.frames import FrameCheck, Placed
    from pipeline.score.joints import JointMap
    from pipeline.score.placing import PlacedFile
    from pipeline.score.scoring import Engine

UNITS = ("m", "cm", "mm", "inch")
AXES = ("+x", "-x", "+y", "-y", "+z", "-z")
ENGINES = {"sapien": ("sapien",), "mujoco": ("mujoco",), "both": ("sapien", "mujoco")}
ORDERS = {"wxyz": "xyzw", "xyzw": "wxyz"}
FEW = 0.1  # of the grasps that touch: worth a warning


def command_line() -> argparse.ArgumentParser:
    """Return the parser."""
    parser = argparse.ArgumentParser(
        prog="./dev score", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path, help="npy, npz, h5, json or csv; or a folder of npy files")
    parser.add_argument("--folder", type=Path, default=Path(), help=argparse.SUPPRESS)  # where ./dev was called
    parser.add_argument(
        "--object",
        action="append",
        required=True,
        metavar="MESH",
        help="a mesh file, or a prepared object of this clone",
    )
    parser.add_argument("--hand", help="a folder of hands/ (default: that of params.yaml)")
    parser.add_argument("--engine", choices=ENGINES, default="both", help="physics engine (default: both)")
    parser.add_argument("--quaternion", choices=ORDERS, default="wxyz", help="their order in the file (default: wxyz)")
    parser.add_argument("--inverse", action="store_true", help="poses are of the object in the hand's frame")
    parser.add_argument("--joints", help="the hand's joints in the order of the file's values, separated by commas")
    parser.add_argument("--unit", choices=UNITS, help="of the mesh (default: guessed from its size)")
    parser.add_argument("--up", choices=AXES, help="axis of the mesh that points up (default: +z; of HDF5: +y)")
    parser.add_argument("--density", type=float, default=500.0, help="kg/m3 (default: 500)")
    parser.add_argument("--no-table", action="store_true", help="do not pick the object off a support")
    parser.add_argument("--most", type=int, help="score the first grasps only, so many")
    parser.add_argument("--output", type=Path, default=Path("scores"), help="folder to write to (default: scores)")
    return parser


def score_file(chosen: argparse.Namespace) -> Path:
    """Do what the command line says, and return the folder that holds the result.

    Raises:
        UserError: the file, the object or the hand cannot be used, or hands do not touch as the file was read.
    """
    parameters = read_parameters()
    output: Path = chosen.folder / chosen.output
    if output.is_file():
        raise UserError(f"{output} is a file; name a folder with --output.")
    check_writable(output)
    from pipeline.hand.model import load_hand
    from pipeline.score.page import MOST_PICTURES, Reading, build_page, picture
    from pipeline.score.placing import ready_grasps
    from pipeline.score.rows import HOLDS, table
    from pipeline.score.scoring import score

    hand = load_hand(chosen.hand or parameters.hand)
    read, frames = _read(chosen, hand, parameters)
    ready = ready_grasps(read, hand, parameters)
    engines: tuple[Engine, ...] = ENGINES[chosen.engine]  # type: ignore[assignment]
    names = " and ".join(prepared.name for prepared in ready[0].objects)
    print(f"{read.file.form}: {len(ready)} grasps of {names}; {100 * frames.share:.0f} % touch as the file was read")
    verdicts = score(ready, hand, parameters, engines, not chosen.no_table)
    found = table(ready, verdicts, read.excess)
    reading = Reading(read.file, hand, read.joints, frames, _settings(parameters, engines, chosen))
    page = build_page(reading, found, [picture(grasp, hand) for grasp in ready[:MOST_PICTURES]])
    with whole_file(output / "scores.csv") as temporary:
        found.to_csv(temporary, index=False)
    with whole_file(output / "scores.html") as temporary:
        temporary.write_text(page, encoding="utf-8")
    holding = int((found["verdict"] == HOLDS).sum())
    each = ", ".join(f"{int((found[f'{engine}_rejected_by'] == '').sum())} in {engine}" for engine in engines)
    print(f"{holding} of {len(found)} hold ({each}); wrote scores.csv and scores.html to {output}")
    return output


def _read(chosen: argparse.Namespace, hand: Hand, parameters: Parameters) -> tuple[PlacedFile, FrameCheck]:
    """Return the grasps in our frames, after the contact test."""
    from pipeline.score.frames import check_frames
    from pipeline.score.joints import map_joints, other_orders
    from pipeline.score.own_objects import MeshChoice, object_source
    from pipeline.score.placing import place
    from pipeline.score.readers import read_grasps

    source = chosen.folder / chosen.file
    file = read_grasps(source, chosen.quaternion)
    count = len(file.grasps[0].joints)
    joints = map_joints(file.joint_names, count, hand, chosen.joints.split(",") if chosen.joints else ())
    mesh = MeshChoice(chosen.unit, chosen.up or ("+y" if file.y_up else "+z"), chosen.density, not chosen.no_table)
    objects = [object_source(text, chosen.folder, mesh, parameters.prepare) for text in chosen.object]

    def placed(own: ForeignFile, joints: JointMap) -> PlacedFile:
        return place(replace(own, grasps=own.grasps[: chosen.most]), objects, hand, joints, chosen.inverse)

    read, order = placed(file, joints), ORDERS[chosen.quaternion]

    def reordered() -> Sequence[Sequence[Placed]]:
        return placed(read_grasps(source, order), joints).placed

    def renamed(names: Sequence[str]) -> Sequence[Sequence[Placed]]:
        return placed(file, map_joints(None, count, hand, names)).placed

    others = [(f"quaternions are in the order {order}: add --quaternion {order}", reordered)]
    if file.joint_names is None and not chosen.joints:
        others += [
            (f"the file names no joints and has {called}: add --joints {','.join(names)}", partial(renamed, names))
            for called, names in other_orders(hand).items()
        ]
    frames = check_frames(hand, read.placed, others, read.T_prepared_mesh)
    if frames.hint:
        raise UserError(
            f"{source}: {100 * frames.share:.0f} % of the grasps touch the object as they were read, and "
            f"{100 * frames.hinted_share:.0f} % would otherwise: {frames.hint}."
        )
    if frames.share < FEW:
        print(
            f"warning: {100 * frames.share:.0f} % of the grasps touch the object; check that the mesh, its unit and "
            "its axes are those of the file.",
            file=sys.stderr,
        )
    return read, frames


def _settings(parameters: Parameters, engines: Sequence[Engine], chosen: argparse.Namespace) -> dict[str, str]:
    """Return what the verdicts depend on, for the page."""
    limits, robustness = parameters.validate_, parameters.robustness
    friction = "the materials of `physics`" if limits.friction is None else f"{limits.friction:g}"
    return {
        "engines": ", ".join(engines),
        "friction of every two touching bodies": friction,
        "directions of gravity": f"{', '.join(limits.gravity_directions)}, {limits.gravity_seconds:g} s each",
        "picked off a support": "no" if chosen.no_table else "yes, grasps of one object",
        "drawn conditions": str(robustness.conditions),
        "frictions tried": ", ".join(f"{friction:g}" for friction in robustness.ladder) or "none",
    }


@command("score")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    score_file(command_line().parse_args(arguments))
    return 0


if __name__ == "__main__":
    sys.exit(main())
