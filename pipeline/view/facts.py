"""A row in words: Markdown for the panel, and the names of rows that it came from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from jinja2 import Environment, StrictUndefined

from pipeline.records import paths
from pipeline.records.objects import PreparedObject
from pipeline.records.sources import SOURCES
from pipeline.records.tables import CHECKED, description
from pipeline.report.meanings import MERGE, SYNTHESIS, TRIALS, VALIDATION, meaning_of
from pipeline.view.rows import Colour

SINGLE = {**SYNTHESIS, **VALIDATION}  # of what rejects single grasps


def _measured(column: pa.Field) -> tuple[str, int]:
    unit = description(column).partition(",")[0]
    return ("mm" if unit == "m" else unit), 2


# Columns that the panel shows, with unit and digits.
GRASP_COLUMNS = {
    "energy": ("", 3),
    "energy_force_closure": ("", 3),
    "energy_distance": ("mm", 2),
    "energy_penetration": ("mm", 2),
    **{column.name: _measured(column) for column in CHECKED if column.type == pa.float64()},
    "object_clearance": ("mm", 2),
    "hand_clearance": ("mm", 2),
    "mount_clearance": ("mm", 2),
    "approach_length1": ("mm", 0),
    "lowest_friction": ("", 2),
    "robustness": ("", 2),
}
_LEGEND = Environment(autoescape=True, trim_blocks=True, undefined=StrictUndefined).from_string(
    """
{% for reason, count, colour in lines %}
<div style="font-size:.85em;padding:0 1em">
<span style="display:inline-block;width:.8em;height:.8em;background:rgb({{ colour | join(',') }})"></span>
 {{ reason | replace('_', ' ') }}: {{ count }}</div>
{% endfor %}"""
)
TRIAL_COLUMNS = {"height0": ("mm", 0), "height1": ("mm", 0), "push1": ("mm", 1)}


def _number(value: float, unit: str, digits: int) -> str:
    return f"{value * (1e3 if unit == 'mm' else 1):.{digits}f} {unit}".strip()


def _table(lines: Sequence[tuple[str, str]]) -> str:
    return "\n".join(["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in lines)])


def _numbers(row: Mapping[str, Any], columns: Mapping[str, tuple[str, int]]) -> list[tuple[str, str]]:
    return [
        (column.replace("_", " "), _number(float(row[column]), unit, digits))
        for column, (unit, digits) in columns.items()
        if row.get(column) is not None and np.isfinite(row[column])
    ]


def grasp_facts(row: Mapping[str, Any]) -> str:
    """Return outcome and figures of a row of candidates, validated or two-object grasps."""
    rejected_by = row["rejected_by"]
    meanings = MERGE if "merged_id" in row else SINGLE
    outcome = "passed all checks"
    if rejected_by:
        meaning = meaning_of(rejected_by, meanings)
        outcome = f"rejected by **{rejected_by.replace('_', ' ')}**" + (f": {meaning}" if meaning else "")
    fingers = [row[name] for name in ("fingers", "fingers0", "fingers1") if row.get(name)]
    lines = [("held by", ", then ".join(fingers).replace("+", " + ")), *_numbers(row, GRASP_COLUMNS)]
    drifts = row.get("gravity_drift")
    if drifts is not None and len(drifts):
        lines.append(("worst gravity drift", _number(float(np.nanmax(drifts)), "mm", 2)))
    return f"{outcome}\n\n{_table(lines)}"


def trial_facts(row: Mapping[str, Any], moment: int) -> str:
    """Return outcome and figures of a row of trials; its snapshot ``moment`` is shown."""
    outcome = "success" if row["success"] else f"failed: **{row['reason']}**, {meaning_of(row['reason'], TRIALS)}"
    phases = row["snapshot_phases"]
    shown = f"end of *{phases[moment]}*" if len(phases) else "no moment was recorded"
    lines = [("shown", shown), ("grasp", str(row["merged_id"])), ("last phase", row["phase"])]
    lines += _numbers(row, TRIAL_COLUMNS)
    lines += [("planning attempts", str(row["planning_attempts"])), ("steps of physics", str(row["steps"]))]
    return f"{outcome}\n\n{_table(lines)}"


def replay_command(name: str) -> str:
    """Return the command that runs a trial again."""
    return f"./dev replay {name.removeprefix('evaluate/').removeprefix('conditions/')}"


def object_facts(prepared: PreparedObject) -> str:
    """Return size, mass and origin of a prepared object."""
    provenance = prepared.provenance
    lines = [
        ("size", " x ".join(f"{1e3 * extent:.1f}" for extent in prepared.extents) + " mm"),
        ("mass", f"{1e3 * prepared.mass:.0f} g"),
        ("volume", f"{1e6 * prepared.volume:.1f} cm³"),
        ("faces", str(len(prepared.faces))),
        ("convex parts", str(len(prepared.parts))),
    ]
    lines += [(key, str(provenance[key])) for key in ("source", "licence") if isinstance(provenance.get(key), str)]
    return _table(lines)


def reconstruction_facts(name: str, metrics: Mapping[str, Any]) -> str:
    """Return how well photos of an object were reconstructed, from the metrics of its capture."""
    lines = [(key.replace("_", " "), f"{value:.4g}") for key, value in metrics.get("objects", {}).get(name, {}).items()]
    cameras = f"{metrics.get('registered', '?')} of {metrics.get('photos', '?')} cameras found"
    return f"{cameras}, by {str(metrics.get('method', '?')).replace('_', ' ')}\n\n{_table(lines)}"


def related(line: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, str]:
    """Return the names of rows that a row came from, by what to call them."""
    view, _, rest = line["name"].partition("/")
    first, second, source = line["first"], line["second"], line["source"]
    if view == "validate":
        return {"candidate": f"synthesize/{rest}", "object": f"prepare/{first}"}
    if view == "synthesize":
        return {"validated": f"validate/{rest}", "object": f"prepare/{first}"}
    if view == "merge":
        return {
            "pinch": f"validate/pinch/{first}/{row['grasp0_id']}",
            "side": f"validate/side/{second}/{row['grasp1_id']}",
        }
    if view == "evaluate" and row["merged_id"] >= 0 and source in SOURCES:
        folder = "/".join(SOURCES[source].folder.parts[1:])
        return {"its grasp": f"{folder}/{first}/{second}/{row['merged_id']}"}
    if view == "sample" and source == paths.RECONSTRUCTED:
        return {first: f"prepare/{first}", second: f"prepare/{second}"}
    return {"object": f"prepare/{first}"} if view == "reconstruct" else {}


def legend(counts: Mapping[str, int], colours: Mapping[str, Colour]) -> str:
    """Return HTML: reasons with their colours and how many rows share each."""
    shown = [(reason, count, [round(255 * channel) for channel in colours[reason]]) for reason, count in counts.items()]
    return _LEGEND.render(lines=[line for line in shown if line[0]])


def heading(line: pd.Series, place: int, count: int) -> str:
    """Return the first lines about a row: its name, and its place among those selected."""
    return f"**{line['name']}** ({place + 1} of {count})"
