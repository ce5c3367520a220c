"""The page of published runs over time: a plot and a table of benchmarks/history.csv."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pandas as pd

from tools.history import COLUMNS, COSTS, HISTORY_FILE, RATES

PLOT = "history.svg"
PANELS = {
    "rate": [name for name in RATES if name != "merged_grasps"],
    "CPU seconds": list(COSTS),
}
INTRODUCTION = f"""# Published runs over time

![Rates and costs of every published run]({PLOT})

Every published run, from `benchmarks/history.csv`, which `python -m tools.history` writes: a commit that changed the
summary in `reports/` (the demo) or under `results/`. `survival_rate` is the share of single grasps that validation
accepts, with the checks that the commit had. CPU seconds are those of the machine that published the run, divided by
accepted single grasps (synthesis and validation) and by trials; a stage that was restored from the cache keeps the cost
of the run that made it.

"""


def history(root: Path) -> pd.DataFrame:
    """Return the published runs, the oldest first."""
    return pd.read_csv(root / HISTORY_FILE)


def page(root: Path) -> str:
    """Return the page as Markdown."""
    found = history(root)
    shown = found.loc[:, list(COLUMNS)].astype(object).where(found.notna(), "")
    return INTRODUCTION + shown.to_markdown(index=False, tablefmt="github", disable_numparse=True) + "\n"


def plot(root: Path) -> bytes:
    """Return the plot as SVG: a panel of rates and one of costs; each scale has lines of its own."""
    import matplotlib
    from matplotlib.figure import Figure

    found = history(root)
    with matplotlib.rc_context({"svg.hashsalt": HISTORY_FILE.name, "svg.fonttype": "path"}):
        figure = Figure(figsize=(9.0, 6.0), layout="constrained")
        panels = figure.subplots(2, 1, sharex=True)
        for panel, (title, names) in zip(panels, PANELS.items(), strict=True):
            _draw(panel, title, names, found)
        panels[-1].set_xticks(range(len(found)), [f"{row.date[5:]}\n{row.commit}" for row in found.itertuples()])
        target = io.BytesIO()
        figure.savefig(target, format="svg", metadata={"Date": None})
    return target.getvalue()


def _draw(panel: Any, title: str, names: list[str], found: pd.DataFrame) -> None:
    for marker, (scale, own) in zip("os^v", found.groupby("scale", sort=True), strict=False):
        for number, name in enumerate(names):
            known = own[own[name].notna()]
            if len(known):
                label = f"{name.replace('_', ' ')}, {scale}"
                panel.plot(known.index, known[name], marker=marker, color=f"C{number}", label=label)
    panel.set_ylabel(title)
    panel.set_ylim(bottom=0)
    panel.grid(alpha=0.3)
    panel.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
