"""How many chains of synthesis end in grasps that hold at a friction, and what one such grasp costs, object by object.

    python benchmarks/survival.py [--friction 0.5] [--set synthesize.side.weight_offset=1000] [--objects cube plum]

`--friction` is that of every touching pair; `--set` changes parameters of params.yaml for the run. Candidates are
synthesized anew and validated with every check, in this process, one after the other; seeds are those of the run.
Needs prepared objects below data/ (`dvc repro prepare`). Prints a row per object and, for every term of the energy
that candidates are scored by, how well it predicts survival: the area under the ROC curve, 0.5 if it says nothing.
With `--out` the tested candidates are written as a table.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Any

for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import pandas as pd  # noqa: E402
import yaml  # noqa: E402
from scipy.stats import mannwhitneyu  # noqa: E402

from pipeline.hand.model import Hand, load_hand  # noqa: E402
from pipeline.hand.support import PLANE  # noqa: E402
from pipeline.records.energy_terms import COLUMNS  # noqa: E402
from pipeline.records.errors import UserError  # noqa: E402
from pipeline.records.objects import load_prepared_object  # noqa: E402
from pipeline.records.parameters import Parameters, read_parameters  # noqa: E402
from pipeline.synthesize.candidates import Request, synthesize  # noqa: E402
from pipeline.validate.checks import check_candidate  # noqa: E402
from pipeline.validate.table import candidate_of  # noqa: E402


def changed(parameters: Parameters, changes: dict[str, Any]) -> Parameters:
    """Return the parameters with some values, given by their dotted names, replaced and checked."""
    values = parameters.model_dump(by_alias=True)
    for name, value in changes.items():
        *sections, last = name.split(".")
        section = values
        for key in sections:
            section = section[key]
        if last not in section:
            raise UserError(f"--set {name}: there is no such parameter; see params.yaml.")
        section[last] = value
    return Parameters.model_validate(values)


def predicts(term: pd.Series, held: pd.Series) -> float:
    """Return the chance that a grasp that held has a lower term than one that did not; nan without both kinds."""
    good = held.to_numpy(bool)
    pairs = good.sum() * (~good).sum()
    return float(mannwhitneyu(term[~good], term[good]).statistic / pairs) if pairs else float("nan")


def survivors(parameters: Parameters, style: str, name: str, hand: Hand, most: int) -> tuple[pd.DataFrame, list[float]]:
    """Return the tested candidates of one object with the column ``held``, and CPU s of synthesis and validation."""
    prepared = load_prepared_object(name)
    begin = time.process_time()
    rows = synthesize(
        Request(
            prepared=prepared,
            style=style,
            run_seed=parameters.seed,
            energy=parameters.synthesize.energy,
            optimizer=parameters.synthesize.optimizer,
            settings=getattr(parameters.synthesize, style),
            hand=hand,
        ),
        1,
    )
    synthesized = time.process_time()
    passed = rows[rows.rejected_by == ""].head(most).reset_index(drop=True)
    verdicts = [
        check_candidate(prepared, candidate_of(row, PLANE, hand), parameters.physics, parameters.validate_)
        for row in passed.to_dict("records")
    ]
    seconds = [synthesized - begin, time.process_time() - synthesized]
    rejected = [verdict["rejected_by"] for verdict in verdicts]
    return passed.assign(rejected_by=rejected, held=[reason == "" for reason in rejected]), seconds


def main(options: argparse.Namespace) -> None:
    changes = dict(item.split("=", 1) for item in options.set)
    parameters = changed(read_parameters(), {name: yaml.safe_load(value) for name, value in changes.items()})
    if options.friction is not None:
        parameters = parameters.model_copy(update={"validate_": parameters.validate_.at_friction(options.friction)})
    hand = load_hand(parameters.hand)
    counts = f"{'chains':>6} {'passed':>6} {'held':>6} {'share':>7}"
    print(f"{'style':6} {'object':18} {counts} {'synthesis':>9} {'tests':>7} {'CPU s each':>10}")
    tables = []
    for style in ("pinch", "side"):
        for name in getattr(parameters.styles, style):
            if options.objects and name not in options.objects:
                continue
            table, seconds = survivors(parameters, style, name, hand, options.grasps)
            chains = getattr(parameters.synthesize, style).chains
            held, tested = int(table.held.sum()), len(table)
            each = f"{sum(seconds) / held:10.2f}" if held else f"{'-':>10}"
            counted = f"{chains:6d} {tested:6d} {held:6d} {held / chains:7.1%}"
            spent = f"{seconds[0]:9.1f} {seconds[1]:7.1f}"
            print(f"{style:6} {name:18} {counted} {spent} {each}", flush=True)
            tables.append(table)
    tested = pd.concat(tables, ignore_index=True)
    for style, rows in tested.groupby("style"):
        terms = {column: predicts(rows[column], rows.held) for column in COLUMNS.values()}
        print(f"{style}: " + ", ".join(f"{column} {value:.2f}" for column, value in terms.items()))
    if options.out:
        tested.to_parquet(options.out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--friction", type=float, help="of every touching pair (default: those of physics)")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter of params.yaml")
    parser.add_argument("--objects", nargs="*", default=[], help="names (default: all of both styles)")
    parser.add_argument("--grasps", type=int, default=10000, help="most candidates tested per object (default: all)")
    parser.add_argument("--out", type=Path, help="parquet file for the tested candidates")
    try:
        main(parser.parse_args())
    except UserError as error:
        sys.exit(str(error))
