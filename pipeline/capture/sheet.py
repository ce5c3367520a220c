"""Printable tags and boards of tags, as PDF, in true size and with a ruler that shows whether the printer kept it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.capture.markers import printed_cells
from pipeline.records.errors import UserError
from pipeline.records.tag_layouts import TAG_FAMILIES, Board, TagLayout

PAGES = {"a4": (0.210, 0.297), "letter": (0.2159, 0.2794)}  # m
POINT = 0.0254 / 72  # m, PDF's unit
MARGIN = 0.012  # m, that printers leave white
RULER = 0.1  # m
FOOT = 0.032  # m at the lower edge of a page, for the ruler and its text
LABEL = 0.005  # m below a tag
FONT_SIZE = 9.0  # points
LETTER = 0.5  # of the font's size: mean width of a letter of Helvetica


def _number(metres: float) -> str:
    return f"{metres / POINT:.4f}"


def _rectangle(x: float, y: float, width: float, height: float) -> str:
    return f"{_number(x)} {_number(y)} {_number(width)} {_number(height)} re"


def _text(x: float, y: float, text: str, size: float = FONT_SIZE) -> str:
    return f"BT /F1 {size:g} Tf {_number(x)} {_number(y)} Td ({text}) Tj ET"


def _black(cells: NDArray[np.uint8], x: float, y: float, size: float) -> list[str]:
    """Return the drawing of a tag whose black square has its lower left corner at (x, y), m."""
    count = len(cells)
    cell = size / count
    drawn = ["0 g", _rectangle(x, y, size, size), "f", "1 g"]
    for row, column in np.argwhere(cells > 0).tolist():
        drawn.append(_rectangle(x + column * cell, y + (count - 1 - row) * cell, cell, cell))
    return [*drawn, "f"]


def _tag(number: int, layout: TagLayout, x: float, y: float) -> list[str]:
    """Return the drawing of one tag with its label; its black square has its lower left corner at (x, y), m."""
    size, cell = layout.size, layout.size / layout.cells
    label = f"{layout.family}  {number}   (this side down)"
    fitting = min(FONT_SIZE, round((size + cell) / POINT / (LETTER * len(label)), 1))  # not under the next tag
    drawn = _black(printed_cells(number, layout), x, y, size)
    return [*drawn, "0 g", _text(x, y - cell - LABEL + 0.001, label, fitting)]


def _ruler(y: float, size: float) -> list[str]:
    drawn = ["0 g"]
    for millimetre in range(round(1000 * RULER) + 1):
        length = 0.006 if millimetre % 10 == 0 else 0.004 if millimetre % 5 == 0 else 0.0025
        drawn.append(_rectangle(MARGIN + millimetre / 1000 - 0.00005, y, 0.0001, length))
    drawn += [_rectangle(MARGIN, y, RULER, 0.0001), "f"]
    text = f"This ruler must be 100 mm long and every black square {1000 * size:g} mm wide. If not, print at 100 %,"
    return [
        *drawn,
        _text(MARGIN, y - 0.005, text),
        _text(MARGIN, y - 0.009, "or write the measured width into tags.yaml. Leave the white border when cutting."),
    ]


def _pdf(pages: Sequence[str], size: tuple[float, float]) -> bytes:
    """Return a PDF of pages given by their drawing operators."""
    box = f"[0 0 {_number(size[0])} {_number(size[1])}]"
    first = 4  # objects 1 to 3: catalogue, pages, font; then a page and its content in turn
    kids = " ".join(f"{first + 2 * index} 0 R" for index in range(len(pages)))
    objects = [
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>",
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    for index, content in enumerate(pages):
        objects += [
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents {first + 2 * index + 1} 0 R "
            "/Resources << /Font << /F1 3 0 R >> >> >>",
            f"<< /Length {len(content)} >>\nstream\n{content}\nendstream",
        ]
    text, places = "%PDF-1.6\n", []
    for number, body in enumerate(objects, start=1):
        places.append(len(text))
        text += f"{number} 0 obj\n{body}\nendobj\n"
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    end = f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{len(text)}\n%%EOF\n"
    return (f"{text}xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}{end}").encode("ascii")


def tag_sheet(numbers: Sequence[int], layout: TagLayout, page: str) -> bytes:
    """Return a PDF with these tags, to be cut out, as many on a page as fit.

    Args:
        layout: family, size and convention of the tags; their places do not matter.
        page: ``a4`` or ``letter``.

    Raises:
        UserError: the family has no such tag, or a tag does not fit on the page.
    """
    count, size = TAG_FAMILIES[layout.family][0], layout.size
    wrong = next((number for number in numbers if not 0 <= number < count), None)
    if wrong is not None:
        raise UserError(f"the family {layout.family} has no tag {wrong}; its tags are 0 to {count - 1}.")
    width, height = PAGES[page]
    place = size * (1 + 2 / layout.cells)  # with one white cell all around
    across = int((width - 2 * MARGIN) / place)
    down = int((height - 2 * MARGIN - FOOT) / (place + LABEL))
    if across < 1 or down < 1:
        largest = min(width - 2 * MARGIN, height - 2 * MARGIN - FOOT - LABEL) / (1 + 2 / layout.cells)
        raise UserError(
            f"a tag of {1000 * size:g} mm does not fit on {page} paper; choose {int(1000 * largest)} mm or less."
        )
    pages = []
    for start in range(0, len(numbers), across * down):
        drawn = _ruler(MARGIN + 0.012, size)
        for index, number in enumerate(numbers[start : start + across * down]):
            x = MARGIN + (index % across) * place + size / layout.cells
            y = height - MARGIN - (index // across + 1) * (place + LABEL) + LABEL + size / layout.cells
            drawn += _tag(number, layout, x, y)
        pages.append("\n".join(drawn))
    return _pdf(pages, (width, height))


def _between(board: Board, middles: Mapping[int, tuple[float, float]], size: float) -> list[tuple[float, float, float]]:
    """Return what else is black on a board: middle (m from the board's) and edge of squares."""
    if board.square is not None:
        return [
            (
                board.square * (column - (board.columns - 1) / 2),
                board.square * ((board.rows - 1) / 2 - row),
                board.square,
            )
            for row in range(board.rows)
            for column in range(board.columns)
            if (row + column) % 2 == 0
        ]
    gap = board.gap or 0.0
    if board.kind != "aprilgrid":
        return []
    half = (size + gap) / 2  # kalibr's grid has a small square at every corner of every tag
    return sorted(
        {
            (round(x + i, 7), round(y + j, 7), gap)
            for x, y in middles.values()
            for i in (-half, half)
            for j in (-half, half)
        }
    )


def board_sheet(layout: TagLayout, page: str) -> bytes:
    """Return a PDF with the board of a layout on one page, upright.

    Raises:
        UserError: it does not fit on the page.
    """
    board = layout.board
    if board is None:
        raise ValueError("the layout is no board")
    width, height = PAGES[page]
    middles = board.middles(layout.size)
    edge = board.square or layout.size
    reach = [max(abs(place[axis]) for place in middles.values()) + edge / 2 for axis in (0, 1)]
    squares = _between(board, middles, layout.size)
    reach = [max([reach[axis], *(abs(one[axis]) + one[2] / 2 for one in squares)]) for axis in (0, 1)]
    room = width - 2 * MARGIN, height - 2 * MARGIN - FOOT
    if 2 * reach[0] > room[0] + 1e-9 or 2 * reach[1] > room[1] + 1e-9:
        raise UserError(
            f"the board is {2000 * reach[0]:.0f} x {2000 * reach[1]:.0f} mm large and does not fit on {page} paper, "
            f"which has room for {1000 * room[0]:.0f} x {1000 * room[1]:.0f} mm; choose fewer or smaller tags."
        )
    x0, y0 = width / 2, MARGIN + FOOT + room[1] / 2
    drawn = [*_ruler(MARGIN + 0.012, layout.size), "0 g"]
    drawn += [_rectangle(x0 + x - side / 2, y0 + y - side / 2, side, side) for x, y, side in squares]
    drawn += ["f"] if squares else []
    for number, (x, y) in middles.items():
        cells = printed_cells(number, layout)
        drawn += _black(cells, x0 + x - layout.size / 2, y0 + y - layout.size / 2, layout.size)
    return _pdf(["\n".join(drawn)], (width, height))
