"""A printable sheet of AprilTags, as PDF, in true size and with a ruler that shows whether the printer kept it."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.capture.markers import CELLS, tag_cells
from pipeline.records.errors import UserError

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


def _tag(number: int, x: float, y: float, size: float) -> list[str]:
    """Return the drawing of one tag whose black square has its lower left corner at (x, y), m."""
    cell = size / CELLS
    cells = tag_cells(number)
    drawn = ["0 g", _rectangle(x, y, size, size), "f", "1 g"]
    for row in range(CELLS):
        for column in range(CELLS):
            if cells[row, column]:
                drawn.append(_rectangle(x + column * cell, y + (CELLS - 1 - row) * cell, cell, cell))
    label = f"tag36h11  {number}   (this side down)"
    fitting = min(FONT_SIZE, round((size + cell) / POINT / (LETTER * len(label)), 1))  # not under the next tag
    return [*drawn, "f", "0 g", _text(x, y - cell - LABEL + 0.001, label, fitting)]


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


def tag_sheet(numbers: Sequence[int], size: float, page: str) -> bytes:
    """Return a PDF with these tags, as many on a page as fit.

    Args:
        numbers: of the family tag36h11, 0 to 586.
        size: edge of the black square, m.
        page: ``a4`` or ``letter``.

    Raises:
        UserError: the family has no such tag, or a tag does not fit on the page.
    """
    wrong = next((number for number in numbers if not 0 <= number < 587), None)
    if wrong is not None:
        raise UserError(f"the family tag36h11 has no tag {wrong}; its tags are 0 to 586.")
    width, height = PAGES[page]
    place = size * (1 + 2 / CELLS)  # with one white cell all around
    across = int((width - 2 * MARGIN) / place)
    down = int((height - 2 * MARGIN - FOOT) / (place + LABEL))
    if across < 1 or down < 1:
        largest = min(width - 2 * MARGIN, height - 2 * MARGIN - FOOT - LABEL) / (1 + 2 / CELLS)
        raise UserError(
            f"a tag of {1000 * size:g} mm does not fit on {page} paper; choose {int(1000 * largest)} mm or less."
        )
    pages = []
    for start in range(0, len(numbers), across * down):
        drawn = _ruler(MARGIN + 0.012, size)
        for index, number in enumerate(numbers[start : start + across * down]):
            x = MARGIN + (index % across) * place + size / CELLS
            y = height - MARGIN - (index // across + 1) * (place + LABEL) + LABEL + size / CELLS
            drawn += _tag(number, x, y, size)
        pages.append("\n".join(drawn))
    return _pdf(pages, (width, height))
