"""The objects that come from packages: what became of each, as a file of its own and in one table of all."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.prepare.graspable import fitting_styles, size_of
from pipeline.records import paths
from pipeline.records.catalogue import PREPARED, REFUSED, catalogue_text, read_catalogue
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.objects import RESTING, AssetMesh
from pipeline.stages.outputs import Folders

RECORD = "asset.json"


def row_of(name: str, mesh: AssetMesh, prepared: PreparedObject | None, reason: str = "") -> dict[str, Any]:
    """Return the row of an object in the catalogue.

    Args:
        prepared: None where it was refused, for the ``reason``.
    """
    row: dict[str, Any] = {"name": name, "source": mesh.source, "path": mesh.path, "licence": mesh.licence}
    if prepared is None:
        return row | {"outcome": REFUSED, "reason": reason}
    size = size_of(prepared.vertices)
    facts = prepared.provenance
    return row | {
        "outcome": PREPARED,
        "styles": " ".join(fitting_styles(size) if mesh.styles == RESTING else mesh.styles),
        "width_mm": round(1000 * size.width, 1),
        "depth_mm": round(1000 * size.depth, 1),
        "height_mm": round(1000 * size.height, 1),
        "mass_g": round(1000 * prepared.mass, 1),
        "pose_probability": facts.get("pose_probability", ""),
        "convex_parts": len(prepared.parts),
        "repairs": "; ".join(facts["repairs"]),
    }


def record(row: dict[str, Any]) -> bytes:
    """Return the file :data:`RECORD` of an object."""
    return json.dumps(row, indent=2).encode() + b"\n"


def totals(rows: Sequence[dict[str, str]]) -> list[str]:
    """Return one line for each source: how many were asked for, prepared, and refused."""
    lines = []
    for source in dict.fromkeys(row["source"] for row in rows):
        own = [row for row in rows if row["source"] == source]
        made = [row for row in own if row["outcome"] == PREPARED]
        styles = {style: sum(style in row["styles"].split() for row in made) for style in ("pinch", "side")}
        lines.append(
            f"{source}: {len(made)} of {len(own)} objects prepared, {styles['pinch']} for pinch, {styles['side']} for "
            f"side, {sum(not row['styles'] for row in made)} fit no style; {paths.CATALOGUE_FILE} says why others not"
        )
    return lines


@dataclass(frozen=True)
class PreparedFolders(Folders):
    """The folders of prepared objects, and the catalogue of those that come from packages."""

    def write(self, folder: Path, keys: Sequence[str], result: Callable[[str], dict[str, bytes]]) -> None:
        """Write the folder of every object, and the catalogue."""
        rows: list[dict[str, Any]] = []

        def noted(key: str) -> dict[str, bytes]:
            files = result(key)
            if RECORD in files:
                rows.append(json.loads(files[RECORD]))
            return files

        super().write(folder, keys, noted)
        if rows:
            (folder / paths.CATALOGUE_FILE.name).write_text(catalogue_text(rows), encoding="utf-8")

    def place(self, made: Path, target: Path) -> None:
        """Move the folder of an object to its place, or add rows to the catalogue that is there."""
        if made.name != paths.CATALOGUE_FILE.name:
            super().place(made, target)
            return
        known = {row["name"]: row for row in read_catalogue(target)} if target.exists() else {}
        known |= {row["name"]: row for row in read_catalogue(made)}
        target.write_text(catalogue_text(known.values()), encoding="utf-8")
