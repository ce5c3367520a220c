"""CPU seconds of validation per candidate and per validated grasp, object by object.

    python benchmarks/validation_throughput.py [--grasps 20] [--set sapien_contact_offset=0.02] [--set table_test=false]

`--set` changes parameters of `validate` for the run; the contact offset of the paper's code is 0.02 m. Target: at most
0.8 CPU seconds per validated grasp on average, synthesis included (its share is in reports/durations.json). Needs the
prepared objects and synthesized candidates of params.yaml below data/ (`dvc repro synthesize`).
One process, process CPU time; candidates are spread evenly over those that passed the filter, and rejected ones count.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import time
from pathlib import Path

for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402
import yaml  # noqa: E402

from pipeline.hand.model import load_hand  # noqa: E402
from pipeline.hand.support import PLANE  # noqa: E402
from pipeline.records import paths  # noqa: E402
from pipeline.records.errors import UserError  # noqa: E402
from pipeline.records.objects import load_prepared_object  # noqa: E402
from pipeline.records.parameters import load_parameters, read_parameters  # noqa: E402
from pipeline.records.parameters.validate import ValidateParameters  # noqa: E402
from pipeline.records.tables import CANDIDATES, read_table  # noqa: E402
from pipeline.validate.checks import check_candidate  # noqa: E402
from pipeline.validate.table import candidate_of  # noqa: E402


def main(grasps: int, changes: dict[str, object]) -> None:
    styles = read_parameters().styles
    parameters = load_parameters(["hand", "physics", "validate"])
    hand = load_hand(parameters["hand"])
    settings = parameters["physics"]
    limits = ValidateParameters(**{**parameters["validate"].model_dump(), **changes})
    print(f"{'style':6} {'object':18} {'tested':>6} {'validated':>9} {'s/candidate':>11} {'s/validated':>11}")
    costs = []
    for style in ("pinch", "side"):
        for name in getattr(styles, style):
            prepared = load_prepared_object(name)
            table = read_table(paths.candidates_file(style, name), CANDIDATES, f"synthesize@{style}")
            rows = table[table.rejected_by == ""].to_dict("records")
            chosen = np.unique(np.linspace(0, len(rows) - 1, min(grasps, len(rows))).round().astype(int))
            candidates = [candidate_of(rows[index], PLANE, hand) for index in chosen]
            if not candidates:
                print(f"{style:6} {name:18} {0:6d}")
                continue
            check_candidate(prepared, candidates[0], settings, limits)  # imports and caches
            begin = time.process_time()
            verdicts = [check_candidate(prepared, item, settings, limits)["rejected_by"] for item in candidates]
            seconds, validated = time.process_time() - begin, verdicts.count("")
            costs.append(seconds / validated if validated else np.inf)
            line = f"{style:6} {name:18} {len(verdicts):6d} {validated:9d}"
            print(f"{line} {seconds / len(verdicts):11.3f} {costs[-1]:11.3f}", flush=True)
    print(f"mean per validated grasp {np.mean(costs):.3f} s; ", end="")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grasps", type=int, default=20, help="grasps per object and style (default: 20)")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter of validate")
    options = parser.parse_args()
    try:
        main(
            options.grasps,
            {name: yaml.safe_load(value) for name, value in (item.split("=", 1) for item in options.set)},
        )
    except UserError as error:
        sys.exit(str(error))
