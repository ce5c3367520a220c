"""The data card: what ``data/merge`` holds, how it came about, and how to read it. Markdown."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from pipeline.hand.model import Hand
from pipeline.records.parameters import Parameters
from pipeline.records.tables import MERGED
from pipeline.report.counting import Counts
from pipeline.report.diversity import SECTORS, PairDiversity, UsedGrasps, diversity, read_validated
from pipeline.report.markdown import table, text_table, wrapped
from pipeline.report.meanings import MERGE, VALIDATION, meaning_of
from pipeline.report.objects import ObjectFacts, read_facts
from pipeline.report.pairs_table import uses
from pipeline.report.rates import MOST_PAIRS, Funnel, PairMerge, Spread, ratio, spread, summed
from pipeline.report.settings import Row, all_settings
from pipeline.stages.versions import installed_versions

# The sections of params.yaml on which data/merge depends.
DATA_SECTIONS = ("run", "styles", "objects", "meshes", "prepare", "synthesize", "physics", "validate", "merge")

EXAMPLE = """from pathlib import Path
import numpy as np, pandas as pd

tried = pd.concat(map(pd.read_parquet, sorted(Path("data/merge").glob("*.parquet"))), ignore_index=True)
grasps = tried[tried["rejected_by"] == ""]
first, second = np.stack(grasps["objects"]).T
print(pd.crosstab(first, second))
q = np.stack(grasps["q"])  # (grasps, 16) rad; poses of both objects: positions_hand_object, quaternions_hand_object
"""


@dataclass(frozen=True)
class CardContent:
    """Everything that the card contains."""

    scale: str
    seed: int
    funnels: Sequence[Funnel]
    merges: Sequence[PairMerge]
    used: Sequence[UsedGrasps]  # none past ``MOST_PAIRS`` pairs, likewise the next
    diversity: Sequence[PairDiversity]
    uses: Sequence[tuple[int, int, int]]  # per pair: distinct pinch and side grasps, uses of the commonest one
    distinct_distance: float  # m
    objects: Sequence[ObjectFacts]
    columns: pa.Schema
    versions: Mapping[str, str]
    settings: Mapping[str, Sequence[Row]]  # per section


def card_content(parameters: Parameters, hand: Hand, counts: Counts) -> CardContent:
    """Read what the data card contains besides counts, and return all of it.

    Raises:
        UserError: a file is missing or damaged.
    """
    few = len(counts.merges) <= MOST_PAIRS
    used, pairs = diversity(counts.synthesized, read_validated(counts.singles), hand) if few else ([], [])
    names = sorted({name for one in counts.merges for name in (one.first, one.second)})
    return CardContent(
        scale=parameters.scale,
        seed=parameters.seed,
        funnels=counts.funnels,
        merges=counts.merges,
        used=used,
        diversity=pairs,
        uses=[uses(one) for one in counts.synthesized],
        distinct_distance=parameters.merge.distinct_distance,
        objects=[read_facts(name) for name in names],
        columns=MERGED,
        versions=installed_versions(),
        settings=all_settings(parameters),
    )


def dataset_card(content: CardContent) -> str:
    """Return the card as Markdown."""
    parts = [
        _head(content),
        _counts(content.merges),
        _singles(content.funnels, content.used) if content.used else _many_singles(content.funnels),
        _checks(content.funnels, content.merges),
        _diversity(content) if content.diversity else _many_pairs(content),
        _columns(content.columns),
        _provenance(content),
    ]
    return "\n\n".join(wrapped(part).strip() for part in parts) + "\n"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _millimetres(metres: float) -> str:
    return "-" if np.isnan(metres) else f"{1000 * metres:.1f}"


def _head(content: CardContent) -> str:
    counts = [merge.accepted for merge in content.merges]
    return f"""# Data set: grasps of two objects in one hand

{sum(counts)} two-object grasps of {len(counts)} pairs, at least {min(counts, default=0)} per pair: an Allegro hand
(right) holds a first object with thumb, index and middle finger and a second one with ring finger and palm. Every grasp
passed all tests listed below, physics with both objects in the hand among them. This page is written by the stage
`report`
from the tables themselves.

The tables are `data/merge/<first object>.parquet`, one row per combination that was tried, pair by pair; rejected
ones are kept with the first check that they failed. In a clone of the repository, `dvc pull` fetches them.

```python
{EXAMPLE}```
"""


def _grid(merges: Sequence[PairMerge], cell: Mapping[tuple[str, str], str]) -> str:
    firsts = list(dict.fromkeys(merge.first for merge in merges))
    seconds = list(dict.fromkeys(merge.second for merge in merges))
    rows = [[first, *(cell.get((first, second), "") for second in seconds)] for first in firsts]
    return table(["first \\ second", *seconds], rows)


def _spreads(first_column: str, rows: Iterable[tuple[str, Spread, int]]) -> str:
    """Return how values are distributed, each row with its number of digits."""
    header = [first_column, "mean", "least", "quartile 1", "median", "quartile 3", "most"]
    cells = [
        [title, *(f"{value:.{digits}f}" for value in (s.mean, s.least, s.quartile_1, s.median, s.quartile_3, s.most))]
        for title, s, digits in rows
    ]
    return table(header, cells)


def _counts(merges: Sequence[PairMerge]) -> str:
    if len(merges) > MOST_PAIRS:
        rows = [
            ("accepted grasps", spread([merge.accepted for merge in merges]), 1),
            ("accepted / tried (%)", spread([100 * merge.acceptance_rate for merge in merges]), 1),
        ]
        return f"""## Grasps per pair

