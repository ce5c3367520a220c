"""Run one recorded robot trial again, watch its phases go by, and compare its outcome with the record.

    python examples/05_replay_trial.py [SOURCE/FIRST/SECOND/NUMBER]

`./dev replay` plays the same trial in a browser, or writes a video.
"""

import sys

import seqgrasp
from pipeline.evaluate.execution import Run

name = sys.argv[1] if len(sys.argv) > 1 else "synthesized/cube/soup_can/3"
began: dict[str, float] = {}


def watch(run: Run) -> None:
    """Note when each phase begins, s of simulation."""
    began.setdefault(run.under_way, run.steps / run.scene.world.frequency)


trial = seqgrasp.rerun_trial(name, watch)
for phase, seconds in began.items():
    print(f"{seconds:6.2f} s  {phase}")
print("success" if trial.row["success"] else f"failed: {trial.row['reason']}")
print("the same as recorded, to the last bit" if not trial.differing else f"differs in {', '.join(trial.differing)}")
