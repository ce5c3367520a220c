"""What another value of a SAPIEN setting does to the verdicts and the cost of robot trials.

    python benchmarks/sapien_setting.py contact_offset 0.02 0.005 [--frictions 0.3] [--trials 25]
    python benchmarks/sapien_setting.py position_iterations 25 12 [--frictions 0.4]

Needs a finished run. Every trial of the chosen sources is run at each value with the same grasps and seeds, in the
standard conditions and once more for every friction of ``--frictions``, given to objects and fingertips alike. A value
a millionth larger beside the first shows what chance alone changes. Prints, and writes ``reports/<setting>.csv``: a row
per friction and value; other_success, other_reason: trials that end otherwise than at the first value.
"""

from __future__ import annotations

import argparse
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

import pipeline  # noqa: E402, F401  (sets the thread counts before numpy is imported)
from pipeline.compute.fan_out import fan_out  # noqa: E402
from pipeline.evaluate.inputs import inputs_of, sections, sequences_of  # noqa: E402
from pipeline.evaluate.trial import TrialInput, run_trial  # noqa: E402
from pipeline.hand.model import load_hand  # noqa: E402
from pipeline.records.parameters import load_parameters, read_parameters  # noqa: E402
from pipeline.records.parameters.conditions import overridden  # noqa: E402
from pipeline.records.parameters.physics import SapienParameters  # noqa: E402
from pipeline.records.sources import SOURCES  # noqa: E402

STANDARD = "standard"
IDENTITY = ["source", "objects", "trial"]


def trials_of(source: str, physics: dict[str, float], sapien: dict[str, float], trials: int) -> list[TrialInput]:
    """Return the inputs of the first ``trials`` trials of every pair of a source, with changed physics."""
    parameters, hand = load_parameters(sections(source)), load_hand("allegro")
    own = {**parameters["physics"].sapien.model_dump(), **sapien}
    changed = {**parameters, "physics": overridden(parameters["physics"], {**physics, "sapien": own})}
    return [
        trial
        for objects in sequences_of(source, parameters)
        for trial in inputs_of(source, objects, changed, hand)
        if trial.trial < trials
    ]


def timed_trial(own: dict[str, Any], inputs: TrialInput) -> dict[str, Any]:
    """Run one trial; return ``own``, how it ended and the CPU seconds that it took."""
    begin = time.process_time()
    row = run_trial(inputs)
    row["objects"] = "/".join(row["objects"])
    return {**own, **{name: row[name] for name in [*IDENTITY, "success", "reason"]}, "cpu": time.process_time() - begin}


def compared(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row per friction and value, against the same trials at the first value."""
    table = []
    for friction, own in rows.groupby("friction", sort=False):
        reference = own[own["value"] == own["value"].iloc[0]].set_index(IDENTITY)
        for value, trials in own.groupby("value", sort=False):
            found = trials.set_index(IDENTITY)
            before = reference.loc[found.index]
            row = {
                "friction": friction,
                "value": value,
                "trials": len(found),
                "success": int(found["success"].sum()),
                "other_success": int(np.sum(found["success"] != before["success"])),
                "other_reason": int(np.sum(found["reason"] != before["reason"])),
                "cpu_seconds_per_trial": found["cpu"].mean(),
            }
            table.append(row)
    return pd.DataFrame(table)


def main() -> None:
    """Run, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("setting", choices=list(SapienParameters.model_fields), help="of physics.sapien in params.yaml")
    parser.add_argument("values", type=float, nargs="+", help="to try; the others are compared with the first")
    parser.add_argument("--frictions", type=float, nargs="*", default=[], help="besides the standard ones")
    parser.add_argument("--trials", type=int, default=25, help="per pair and source (default: %(default)s)")
    parser.add_argument("--sources", nargs="+", choices=SOURCES, default=list(SOURCES))
    chosen = parser.parse_args()
    frictions = ("object_friction", "tip_static_friction", "tip_dynamic_friction")
    conditions = {STANDARD: {}, **{str(value): dict.fromkeys(frictions, value) for value in chosen.frictions}}
    rows = []
    for friction, changes in conditions.items():
        for value in chosen.values:
            own, sapien = {"friction": friction, "value": value}, {chosen.setting: value}
            inputs = [trial for source in chosen.sources for trial in trials_of(source, changes, sapien, chosen.trials)]
            rows += fan_out(partial(timed_trial, own), inputs, read_parameters().compute.workers, f"{value:g}")
    table = compared(pd.DataFrame(rows))
    table.to_csv(f"reports/{chosen.setting}.csv", index=False)
    print(table.to_string(index=False, float_format=lambda value: f"{value:.3g}"))


if __name__ == "__main__":
    main()