{_spreads("of a pair", rows)}

`reports/pairs.parquet` has a row for every pair.
"""
    accepted = {(m.first, m.second): str(m.accepted) for m in merges}
    rates = {(m.first, m.second): _percent(m.acceptance_rate) for m in merges}
    return f"""## Grasps per pair

{_grid(merges, accepted)}

Share of the tried combinations that were accepted:

{_grid(merges, rates)}
"""


def _singles(funnels: Sequence[Funnel], used: Sequence[UsedGrasps]) -> str:
    parts = {(one.style, one.object_name): one for one in used}
    rows = []
    for funnel in funnels:
        one = parts[funnel.style, funnel.object_name]
        angles = np.rad2deg(one.approach_elevations)
        elevations = np.percentile(angles, [10, 50, 90]).tolist() if len(angles) else []
        rows.append(
            [
                f"{funnel.object_name} ({funnel.style})",
                funnel.optimised,
                funnel.validated,
                len(one.grasp_ids),
                one.contact_sets,
                ", ".join(f"{fingers} {_percent(ratio(n, len(one.grasp_ids)))}" for fingers, n in one.fingers.items()),
                f"{len(np.unique(one.sectors))} of {SECTORS}",
                " / ".join(f"{value:.0f}" for value in elevations) or "-",
                f"{one.joint_spread:.2f}",
            ]
        )
    header = ["object (style)", "chains", "validated", "used", "contact sets", "fingers", "headings"]
    header += ["elevation (degrees)", "joint spread (rad)"]
    return f"""## Single grasps

What the pairs are made of. *Used*: single grasps that are part of at least one merged grasp; the columns after it
describe these. *Contact sets*: distinct sets of contact points on the hand. *Headings*: sectors of 30 degrees of
the object's compass in which the hand is found. *Elevation*: of the straight line on which the hand comes, over the
horizontal, 10th, 50th and 90th percentile. *Joint spread*: standard deviation over the grasps, mean over the joints
of the holding fingers.

{table(header, rows)}
"""


def _many_singles(funnels: Sequence[Funnel]) -> str:
    rows = []
    for style in dict.fromkeys(funnel.style for funnel in funnels):
        own = [funnel for funnel in funnels if funnel.style == style]
        rows += [
            (f"validated grasps, {style}", spread([funnel.validated for funnel in own]), 1),
            (f"validated / chains (%), {style}", spread([100 * funnel.survival_rate for funnel in own]), 1),
        ]
    return f"""## Single grasps

What the pairs are made of.

{_spreads("of an object", rows)}
"""


def _checks(funnels: Sequence[Funnel], merges: Sequence[PairMerge]) -> str:
    sections = []
    for style in dict.fromkeys(funnel.style for funnel in funnels):
        own = [funnel for funnel in funnels if funnel.style == style]
        tested = sum(funnel.passed for funnel in own)
        rejected = summed(funnel.validate_rejected for funnel in own)
        passed = sum(funnel.validated for funnel in own)
        title = f"`validate`, {style} grasps: {tested} tested, {_percent(ratio(passed, tested))} passed."
        sections.append(title + "\n\n" + _shares(rejected, tested, VALIDATION))
    tried = sum(merge.tried for merge in merges)
    accepted = sum(merge.accepted for merge in merges)
    title = f"`merge`: {tried} combinations tried, {_percent(ratio(accepted, tried))} accepted."
    sections.append(title + "\n\n" + _shares(summed(merge.rejected for merge in merges), tried, MERGE))
    return "## Checks\n\nEvery row counts for the check that it failed first.\n\n" + "\n\n".join(sections) + "\n"


def _shares(rejected: Mapping[str, int], whole: int, meanings: Mapping[str, str]) -> str:
    ordered = sorted(rejected.items(), key=lambda item: (-item[1], item[0]))
    rows = [[f"`{check}`", _percent(ratio(number, whole)), meaning_of(check, meanings)] for check, number in ordered]
    return text_table(["rejected by", "share", "meaning"], rows)


def _diversity(content: CardContent) -> str:
    rows = [
        [
            f"{pair.first}, {pair.second}",
            pair.grasps,
            pair.pinch_grasps,
            pair.side_grasps,
            pair.most_uses,
            _millimetres(pair.closest),
            _millimetres(pair.typical),
            f"{pair.sectors0} / {pair.sectors1}",
        ]
        for pair in content.diversity
    ]
    header = ["pair", "grasps", "pinch grasps", "side grasps", "most uses", "closest (mm)", "typical (mm)", "headings"]
    return f"""## Diversity

