"""Kinematics of hands from anywhere against pytorch_kinematics (URDF) or MuJoCo (MJCF), and how well shapes are fitted.

    python -m benchmarks.hand_oracles FILE [FILE ...]

For every URDF or MJCF: independent joints and those that follow, the largest error of link poses and of Jacobians at
random joints, boxes and balls with the worst link's error, and CPU seconds of reading it a first and a second time.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from pipeline.hand.model import hand_of_file
from pipeline.records.errors import UserError
from tests.hand.described import write_description
from tests.hand.oracles import mujoco_errors, pytorch_errors


def line(file: Path, folder: Path) -> str:
    """Return the row of one hand, or why it is refused."""
    try:
        description = write_description(folder, file)
        begin = time.process_time()
        hand = hand_of_file(description)
        first = time.process_time() - begin
        hand_of_file.cache_clear()
        begin = time.process_time()
        hand = hand_of_file(description)
        second = time.process_time() - begin
    except UserError as error:
        return f"| {file.parent.parent.name}/{file.name} | refused: {error} |"
    of_mujoco = file.suffix == ".xml"
    pose, slope = mujoco_errors(hand, file) if of_mujoco else pytorch_errors(hand, file.read_bytes())
    worst = max(hand.shape_fits, key=lambda name: hand.shape_fits[name].error, default="")
    fit = f"{worst} {1000 * hand.shape_fits[worst].error:.1f} mm" if worst else "exact"
    follow = len(hand.physical.names) - hand.joint_count
    shapes = f"{len(hand.box_link)} + {len(hand.sphere_link)}"
    row = (f"{file.parent.parent.name}/{file.name}", f"{hand.joint_count} + {follow}", len(hand.link_names))
    figures = (f"{pose:.1e}", f"{slope:.1e}", shapes, fit, f"{first:.1f}, {second:.1f}")
    return f"| {' | '.join(map(str, (*row, *figures)))} |"


def main() -> None:
    """Print one row per file."""
    print("| hand | joints + followers | links | pose error | Jacobian error | boxes + balls | worst fit | CPU s |")
    print("|---|---|---|---|---|---|---|---|")
    for name in sys.argv[1:]:
        file = Path(name).resolve()
        with tempfile.TemporaryDirectory() as folder:
            print(line(file, Path(folder) / "hand"), flush=True)


if __name__ == "__main__":
    main()
