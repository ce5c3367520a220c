"""Figures as picture files, for the README and for slides."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pipeline.report.charts import MOST_CELLS, PASSED_COLOUR, ink_on, scale_colour
from pipeline.report.rates import PairTrials
from pipeline.report.wording import percent, spoken

MOST_COLUMNS = 6  # pictures in one row of a strip


def success_picture(pairs: Sequence[PairTrials]) -> bytes:
    """Return the success per pair as PNG: a heat map, or a histogram where it would not be readable."""
    cells = len({pair.first for pair in pairs}) * len({pair.second for pair in pairs})
    return heat_map_picture(pairs) if cells <= MOST_CELLS else histogram_picture(pairs)


def histogram_picture(pairs: Sequence[PairTrials]) -> bytes:
    """Return how many pairs have which success rate as PNG."""
    figure = Figure(figsize=(7, 3.2), dpi=120, layout="tight")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.hist([100 * pair.success_rate for pair in pairs], bins=range(0, 101, 5), color=PASSED_COLOUR, rwidth=0.92)
    axes.set_xlabel("success of a pair (%)")
    axes.set_ylabel("pairs")
    axes.spines[["top", "right"]].set_visible(False)
    return _png(figure)


def _png(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def heat_map_picture(pairs: Sequence[PairTrials]) -> bytes:
    """Return the success heat map as PNG: rows are first objects, columns are second objects."""
    firsts, seconds = list(dict.fromkeys(p.first for p in pairs)), list(dict.fromkeys(p.second for p in pairs))
    figure = Figure(figsize=(2.2 + 1.25 * len(seconds), 1.1 + 0.75 * len(firsts)), dpi=120, layout="tight")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for pair in pairs:
        column, row = seconds.index(pair.second), firsts.index(pair.first)
        colour = scale_colour(pair.success_rate)
        face = tuple(channel / 255 for channel in colour)
        axes.add_patch(Rectangle((column, row), 1, 1, facecolor=face, edgecolor="white", linewidth=3))
        style: dict[str, Any] = {"ha": "center", "va": "center", "color": ink_on(colour)}
        axes.text(column + 0.5, row + 0.42, percent(pair.success_rate).replace("\u202f", " "), fontsize=12, **style)
        axes.text(column + 0.5, row + 0.72, f"{pair.successes} of {pair.trials}", fontsize=8, **style)
    axes.set(xlim=(0, len(seconds)), ylim=(len(firsts), 0))
    axes.set_xticks([i + 0.5 for i in range(len(seconds))], map(spoken, seconds))
    axes.set_yticks([i + 0.5 for i in range(len(firsts))], map(spoken, firsts))
    axes.set_xlabel("picked up second")
    axes.set_ylabel("picked up first")
    axes.xaxis.set_label_position("top")
    axes.tick_params(length=0, top=False, labeltop=True, bottom=False, labelbottom=False)
    axes.spines[:].set_visible(False)
    return _png(figure)


def contact_sheet(pictures: Sequence[NDArray[np.uint8]], captions: Sequence[str]) -> bytes:
    """Return all pictures (h, w, 3) of a strip in one JPEG, in rows, each with its phase written below."""
    (height, width), caption = pictures[0].shape[:2], 24
    columns = min(MOST_COLUMNS, len(pictures))
    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (columns * width, rows * (height + caption)), "white")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(15)
    for index, (picture, text) in enumerate(zip(pictures, captions, strict=True)):
        x, y = index % columns * width, index // columns * (height + caption)
        sheet.paste(Image.fromarray(picture), (x, y))
        draw.text((x + width / 2, y + height + caption / 2), text, fill="#222222", font=font, anchor="mm")
    buffer = io.BytesIO()
    sheet.save(buffer, format="JPEG", quality=85)
    return buffer.getvalue()
