"""Validated grasps per CPU second: this project's synthesis against that of the paper's released code, in one run.

    python benchmarks/official_preset.py [--objects cube bunny slender_cylinder lemon] [--chains 192] [--minutes 60]

Both presets of conf/preset synthesize the same number of chains per object and style, on the objects of
conf/scale/paper.yaml (prepared into data/prepare where they are missing, which is not counted). What makes a grasp
valid is the same strict rule for both; what its tests cost is counted twice:

same validation: the candidates of both go through ours.
own validation:  each preset pays for its own. The official one simulates all six gravities of every grasp, with the
                 released contact offset, and the approach and table test of those that held. The same verdicts come
                 out, but for what chance decides (its own count of valid grasps is used).

Target: ours gives at least 5 times as many validated grasps per CPU second, on each object. `synthesis alone` is what
the ratio would be if physics cost nothing. `paper rule` counts the grasps in which some link presses at the end of all
six gravities, wherever the object went; the directions that early rejection leaves out are simulated for it and not
counted.

Then, against FRoGGeR (arXiv 2302.13687): CPU seconds per grasp that passes our energy filter. Target: a tenth of its
1.03 (median over soup can, plum and cube, its witness frames mended, without any physics).

Everything runs in this process, on one core; the figures are its CPU seconds with those of its children. Imports,
kernel compilation and some grasps through physics come before the clock starts.
"""

from __future__ import annotations

import argparse
import dataclasses
import resource
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from pipeline.hand.model import load_hand  # noqa: E402
from pipeline.hand.support import PLANE  # noqa: E402
from pipeline.physics.holding import hold_in_gravities  # noqa: E402
from pipeline.records import paths  # noqa: E402
from pipeline.records.errors import UserError  # noqa: E402
from pipeline.records.objects import PreparedObject, load_prepared_object, write_prepared_object  # noqa: E402
from pipeline.records.parameters import Parameters, read_parameters  # noqa: E402
from pipeline.records.tables import CANDIDATES  # noqa: E402
from pipeline.synthesize.candidates import Request, synthesize  # noqa: E402
from pipeline.validate.checks import check_candidate, held_grasp  # noqa: E402
from pipeline.validate.table import candidate_of, validate_table  # noqa: E402
from tools.scales import compose  # noqa: E402

PRESETS = ("ours", "official")
OBJECTS = ["cube", "bunny", "slender_cylinder", "lemon"]
TARGET = 5  # times the official validated grasps per CPU second
FROGGER_OBJECTS = ("soup_can", "plum", "cube")
FROGGER_SECONDS = 1.03  # CPU s per grasp
GROUPS = f"{'':59}{'same validation':^25}  {'own validation':^25}   {'times official':^22}"
HEADER = f"{'object':18} {'preset':9} {'chains':>6} {'passed':>6} {'paper':>5} {'synth. s':>9} "
HEADER += 2 * f"{'valid':>5} {'CPU s':>7} {'per CPU min':>11}  " + f" {'same':>6} {'own':>6} {'synth.':>8}"


@dataclasses.dataclass(frozen=True)
class Validation:
    """What a validation made of the candidates of one object, and its price."""

    validated: int  # strict rules
    seconds: float  # CPU s


@dataclasses.dataclass(frozen=True)
class Figures:
    """What one preset made of one object."""

    chains: int
    passed: int  # the energy filter
    contact_only: int  # of those that passed the filter: pass by the paper's rule of the six gravities
    synthesis: float  # CPU s
    same: Validation  # ours, for both presets
    own: Validation  # the preset's own

    @property
    def synthesis_rate(self) -> float:
        """Grasps valid by the same validation per CPU minute of synthesis alone."""
        return 60 * self.same.validated / self.synthesis

    def rate(self, validation: Validation) -> float:
        """Validated grasps per CPU minute."""
        return 60 * validation.validated / (self.synthesis + validation.seconds)


def cpu_seconds() -> float:
    """CPU seconds of this process and its finished children."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def composed(preset: str) -> Parameters:
    """Parameters of the paper scale with a preset."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "params.yaml"
        compose("paper", target, preset)
        return read_parameters(target)


def prepared_object(name: str, parameters: Parameters) -> PreparedObject:
    """Read data/prepare/<name>, which is made first where it is missing."""
    if not paths.prepared_folder(name).exists():
        from pipeline.prepare.portrait import portrait
        from pipeline.prepare.preparation import prepare_object

        print(f"preparing {name}", file=sys.stderr)
        made = prepare_object(name, parameters.objects[name], parameters.prepare)
        write_prepared_object(paths.prepared_folder(name), made, portrait(made))
    return load_prepared_object(name)


def candidates(prepared: PreparedObject, style: str, parameters: Parameters, chains: int) -> pd.DataFrame:
    """Synthesize in this process."""
    settings = getattr(parameters.synthesize, style).model_copy(update={"chains": chains})
    energy, optimizer = parameters.synthesize.energy, parameters.synthesize.optimizer
    hand = load_hand(parameters.hand)
    return synthesize(Request(prepared, style, parameters.seed, energy, optimizer, settings, hand), workers=1)


def late_contact_only(tested: pd.DataFrame, prepared: PreparedObject, parameters: Parameters) -> int:
    """Count passes by the paper's rule among the grasps whose test ended before that was known."""
    early = tested[tested["rejected_by"].str.startswith("gravity:") & tested["contact_only_pass"].isna()]
    again = early[list(CANDIDATES.names)].assign(rejected_by="").reset_index(drop=True)
    limits = parameters.validate_.model_copy(update={"early_rejection": False, "table_test": False})
    label = f"paper rule {prepared.name}, {parameters.preset}"
    late = validate_table(again, prepared, parameters.physics, limits, 1, label, PLANE, load_hand(parameters.hand))
    return int(late["contact_only_pass"].eq(True).sum())


