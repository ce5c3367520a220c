"""Validation on processes and on a local Dask cluster, each with one worker and with two: time, CPU, speed-up, bytes.

    nice python benchmarks/cluster.py [--style pinch] [--object cube] [--candidates 80] [--rounds 2] [--max-workers 2]

Needs the prepared object and its candidates (`dvc repro synthesize@pinch`). Every round runs all ways one after
the other, so that other load on the machine meets all of them; the least time of each counts. Before every measurement
a way computes some candidates, so that no start of processes is in the figures (but in a column of its own). CPU
seconds are those of this process and all workers; "empty" are items that do nothing, which shows what sending costs.
Two minutes on two free cores. Target: two Dask workers at least 1.7 times as fast as one.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import pandas as pd  # noqa: E402

import pipeline  # noqa: E402, F401  (sets the thread counts before numpy is imported)
from pipeline.compute.fan_out import Workers, fan_out  # noqa: E402
from pipeline.records import paths  # noqa: E402
from pipeline.records.errors import UserError  # noqa: E402
from pipeline.records.objects import load_prepared_object  # noqa: E402
from pipeline.records.parameters import load_parameters  # noqa: E402
from pipeline.records.parameters.compute import ComputeParameters  # noqa: E402
from pipeline.records.tables import CANDIDATES, VALIDATED, read_table, write_table  # noqa: E402
from pipeline.stages.cost import cost_so_far  # noqa: E402

EMPTY = 200  # items that do nothing, to see what the way itself costs


@dataclass
class Way:
    name: str
    workers: Workers
    start: float = 0.0
    walls: list[float] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    empty: float = 0.0
    digest: str = ""


def nothing(number: int) -> int:
    return number


def digest_of(table: pd.DataFrame) -> str:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "validated.parquet"
        write_table(file, table, VALIDATED)
        return hashlib.md5(file.read_bytes()).hexdigest()


def main(style: str, name: str, candidates: int, rounds: int, most: int) -> None:
    from pipeline.hand.model import load_hand
    from pipeline.hand.support import PLANE
    from pipeline.validate.table import validate_table

    parameters = load_parameters(["hand", "physics", "validate"])
    hand = load_hand(parameters["hand"])
    table, prepared = (
        read_table(paths.candidates_file(style, name), CANDIDATES, "synthesize"),
        load_prepared_object(name),
    )
    limits = parameters["validate"].model_copy(update={"most_candidates": candidates})
    warm = parameters["validate"].model_copy(update={"most_candidates": most})
    counts = sorted({1, most})
    ways = [Way(f"processes {count}", count) for count in counts]
    ways += [Way(f"dask {count}", ComputeParameters(backend="dask", workers=count)) for count in counts]
    for turn in range(rounds):
        for way in ways:
            begin = time.perf_counter()
            label = f"{way.name}: start"
            validate_table(table, prepared, parameters["physics"], warm, way.workers, label, PLANE, hand)
            way.start = way.start or time.perf_counter() - begin
            begin, cost = time.perf_counter(), cost_so_far()[0]
            rows = validate_table(table, prepared, parameters["physics"], limits, way.workers, way.name, PLANE, hand)
            way.walls.append(time.perf_counter() - begin)
            way.costs.append(cost_so_far()[0] - cost)
            if not turn:
                way.digest = digest_of(rows)
                cost = cost_so_far()[0]
                fan_out(nothing, range(EMPTY), way.workers, f"{way.name}: nothing")
                way.empty = (cost_so_far()[0] - cost) / EMPTY
    print(f"{'':13} {'start s':>8} {'wall s':>8} {'CPU s':>8} {'speed-up':>9} {'CPU ms per empty item':>22}  bytes")
    for way in ways:
        alone = ways[0 if way.name.startswith("processes") else len(counts)]
        same = "equal" if way.digest == ways[0].digest else "DIFFERENT"
        print(
            f"{way.name:13} {way.start:8.1f} {min(way.walls):8.2f} {min(way.costs):8.2f} "
            f"{min(alone.walls) / min(way.walls):9.2f} {1000 * way.empty:22.1f}  {same}"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--style", default="pinch", choices=("pinch", "side"), help="default: pinch")
    parser.add_argument("--object", default="cube", help="default: cube")
    parser.add_argument("--candidates", type=int, default=80, help="candidates of a measurement (default: 80)")
    parser.add_argument("--rounds", type=int, default=2, help="measurements of every way (default: 2)")
    parser.add_argument("--max-workers", type=int, default=2, help="workers beside one (default: 2)")
    options = parser.parse_args()
    try:
        main(options.style, options.object, options.candidates, options.rounds, options.max_workers)
    except UserError as error:
        sys.exit(str(error))
