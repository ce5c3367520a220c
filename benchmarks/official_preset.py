"""Validated grasps per CPU second: this project's synthesis against that of the paper's released code, in one run.

    python benchmarks/official_preset.py [--objects cube bunny slender_cylinder lemon] [--chains 192] [--minutes 60]

Both presets of conf/preset synthesize the same number of chains per object and style, on the objects of
conf/scale/paper.yaml (prepared into data/prepare where they are missing, which is not counted). The candidates of both
go through the same strict validation. Target: ours gives at least 5 times as many validated grasps per CPU second, on
each object. `paper rule` counts the grasps in which some link presses at the end of all six gravities, wherever the
object went; the directions that early rejection leaves out are simulated for it and not counted. `synthesis ratio` is
what the ratio would be if physics cost nothing.

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

from pipeline.records import paths  # noqa: E402
from pipeline.records.errors import UserError  # noqa: E402
from pipeline.records.objects import PreparedObject, load_prepared_object, write_prepared_object  # noqa: E402
from pipeline.records.parameters import Parameters, read_parameters  # noqa: E402
from pipeline.records.tables import CANDIDATES  # noqa: E402
from pipeline.synthesize.candidates import Request, synthesize  # noqa: E402
from pipeline.validate.table import validate_table  # noqa: E402
from pipeline.workspace.scales import compose  # noqa: E402

PRESETS = ("ours", "official")
OBJECTS = ["cube", "bunny", "slender_cylinder", "lemon"]
TARGET = 5  # times the official validated grasps per CPU second
FROGGER_OBJECTS = ("soup_can", "plum", "cube")
FROGGER_SECONDS = 1.03  # CPU s per grasp
HEADER = f"{'object':18} {'preset':9} {'chains':>6} {'passed':>6} {'valid':>6} {'paper rule':>10} {'synthesis s':>11} "
HEADER += f"{'validation s':>12} {'valid/CPU min':>13} {'ratio':>6} {'synthesis ratio':>15}"


@dataclasses.dataclass(frozen=True)
class Figures:
    """What one preset made of one object."""

    chains: int
    passed: int  # the energy filter
    validated: int  # strict rules
    contact_only: int  # of those that passed the filter: pass by the paper's rule of the six gravities
    synthesis: float  # CPU s
    validation: float  # CPU s

    @property
    def synthesis_rate(self) -> float:
        """Validated grasps per CPU minute of synthesis alone."""
        return 60 * self.validated / self.synthesis

    @property
    def rate(self) -> float:
        """Validated grasps per CPU minute."""
        return 60 * self.validated / (self.synthesis + self.validation)


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
    return synthesize(Request(prepared, style, parameters.seed, energy, optimizer, settings), workers=1)


def late_contact_only(tested: pd.DataFrame, prepared: PreparedObject, parameters: Parameters) -> int:
    """Count passes by the paper's rule among the grasps whose test ended before that was known."""
    early = tested[tested["rejected_by"].str.startswith("gravity:") & tested["contact_only_pass"].isna()]
    again = early[list(CANDIDATES.names)].assign(rejected_by="").reset_index(drop=True)
    limits = parameters.validate_.model_copy(update={"early_rejection": False, "table_test": False})
    label = f"paper rule {prepared.name}, {parameters.preset}"
    late = validate_table(again, prepared, parameters.physics, limits, 1, label)
    return int(late["contact_only_pass"].eq(True).sum())


def measure(prepared: PreparedObject, style: str, parameters: Parameters, chains: int) -> Figures:
    """Synthesize and validate one object with one preset."""
    begin = cpu_seconds()
    rows = candidates(prepared, style, parameters, chains)
    middle = cpu_seconds()
    label = f"validate {style} {prepared.name}, {parameters.preset}"
    tested = validate_table(rows, prepared, parameters.physics, parameters.validate_, 1, label)
    end = cpu_seconds()
    passed = rows["rejected_by"] == ""
    contact_only = int(tested["contact_only_pass"].eq(True).sum()) + late_contact_only(tested, prepared, parameters)
    return Figures(
        chains=len(rows),
        passed=int(passed.sum()),
        validated=int((tested["rejected_by"] == "").sum()),
        contact_only=contact_only,
        synthesis=middle - begin,
        validation=end - middle,
    )


def line(name: str, preset: str, figures: Figures, ratios: str = "") -> str:
    """One row of the table."""
    counts = f"{figures.chains:6d} {figures.passed:6d} {figures.validated:6d} {figures.contact_only:10d}"
    costs = f"{figures.synthesis:11.1f} {figures.validation:12.1f} {figures.rate:13.1f}"
    return f"{name:18} {preset:9} {counts} {costs} {ratios}"


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
    measure(cube, "pinch", settings["ours"], 48)  # imports, compiled kernels
    print(HEADER, flush=True)
    for name in names:
        if time.monotonic() - begin > 60 * minutes:
            print(f"{name:18} left out: the {minutes:g} minutes are over", flush=True)
            continue
        prepared = prepared_object(name, settings["ours"])
        figures = {preset: measure(prepared, styles[name], settings[preset], chains) for preset in PRESETS}
        ours, official = (figures[preset] for preset in PRESETS)
        ratios = f"{times(ours.rate, official.rate):>6} {times(ours.synthesis_rate, official.synthesis_rate):>15}"
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
