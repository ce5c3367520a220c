"""Prepare every mesh of a folder and show on one page what became of it.

    python benchmarks/strangers.py FOLDER [--page strangers.html] [--most 200]

Each mesh is prepared in a process of its own, which is ended after a limit of time. The page shows a picture of the
file and of the object, what was done, the table of what changed, and the sentence where a mesh was refused.
"""

from __future__ import annotations

import argparse
import base64
import html
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path

SECONDS = 120  # of the clock, times the processes that share a core
ROOT = Path(__file__).resolve().parents[1]
STYLE = """body {font: 14px sans-serif; margin: 2em} td {vertical-align: top; border-top: 1px solid #ccc; padding: 6px}
pre {margin: 0; white-space: pre-wrap; max-width: 60em} img {width: 240px} .refused {color: #a50} .died {color: #c00}"""


@dataclass
class Outcome:
    """What became of one mesh."""

    file: str
    outcome: str = "died"  # prepared, refused, died or hung
    said: list[str] = field(default_factory=list)
    seconds: float = 0.0
    before: str = ""  # PNG, base64
    after: str = ""


def prepare_one(path: Path) -> Outcome:
    """Prepare one mesh in this process, standing on whichever axis it stands."""
    from pipeline.prepare.change import table
    from pipeline.prepare.portrait import portrait
    from pipeline.prepare.preparation import prepare_object
    from pipeline.prepare.sources import raw_mesh
    from pipeline.records.errors import UserError
    from pipeline.records.parameters import read_parameters
    from pipeline.records.parameters.objects import MeshParameters

    outcome = Outcome(str(path), "refused")
    settings = read_parameters(ROOT / "params.yaml").prepare
    shape = MeshParameters(file=str(path), fit_longest=0.1)
    try:
        raw = raw_mesh(shape, "mesh", read_from=path)
        outcome.before = _picture(raw.vertices, raw.faces)
        prepared = None
        for up in (None, "+z", "-z", "+y", "-y", "+x", "-x"):
            try:
                prepared = prepare_object("mesh", shape.model_copy(update={"up": up}), settings, raw)
            except UserError as error:
                if "does not stand" not in str(error) or up == "-x":
                    raise
            else:
                break
        assert prepared is not None
    except UserError as error:
        outcome.said = [str(error)]
        return outcome
    facts = prepared.provenance
    changes = table(facts["changes"]) if "changes" in facts else []
    outcome.outcome, outcome.said = "prepared", [*facts["repairs"], *changes, f"{len(prepared.parts)} convex parts"]
    outcome.after = base64.b64encode(portrait(prepared)).decode()
    return outcome


def _picture(vertices, faces) -> str:  # type: ignore[no-untyped-def]
    """Return triangles as they come from a file as a picture; empty if they cannot be drawn."""
    import numpy as np

    from pipeline.pictures.camera import framing
    from pipeline.pictures.picture import png_bytes
    from pipeline.pictures.render import Body, render

    used = vertices[np.unique(faces)]
    if not len(used) or not np.isfinite(used).all() or np.ptp(used, axis=0).max() == 0:
        return ""
    camera = framing(used, aspect=1.2)
    pixels = render([Body(vertices, faces, (0.45, 0.55, 0.7))], camera, 300, 250, floor=float(used[:, 2].min()))
    return base64.b64encode(png_bytes(pixels)).decode()


def prepare_apart(path: Path, seconds: float) -> Outcome:
    """Prepare one mesh in a process of its own."""
    begin = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, __file__, "--one", str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    try:
        said, errors = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return Outcome(str(path), "hung", [f"not done after {seconds:.0f} s"], seconds)
    if process.returncode:
        last = errors.strip().splitlines()[-1:] or [f"exit code {process.returncode}"]
        return Outcome(str(path), "died", last, time.monotonic() - begin)
    outcome = Outcome(**json.loads(said.splitlines()[-1]))
    outcome.seconds = time.monotonic() - begin
    return outcome


def page(outcomes: list[Outcome], folder: Path) -> str:
    """Return the contact sheet."""

    def picture(content: str) -> str:
        return f'<img alt="" src="data:image/png;base64,{content}">' if content else ""

    rows = [
        f"<tr><td>{html.escape(str(Path(one.file).relative_to(folder)))}<br>{one.seconds:.0f} s</td>"
        f"<td>{picture(one.before)}</td><td>{picture(one.after)}</td>"
        f'<td class="{one.outcome}"><b>{one.outcome}</b><pre>{html.escape(chr(10).join(one.said))}</pre></td></tr>'
        for one in outcomes
    ]
    counts = ", ".join(f"{count} {name}" for name, count in Counter(one.outcome for one in outcomes).most_common())
    return (
        f'<!doctype html><meta charset="utf-8"><title>Strangers</title><style>{STYLE}</style>'
        f"<h1>{len(outcomes)} meshes: {counts}</h1><table>{''.join(rows)}</table>"
    )


def main() -> int:
    """Run the command."""
    from pipeline.records.geometry import FORMATS

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--page", type=Path, default=Path("strangers.html"))
    parser.add_argument("--most", type=int, default=1000, help="meshes, spread evenly over the folder")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="that one mesh may take")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.one:
        print(json.dumps(asdict(prepare_one(chosen.one))))
        return 0
    if not chosen.folder or not chosen.folder.is_dir():
        parser.error("give the folder of meshes")
    found = sorted(path for path in chosen.folder.rglob("*") if path.suffix.lower().lstrip(".") in FORMATS)
    found = (
        [found[place * len(found) // chosen.most] for place in range(chosen.most)]
        if len(found) > chosen.most
        else found
    )
    outcomes = []
    for path in found:
        outcomes.append(prepare_apart(path, chosen.seconds))
        print(f"{outcomes[-1].outcome:9} {outcomes[-1].seconds:6.1f} s  {path}: {'; '.join(outcomes[-1].said)[:150]}")
        chosen.page.write_text(page(outcomes, chosen.folder), encoding="utf-8")
    return int(any(one.outcome in ("died", "hung") for one in outcomes))


if __name__ == "__main__":
    raise SystemExit(main())
