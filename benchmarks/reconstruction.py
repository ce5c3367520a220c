"""The demo capture, sharp and as a phone would take it: errors, seconds and memory of both surfaces.

    python benchmarks/reconstruction.py [--views 24] [--phone] [--method plane_sweep|2dgs]

Targets on 2 cores (24 views, 960 x 720): every photo registered, reprojection at most 0.5 pixels, alignment at most
0.3 mm, chamfer at most 0.8 mm per object (phone: 1.5 mm; 2dgs: 1.0 mm), 8 minutes, 3 GB. Needs data/prepare
(`dvc repro prepare`).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from pipeline.capture.recipe import render_capture  # noqa: E402
from pipeline.reconstruct.reconstruction import metrics_of, reconstruct  # noqa: E402
from pipeline.records.captures import read_capture, read_truth  # noqa: E402
from pipeline.records.objects import load_prepared_object  # noqa: E402
from pipeline.records.parameters import read_parameters  # noqa: E402
from pipeline.stages.cost import cost_so_far  # noqa: E402

# Distortion of a wide phone lens, slight defocus and shake, noise of indoor light, changing exposure, some gloss.
PHONE = {
    "distortion": (-0.1, 0.03, 0.0005, -0.0005),
    "blur": 0.8,
    "motion_blur": 1.5,
    "noise": 0.015,
    "exposure": 0.15,
    "gloss": 0.1,
    "jpeg_quality": 88,
}


def main(views: int, phone: bool, method: str) -> None:
    parameters = read_parameters()
    rendering = parameters.renderings["demo"].model_copy(update={"views": views, **(PHONE if phone else {})})
    objects = {name: load_prepared_object(name) for name in rendering.objects}
    workers = parameters.compute.workers
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "capture"
        begin = time.perf_counter()
        render_capture(folder, "demo", objects, rendering, parameters.seed, workers)
        print(f"rendered in {time.perf_counter() - begin:.0f} s")
        settings = parameters.reconstruct.model_copy(update={"method": method})
        begin, (before, _) = time.perf_counter(), cost_so_far()
        result = reconstruct(read_capture(folder), settings, parameters.seed, workers)
        wall, (after, memory) = time.perf_counter() - begin, cost_so_far()
        print(json.dumps(metrics_of(result, method, read_truth(folder)), indent=2))
    print(f"{wall:.0f} s, {after - before:.0f} CPU s, {memory:.0f} MB in the largest process")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", type=int, default=24)
    parser.add_argument("--phone", action="store_true")
    parser.add_argument("--method", choices=["plane_sweep", "2dgs"], default="plane_sweep")
    chosen = parser.parse_args()
    main(chosen.views, chosen.phone, chosen.method)