Two single grasps of an object count as one when the part of the hand that counts (side: ring finger and palm;
pinch: all but the ring finger), seen from the object, lies less than {_millimetres(content.distinct_distance)} mm
apart on average over its surface; no combination of two single grasps is in a table twice. So any two merged grasps
of a pair differ by at least that in one of their halves. *Closest* and *typical* (median) are distances of two
merged grasps of the pair: the larger one of the distances of their halves. *Most uses*: how many merged grasps
share one single grasp. *Headings*: sectors of 30 degrees, out of {SECTORS}, in which the hand is seen from the
first and from the second object.

{table(header, rows)}
"""


def _many_pairs(content: CardContent) -> str:
    titles = ("distinct pinch grasps", "distinct side grasps", "most uses")
    rows = [(title, spread(values), 1) for title, values in zip(titles, zip(*content.uses, strict=True), strict=True)]
    return f"""## Diversity

Two single grasps of an object count as one when the part of the hand that counts (side: ring finger and palm;
pinch: all but the ring finger), seen from the object, lies less than {_millimetres(content.distinct_distance)} mm
apart on average over its surface; no combination of two single grasps is in a table twice. *Most uses*: how many merged
grasps share one single grasp.

{_spreads("of a pair", rows)}
"""


def _columns(schema: pa.Schema) -> str:
    rows = [[f"`{field.name}`", f"`{type_name(field.type)}`", description_of(field)] for field in schema]
    return f"""## Columns

The hand frame is the Allegro's `base_link`: palm normal +x, fingers +z, index finger on the side of +y. The frame
of an object has its origin at the centre of mass and z up when the object stands. Lengths in metres, angles in
radians. Columns of checks that were not reached are empty. The same descriptions are in the files:
`pyarrow.parquet.read_schema(file).field(name).metadata`.

{text_table(["column", "type", "meaning"], rows)}
"""


def type_name(kind: pa.DataType) -> str:
    """Return a column's type in short: ``double[16]`` for vectors of 16, ``double[]`` for lists."""
    if pa.types.is_fixed_size_list(kind):
        return f"{type_name(kind.value_type)}[{kind.list_size}]"
    return f"{type_name(kind.value_type)}[]" if pa.types.is_list(kind) else str(kind)


def description_of(field: pa.Field) -> str:
    """Return the description of a column, '' if nothing."""
    return (field.metadata or {}).get(b"description", b"").decode()


def parameters_digest(settings: Mapping[str, Sequence[Row]]) -> str:
    """Return a hash of all parameters on which the data depends: equal for equal values."""
    values = {name: value for section in DATA_SECTIONS for name, value, _ in settings.get(section, ())}
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def _each_object(objects: Sequence[ObjectFacts]) -> str:
    rows = [
        [
            one.name,
            one.source,
            one.licence,
            " x ".join(f"{1000 * extent:.1f}" for extent in one.extents),
            f"{1000 * one.mass:.1f}",
        ]
        for one in objects
    ]
    return text_table(["object", "source", "licence", "size (mm)", "mass (g)"], rows)


def _by_licence(objects: Sequence[ObjectFacts]) -> str:
    rows = []
    for licence in sorted({one.licence for one in objects}):
        own = [one for one in objects if one.licence == licence]
        longest = [1000 * max(one.extents) for one in own]
        masses = [1000 * one.mass for one in own]
        rows.append(
            [licence, len(own), f"{min(longest):.1f} to {max(longest):.1f}", f"{min(masses):.1f} to {max(masses):.1f}"]
        )
    rows_by_licence = text_table(["licence", "objects", "longest extent (mm)", "mass (g)"], rows)
    return f"{rows_by_licence}\n\nThe source of each object is in `data/prepare/<object>/object.json`."


def _provenance(content: CardContent) -> str:
    objects = _each_object(content.objects) if len(content.objects) <= MOST_PAIRS else _by_licence(content.objects)
    versions = ", ".join(f"{name} {version}" for name, version in content.versions.items())
    return f"""## Provenance and licences

Computed by this repository's DVC pipeline from shape recipes and published scans; no human grasp, no real robot.
Scale `{content.scale}`, seed {content.seed}, parameters `{parameters_digest(content.settings)}` (SHA-256 of their
values, first 16 digits; `params.yaml` has them, `dvc.lock` the hashes of every file). Packages: {versions}.

{objects}

Recipes and tables are this project's own work under the [MIT licence](../LICENSE). What is derived from scans of
the YCB object and model set is passed on under CC BY 4.0 with the credit in [NOTICE](../NOTICE), which also names
the authors and licences of the descriptions of the hand (BSD 2-Clause) and the arm (Apache 2.0). Meshes of your own
keep their own licence.

Limits: contacts are those of rigid bodies with one coefficient of friction, objects have
uniform density, and nothing here was tried on hardware. How often a robot in
simulation lifts both objects with them is in `reports/summary.json` ([what the figures mean](../docs/metrics.md)).
"""
