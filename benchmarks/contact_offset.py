"""What another contact offset does to the verdicts and the cost of robot trials.

    python benchmarks/contact_offset.py [--offsets 0.02 0.005] [--frictions 0.3] [--trials 25] [--sources synthesized]

Needs a finished run. Every trial of the chosen sources is run at each offset with the same grasps and seeds, in the
standard conditions and once more for every friction of ``--frictions``, given to objects and fingertips alike. An
offset of 0.020001 beside 0.02 shows what chance alone changes. Prints, and writes ``reports/contact_offset.csv``: a row
per friction and offset; other_success, other_reason: trials that end otherwise than at the first offset.
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
from pipeline.records.sources import SOURCES  # noqa: E402

STANDARD = "standard"
IDENTITY = ["source", "objects", "trial"]


def trials_of(source: str, physics: dict[str, float], offset: float, trials: int) -> list[TrialInput]:
    """Return the inputs of the first ``trials`` trials of every pair of a source, with changed physics."""
    parameters, hand = load_parameters(sections(source)), load_hand("allegro")
    sapien = {**parameters["physics"].sapien.model_dump(), "contact_offset": offset}
    changed = {**parameters, "physics": overridden(parameters["physics"], {**physics, "sapien": sapien})}
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
    """Return a row per friction and offset, against the same trials at the first offset."""
    table = []
    for friction, own in rows.groupby("friction", sort=False):
        reference = own[own["offset"] == own["offset"].iloc[0]].set_index(IDENTITY)
        for offset, trials in own.groupby("offset", sort=False):
            found = trials.set_index(IDENTITY)
            before = reference.loc[found.index]
            row = {
                "friction": friction,
                "offset": offset,
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
    parser.add_argument("--offsets", type=float, nargs="+", default=[0.02, 0.005], help="m, the first to compare with")
    parser.add_argument("--frictions", type=float, nargs="*", default=[], help="besides the standard ones")
    parser.add_argument("--trials", type=int, default=25, help="per pair and source (default: %(default)s)")
    parser.add_argument("--sources", nargs="+", choices=SOURCES, default=list(SOURCES))
    chosen = parser.parse_args()
    frictions = ("object_friction", "tip_static_friction", "tip_dynamic_friction")
    conditions = {STANDARD: {}, **{str(value): dict.fromkeys(frictions, value) for value in chosen.frictions}}
    rows = []
    for friction, changes in conditions.items():
        for offset in chosen.offsets:
            own = {"friction": friction, "offset": offset}
            inputs = [trial for source in chosen.sources for trial in trials_of(source, changes, offset, chosen.trials)]
            rows += fan_out(partial(timed_trial, own), inputs, read_parameters().compute.workers, f"{offset} m")
    table = compared(pd.DataFrame(rows))
    table.to_csv("reports/contact_offset.csv", index=False)
    print(table.to_string(index=False, float_format=lambda value: f"{value:.3g}"))


if __name__ == "__main__":
    main()
