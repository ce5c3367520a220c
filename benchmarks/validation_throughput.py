"""Fully tested grasps per minute and core: six gravities, no early rejection, contact offset 0.02 m.

    python benchmarks/validation_throughput.py [--grasps 20]

Target: at least 40 grasps per minute and core. Needs the prepared objects and synthesized candidates of params.yaml
below data/ (`dvc repro synthesize-pinch synthesize-side`). One process, process CPU time.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from pipeline.physics.holding import HeldObject, hold_in_gravities  # noqa: E402
from pipeline.records import paths  # noqa: E402
from pipeline.records.errors import UserError  # noqa: E402
from pipeline.records.objects import load_prepared_object  # noqa: E402
from pipeline.records.parameters import read_parameters  # noqa: E402
from pipeline.records.parameters.physics import PhysicsParameters  # noqa: E402
from pipeline.records.parameters.validate import ValidateParameters  # noqa: E402
from pipeline.records.poses import inverse_pose  # noqa: E402
from pipeline.records.tables import CANDIDATES, read_table  # noqa: E402
from pipeline.validate.grasp_test import assigned_links, check_candidate, squeeze_target  # noqa: E402
from pipeline.validate.table import candidate_of  # noqa: E402

TARGET = 40  # fully tested grasps per minute and core


def main(grasps: int) -> None:
    settings = PhysicsParameters(contact_offset=0.02)
    limits = ValidateParameters(early_rejection=False)
    styles = read_parameters().styles
    print(f"grasps per minute and core, up to {grasps} grasps per object; target of six gravities: {TARGET} or more")
    print(f"{'style':6} {'object':18} {'grasps':>6} {'six gravities':>15} {'with table':>11}")
    for style in ("pinch", "side"):
        for name in getattr(styles, style):
            prepared = load_prepared_object(name)
            table = read_table(paths.candidates_file(style, name), CANDIDATES, f"synthesize-{style}@{name}")
            rows = table[table.rejected_by == ""].head(grasps).to_dict("records")
            candidates = [candidate_of(row) for row in rows]
            if not candidates:
                print(f"{style:6} {name:18} {0:6d} {'-':>15} {'-':>11}")
                continue
            check_candidate(prepared, candidates[0], settings, limits)  # imports and caches
            begin = time.process_time()
            for candidate in candidates:
                held = HeldObject(prepared, inverse_pose(candidate.T_object_hand), assigned_links(candidate.fingers))
                squeeze = squeeze_target(candidate, limits.squeeze_advance)
                hold_in_gravities(settings, limits, [held], candidate.q, squeeze)
            gravities = time.process_time() - begin
            begin = time.process_time()
            for candidate in candidates:
                check_candidate(prepared, candidate, settings, limits)
            both = time.process_time() - begin
            rate = 60 * len(candidates)
            print(f"{style:6} {name:18} {len(candidates):6d} {rate / gravities:15.0f} {rate / both:11.0f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grasps", type=int, default=20, help="grasps per object and style (default: 20)")
    options = parser.parse_args()
    try:
        main(options.grasps)
    except UserError as error:
        sys.exit(str(error))
