"""Whether merged grasps hold in both engines, and what a test of holding costs in each.

    python benchmarks/engines.py [--grasps 40] [--friction 0.6]

Needs a finished run. The first accepted grasps of every pair are tested in six gravities by SAPIEN and by MuJoCo, every
two touching bodies with the same friction, and MuJoCo once more without its sleep. Prints, and writes
``reports/engines.csv``: a row per grasp with the first direction in which each lost an object (empty: none), its
largest drift, m, and CPU seconds.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import pandas as pd  # noqa: E402
from robustness import Case, cases, timed  # noqa: E402

from pipeline.compute.fan_out import fan_out  # noqa: E402
from pipeline.pairing.combination import combine, settled_grasp  # noqa: E402
from pipeline.pairing.readiness import ready  # noqa: E402
from pipeline.physics import mujoco_world  # noqa: E402
from pipeline.physics.holding import hold_in_gravities  # noqa: E402
from pipeline.records.parameters import chosen_sequences, read_parameters  # noqa: E402
from pipeline.records.parameters.conditions import Engine  # noqa: E402

AWAKE = "mujoco, never asleep"


def tested(case: Case, friction: float) -> dict[str, Any]:
    """Return the outcome of one grasp in each engine."""
    task = case.task
    held = settled_grasp(combine(task, [ready(task, number, single) for number, single in enumerate(case.singles)]))
    limits = task.validate.at_friction(friction)
    row: dict[str, Any] = {"objects": case.objects, "merged_id": case.merged_id}
    engines: dict[str, Engine] = {"sapien": "sapien", "mujoco": "mujoco", AWAKE: "mujoco"}
    for name, engine in engines.items():
        physics = task.physics.in_engine(engine)
        patience = 1e9 if name == AWAKE else mujoco_world.REST_SECONDS
        with mock.patch.object(mujoco_world, "REST_SECONDS", patience):
            test = partial(hold_in_gravities, physics, limits, held.objects, held.q, held.squeeze_q, held.hand)
            holding, seconds = timed(test)
        row |= {f"lost ({name})": holding.failed_direction, f"drift ({name})": holding.drift.max()}
        row |= {f"CPU s ({name})": seconds}
    return row


def main(options: argparse.Namespace) -> None:
    """Measure."""
    parameters = read_parameters()
    known = {"seed": parameters.seed, "styles": parameters.styles, "pairs": parameters.pairs, "picks": parameters.picks}
    grasps = [case for names in chosen_sequences(known) for case in cases(parameters, names, options.grasps)]
    found = pd.DataFrame(fan_out(partial(tested, friction=options.friction), grasps, parameters.compute, "grasps"))
    found.to_csv("reports/engines.csv", index=False)
    holds = {name: found[f"lost ({name})"] == "" for name in ("sapien", "mujoco", AWAKE)}
    print(f"{len(found)} grasps at friction {options.friction:g}")
    both = holds["sapien"] & holds["mujoco"]
    print(f"hold in both {both.sum()}, in SAPIEN alone {(holds['sapien'] & ~both).sum()}, ", end="")
    print(
        f"in MuJoCo alone {(holds['mujoco'] & ~both).sum()}, in neither {(~holds['sapien'] & ~holds['mujoco']).sum()}"
    )
    print(f"MuJoCo with and without sleep differ in {(holds['mujoco'] != holds[AWAKE]).sum()}")
    print(found.filter(like="CPU s").mean().round(2).to_string())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grasps", type=int, default=40, help="of each pair (default: 40)")
    parser.add_argument("--friction", type=float, default=0.6, help="of every two touching bodies (default: 0.6)")
    main(parser.parse_args())
