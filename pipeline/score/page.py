"""The page of scored grasps: self-contained, in the style of the report."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from PIL import Image

from pipeline.hand.model import Hand
from pipeline.pictures.camera import framing
from pipeline.pictures.colours import OBJECT_COLOURS
from pipeline.pictures.render import Body, render
from pipeline.pictures.robot import hand_bodies
from pipeline.records.poses import inverse_pose
from pipeline.report.meanings import MERGE, VALIDATION, meaning_of
from pipeline.report.rendering import environment, verbatim
from pipeline.report.wording import percent
from pipeline.score.foreign import ForeignFile
from pipeline.score.frames import FrameCheck
from pipeline.score.joints import JointMap
from pipeline.score.rows import HOLDS
from pipeline.score.scoring import ReadyGrasp

TEMPLATES = Path(__file__).parent / "templates"
WIDTH, HEIGHT = 260, 220  # pixels
MOST_PICTURES = 60


@dataclass(frozen=True)
class Reading:
    """What the page says of how the file was read."""

    file: ForeignFile
    hand: Hand
    joints: JointMap
    frames: FrameCheck
    settings: Mapping[str, str]


def picture(grasp: ReadyGrasp, hand: Hand) -> bytes:
    """Return a WebP of a grasp, the first object upright."""
    T_world_hand = grasp.T_object_hand[0]
    bodies = [
        Body(prepared.vertices, prepared.faces, colour, T_world_hand @ inverse_pose(T))
        for prepared, T, colour in zip(grasp.objects, grasp.T_object_hand, OBJECT_COLOURS, strict=False)
    ]
    bodies += hand_bodies(T_world_hand, grasp.q, hand)
    points = np.concatenate([body.world_vertices() for body in bodies])
    camera = framing(points, aspect=WIDTH / HEIGHT)
    pixels = render(bodies, camera, WIDTH, HEIGHT, floor=float(points[:, 2].min()) - 0.005)
    target = io.BytesIO()
    Image.fromarray(pixels).save(target, format="WEBP", quality=80, method=4)
    return target.getvalue()


def build_page(reading: Reading, table: pd.DataFrame, pictures: Sequence[bytes]) -> str:
    """Return the page; ``pictures`` are of the first grasps."""
    plain = table.astype(object).where(table.notna(), None)
    rows: list[dict[str, Any]] = [dict(zip(table.columns, values, strict=True)) for values in plain.to_numpy()]
    engines = [name.removesuffix("_rejected_by") for name in table.columns if name.endswith("_rejected_by")]
    cards = [
        {"row": row, "picture": pictures[index] if index < len(pictures) else None, "engines": _told(row, engines)}
        for index, row in enumerate(rows)
    ]
    return (
        environment(TEMPLATES)
        .get_template("scores.html")
        .render(
            style=verbatim("page.css"),
            reading=reading,
            tiles=_tiles(table, engines),
            reasons=[(engine, _reasons(table, engine)) for engine in engines],
            columns=list(table.columns),
            cards=cards,
            rows=[[_cell(value) for value in row.values()] for row in rows],
        )
    )


def _tiles(table: pd.DataFrame, engines: Sequence[str]) -> list[tuple[str, str]]:
    count = len(table)
    tiles = [(percent(float((table["verdict"] == HOLDS).mean())), f"of {count} hold in every engine")]
    tiles += [(percent(float((table[f"{name}_rejected_by"] == "").mean())), f"hold in {name}") for name in engines]
    for name in engines:
        survived = table[f"{name}_robustness"].dropna()
        if len(survived):
            tiles.append(
                (percent(float(survived.astype(float).mean())), f"conditions survived by those that hold, {name}")
            )
    return tiles


def _reasons(table: pd.DataFrame, engine: str) -> list[tuple[str, int, str]]:
    """Return every first failed check with its count and meaning, the commonest first."""
    counts = Counter(reason for reason in table[f"{engine}_rejected_by"] if reason)
    meanings = {**MERGE, **VALIDATION} if not table["objects"].str.contains(" + ", regex=False).any() else MERGE
    return [(reason, count, meaning_of(reason, meanings)) for reason, count in counts.most_common()]


def _told(row: Mapping[str, Any], engines: Sequence[str]) -> list[str]:
    lines = []
    for engine in engines:
        failed = row[f"{engine}_failed"]
        if failed:
            lines.append(f"{engine}: fails {failed}")
            continue
        share, friction = row[f"{engine}_robustness"], row[f"{engine}_lowest_friction"]
        survived = "" if share is None else f"; survives {percent(share)} of conditions"
        lowest = "" if friction is None else f"; down to friction {friction:g}"
        lines.append(f"{engine}: holds{survived}{lowest}")
    return lines


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
