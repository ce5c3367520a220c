"""The printable tags, drawn by a reader of PDF's operators that knows nothing of how they were written."""

import re
from itertools import pairwise

import numpy as np
import pytest

from pipeline.capture.sheet import board_sheet, tag_sheet
from pipeline.records.errors import UserError
from pipeline.records.tag_layouts import TagLayout
from tools.captures import main

PER_POINT = 4  # pixels


def tags(size: float, family: str = "tag36h11") -> TagLayout:
    return TagLayout(family=family, size=size, convention="opencv", tags="anywhere")


def drawn_pages(pdf: bytes) -> list[np.ndarray]:
    """Fill the rectangles of every page's content."""
    text = pdf.decode("ascii")
    left, bottom, width, height = map(float, re.search(r"/MediaBox \[(.+?)\]", text)[1].split())
    assert (left, bottom) == (0, 0)
    pages = []
    for stream in re.findall(r"stream\n(.*?)\nendstream", text, flags=re.DOTALL):
        page = np.full((round(height * PER_POINT), round(width * PER_POINT)), 255, np.uint8)
        shade, waiting = 0, []
        for line in stream.split("\n"):
            words = line.split()
            if words[-1] == "g":
                shade = round(255 * float(words[0]))
            elif words[-1] == "re":
                waiting.append([float(word) * PER_POINT for word in words[:4]])
            elif words == ["f"]:
                for x, y, w, h in waiting:
                    rows = round(height * PER_POINT - y - h), round(height * PER_POINT - y)
                    page[rows[0] : max(rows[1], rows[0] + 1), round(x) : max(round(x + w), round(x) + 1)] = shade
                waiting = []
        pages.append(page)
    return pages


@pytest.mark.parametrize(("page", "size"), [("a4", 0.06), ("letter", 0.05)])
def test_printed_tags_are_found_in_true_size(page, size):
    import cv2

    pages = drawn_pages(tag_sheet(range(3, 13), tags(size), page))
    assert len(pages) >= 2
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    numbers = []
    for picture in pages:
        corners, found, _ = detector.detectMarkers(picture)
        numbers += found.ravel().tolist()
        for corner in corners:
            edges = np.linalg.norm(np.diff(corner[0], axis=0, append=corner[0][:1]), axis=1)
            assert edges / PER_POINT / 72 * 25.4 == pytest.approx(1000 * size, rel=0.01)
            assert corner[0][0][0] < corner[0][1][0] and corner[0][0][1] < corner[0][3][1], "upright as OpenCV draws it"
    assert sorted(numbers) == list(range(3, 13))


def test_the_ruler_is_a_hundred_millimetres():
    text = tag_sheet([0], tags(0.06), "a4").decode("ascii")
    marks = [float(line.split()[0]) for line in text.split("\n") if re.fullmatch(r"[\d. ]+ 0\.2835 [\d.]+ re", line)]
    assert len(marks) == 101 and (max(marks) - min(marks)) / 72 * 25.4 == pytest.approx(100)


@pytest.mark.parametrize("size", [0.01, 0.02, 0.06])
def test_labels_do_not_run_into_each_other(size):
    text = tag_sheet(range(40), tags(size), "a4").decode("ascii")
    labels = re.findall(r"/F1 ([\d.]+) Tf ([\d.]+) ([\d.]+) Td \((tag36h11 .*?)\) Tj", text)
    assert len(labels) == 40
    assert any(y == other_y for (_, _, y, _), (_, _, other_y, _) in pairwise(labels)), "some stand side by side"
    for (font, x, y, label), (_, next_x, next_y, _) in pairwise(labels):
        if y == next_y:  # letters of Helvetica are about half as wide as the font is high
            assert float(x) + 0.5 * float(font) * len(label) <= float(next_x)


def test_the_file_is_a_pdf_whose_table_is_right():
    pdf = tag_sheet(range(6), tags(0.06), "a4")
    assert pdf.startswith(b"%PDF-1.")
    start = int(re.search(rb"startxref\n(\d+)", pdf)[1])
    assert pdf[start:].startswith(b"xref")
    places = re.findall(rb"(\d{10}) 00000 n", pdf)
    for number, place in enumerate(places, start=1):
        assert pdf[int(place) :].startswith(b"%d 0 obj" % number)


@pytest.mark.parametrize("kind", ["grid", "charuco", "aprilgrid"])
def test_a_printed_board_lies_as_its_lines_for_tags_yaml_say(kind, tmp_path, capsys):
    import yaml

    from pipeline.reconstruct.detection import seen_tags

    target = tmp_path / "board.pdf"
    assert main(["print-tags", "--kind", kind, "--columns", "4", "--rows", "5", "--out", str(target)]) == 0
    text = capsys.readouterr().out.split("For tags.yaml:\n")[1]
    layout = TagLayout.model_validate(yaml.safe_load(text))
    (page,) = drawn_pages(target.read_bytes())
    seen = seen_tags(page, layout).tags
    places = layout.corners()
    assert set(seen) == set(places)
    per_metre = PER_POINT / (0.0254 / 72)
    flipped = [1, -1]  # a page's rows run down
    shift = np.mean([seen[n] - places[n][:, :2] * per_metre * flipped for n in seen], axis=(0, 1))
    for number, corners in seen.items():
        assert np.abs(corners - shift - places[number][:, :2] * per_metre * flipped).max() < 1.0


def test_a_board_too_large_for_the_page_is_refused():
    text = {"family": "aruco_4x4_50", "size": 0.04, "board": {"kind": "grid", "columns": 5, "rows": 7, "gap": 0.01}}
    with pytest.raises(UserError, match="240 x 340 mm large and does not fit on a4"):
        board_sheet(TagLayout.model_validate(text), "a4")


def test_wrong_wishes_are_one_sentence(tmp_path, capsys):
    with pytest.raises(UserError, match="no tag 587"):
        tag_sheet([587], tags(0.06), "a4")
    with pytest.raises(UserError, match="does not fit"):
        tag_sheet([0], tags(0.19), "a4")
    assert main(["print-tags", "--size-mm", "900", "--out", str(tmp_path / "x.pdf")]) == 2
    assert main(["print-tags", "--out", str(tmp_path / "tags.pdf")]) == 0
    assert (tmp_path / "tags.pdf").stat().st_size > 5000
    assert "print at 100 %" in capsys.readouterr().out
