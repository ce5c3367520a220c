"""Fully tested grasps per minute and core: six gravities, no early rejection, contact offset 0.02 m.

    python benchmarks/validation_throughput.py [--grasps 20]

Needs the prepared objects and synthesized candidates of params.yaml below data/. One process, CPU seconds.
"""

from __future__ import annotations

import argparse
import time

from pipeline.physics.holding import HeldObject, hold_in_gravities
from pipeline.records import paths
from pipeline.records.objects import load_prepared_object
from pipeline.records.parameters import read_parameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose
from pipeline.records.tables import CANDIDATES, read_table
from pipeline.validate.grasp_test import assigned_links, check_candidate, squeeze_target
from pipeline.validate.table import candidate_of


def main(grasps: int) -> None:
    settings = PhysicsParameters(contact_offset=0.02)
    limits = ValidateParameters(early_rejection=False)
    styles = read_parameters().styles
    print(f"{'object':18} {'grasps':>6} {'gravities only':>15} {'with table':>11}  (grasps per minute and core)")
    for style in ("pinch", "side"):
        for name in getattr(styles, style):
            prepared = load_prepared_object(name)
            table = read_table(paths.candidates_file(style, name), CANDIDATES, f"synthesize-{style}@{name}")
            rows = table[table.rejected_by == ""].head(grasps).to_dict("records")
            candidates = [candidate_of(row) for row in rows]
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
            print(f"{name:18} {len(candidates):6d} {rate / gravities:15.0f} {rate / both:11.0f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--grasps", type=int, default=20, help="grasps per object")
    main(parser.parse_args().grasps)