def released_validation(rows: pd.DataFrame, prepared: PreparedObject, parameters: Parameters) -> tuple[Validation, int]:
    """Validate as the released code spends: all gravities of all grasps, then the rest for those that held.

    Returns:
        The validation, and how many grasps pass by the paper's rule.
    """
    begin = cpu_seconds()
    limits, physics = parameters.validate_, parameters.physics
    rest = limits.model_copy(update={"early_rejection": True})
    outcomes = []
    for row in rows[rows["rejected_by"] == ""].to_dict("records"):
        candidate = candidate_of(row, PLANE, load_hand(parameters.hand))
        grasp = held_grasp(prepared, candidate, limits.squeeze(candidate.style))
        holding = hold_in_gravities(physics, limits, grasp.objects, grasp.q, grasp.squeeze_q, grasp.hand)
        outcomes.append(check_candidate(prepared, candidate, physics, rest, holding))
    seconds = cpu_seconds() - begin
    validated = sum(outcome["rejected_by"] == "" for outcome in outcomes)
    return Validation(validated, seconds), sum(outcome["contact_only_pass"] is True for outcome in outcomes)


def measure(prepared: PreparedObject, style: str, parameters: Parameters, ours: Parameters, chains: int) -> Figures:
    """Synthesize one object with one preset, and validate it as ``ours`` does and as the preset does."""
    begin = cpu_seconds()
    rows = candidates(prepared, style, parameters, chains)
    middle = cpu_seconds()
    label = f"validate {style} {prepared.name}, {parameters.preset}"
    tested = validate_table(rows, prepared, ours.physics, ours.validate_, 1, label, PLANE, load_hand(ours.hand))
    same = Validation(int((tested["rejected_by"] == "").sum()), cpu_seconds() - middle)
    if parameters.preset == ours.preset:
        known = int(tested["contact_only_pass"].eq(True).sum())
        own, contact_only = same, known + late_contact_only(tested, prepared, ours)
    else:
        own, contact_only = released_validation(rows, prepared, parameters)
    passed = int((rows["rejected_by"] == "").sum())
    return Figures(len(rows), passed, contact_only, middle - begin, same, own)


def line(name: str, preset: str, figures: Figures, ratios: str = "") -> str:
    """One row of the table."""
    counts = f"{figures.chains:6d} {figures.passed:6d} {figures.contact_only:5d} {figures.synthesis:9.1f}"
    costs = "  ".join(
        f"{each.validated:5d} {each.seconds:7.1f} {figures.rate(each):11.1f}" for each in (figures.same, figures.own)
    )
    return f"{name:18} {preset:9} {counts} {costs}   {ratios}"


def times(ours: float, official: float) -> str:
    """How many times as much."""
    return f"{ours / official:.1f}" if official else "-"


def compare(names: list[str], chains: int, minutes: float) -> None:
    """Print the table of both presets, object by object."""
    begin = time.monotonic()
    settings = {preset: composed(preset) for preset in PRESETS}
    styles = {name: style for style in ("pinch", "side") for name in getattr(settings["ours"].styles, style)}
    unknown = sorted(set(names) - set(styles))
    if unknown:
        raise UserError(f"there is no object {unknown[0]!r} in conf/scale/paper.yaml; use some of {', '.join(styles)}.")
    cube = prepared_object("cube", settings["ours"])
    measure(cube, "pinch", settings["ours"], settings["ours"], 48)  # imports, compiled kernels
    print(GROUPS, HEADER, sep="\n", flush=True)
    for name in names:
        if time.monotonic() - begin > 60 * minutes:
            print(f"{name:18} left out: the {minutes:g} minutes are over", flush=True)
            continue
        prepared = prepared_object(name, settings["ours"])
        ours, official = (
            measure(prepared, styles[name], settings[preset], settings["ours"], chains) for preset in PRESETS
        )
        ratios = " ".join(
            f"{times(ours.rate(mine), official.rate(theirs)):>6}"
            for mine, theirs in ((ours.same, official.same), (ours.own, official.own))
        )
        ratios += f" {times(ours.synthesis_rate, official.synthesis_rate):>8}"
        print(line(name, "ours", ours, ratios), flush=True)
        print(line(name, "official", official), flush=True)


def against_frogger(chains: int) -> None:
    """Print CPU seconds per grasp that passes the energy filter."""
    parameters = composed("ours")
    print(f"\nCPU seconds per grasp that passes the energy filter; FRoGGeR: {FROGGER_SECONDS}")
    for name in FROGGER_OBJECTS:
        style = "pinch" if name in parameters.styles.pinch else "side"
        prepared = prepared_object(name, parameters)
        begin = cpu_seconds()
        passed = int((candidates(prepared, style, parameters, chains)["rejected_by"] == "").sum())
        each = (cpu_seconds() - begin) / max(passed, 1)
        print(
            f"{name:18} {style:5} {passed:4d} of {chains} pass, {each:.4f} s, {FROGGER_SECONDS / each:.0f} times fewer"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", default=OBJECTS, metavar="NAME", help=f"(default: {' '.join(OBJECTS)})")
    parser.add_argument("--chains", type=int, default=192, help="per object and preset (default: 192)")
    parser.add_argument("--minutes", type=float, default=60.0, help="start no further object after (default: 60)")
    options = parser.parse_args()
    try:
        compare(options.objects, options.chains, options.minutes)
        against_frogger(options.chains)
    except UserError as error:
        sys.exit(str(error))
