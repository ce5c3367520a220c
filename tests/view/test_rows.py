"""Filters, counts, colours and names, against small tables counted by hand."""

import pandas as pd
import pytest

from pipeline.records.errors import UserError
from pipeline.view import rows
from pipeline.view.tables import MERGED_VIEW, TRIALS_VIEW


def index(*lines: tuple) -> pd.DataFrame:
    """Lines of (name, source, first, second, reason)."""
    return pd.DataFrame(
        [
            [name, name.rpartition("/")[0], 0, int(name.rpartition("/")[2]), source, "", first, second, reason]
            + [rows.PASSED if reason == rows.PASSED else rows.REJECTED]
            for name, source, first, second, reason in lines
        ],
        columns=list(rows.INDEX),
    )


MERGED = index(
    ("merge/cube/can/0", "synthesized", "cube", "can", "passed"),
    ("merge/cube/can/1", "synthesized", "cube", "can", "gravity"),
    ("merge/cube/tin/0", "synthesized", "cube", "tin", "gravity"),
    ("merge/plum/can/10", "synthesized", "plum", "can", "passed"),
    ("sample/learned/plum/can/1", "learned", "plum", "can", "hand_clearance"),
)


def test_filters_leave_what_passes_all() -> None:
    assert list(rows.selected(MERGED, {})["name"]) == list(MERGED["name"])
    kept = rows.selected(MERGED, {"second": "can", "outcome": "rejected", "source": rows.ANY})
    assert list(kept["name"]) == ["merge/cube/can/1", "sample/learned/plum/can/1"]
    assert rows.selected(MERGED, {"first": "cube", "source": "learned"}).empty


def test_choices_count_what_each_would_leave_beside_the_other_filters() -> None:
    filters = {"first": "cube", "reason": "gravity"}
    assert rows.choices(MERGED, filters, "reason") == {"gravity": 2, "passed": 1}  # of the three with a cube
    assert rows.choices(MERGED, filters, "second") == {"can": 1, "tin": 1}
    assert rows.choices(MERGED, filters, "first") == {"cube": 2}  # a plum never fails gravity


def test_a_chosen_value_stays_even_when_nothing_is_left() -> None:
    assert rows.choices(MERGED, {"source": "learned", "second": "tin"}, "second") == {"can": 1, "tin": 0}


def test_reasons_are_counted_after_what_passed() -> None:
    assert list(rows.counted(MERGED).items()) == [("passed", 2), ("gravity", 2), ("hand_clearance", 1)]


def test_colours_tell_reasons_apart_and_do_not_depend_on_order() -> None:
    reasons = ["passed", *(f"check{number}" for number in range(len(rows.FAILED)))]
    colours = rows.reason_colours(reasons)
    assert len(set(colours.values())) == len(reasons)
    assert rows.reason_colours(reasons[::-1]) == colours
    assert rows.reason_colours(["success"]) == {"success": rows.FOUND}


@pytest.mark.parametrize(
    ("place", "expected"), [(0, (0, 48)), (47, (0, 48)), (48, (48, 96)), (99, (96, 100)), (96, (96, 100))]
)
def test_pages_hold_the_row(place: int, expected: tuple[int, int]) -> None:
    assert rows.page_of(100, place, 48) == expected


@pytest.mark.parametrize(
    ("text", "name"),
    [
        (" merge/cube/can/3\n", "merge/cube/can/3"),
        ("data/merge/cube.parquet", "merge/cube"),
        ("data/sample/learned/cube.parquet", "sample/learned/cube"),
        ("synthesized/cube/can/3", "evaluate/synthesized/cube/can/3"),
        ("learned-low-sapien/cube/can/3", "evaluate/conditions/learned-low-sapien/cube/can/3"),
        ("data/prepare/cube/", "prepare/cube"),
        ("data/reconstruct/demo/objects/cube", "reconstruct/demo/cube"),
    ],
)
def test_names_are_taken_as_people_write_them(text: str, name: str) -> None:
    assert rows.tidy_name(text) == name


def test_a_name_leads_to_its_row_a_table_to_its_first() -> None:
    assert rows.find(MERGED, "merge/cube/can/1") == "merge/cube/can/1"
    assert rows.find(MERGED, "sample/learned/plum/can") == "sample/learned/plum/can/1"
    assert rows.view_of("sample/learned/plum/can") == MERGED_VIEW
    assert rows.view_of("evaluate/learned/plum/can/1") == TRIALS_VIEW


def test_a_row_that_is_not_there_is_named_with_those_near_it() -> None:
    with pytest.raises(UserError, match="merge/cube/can/7.* merge/cube/can/0 .* merge/cube/can/1"):
        rows.find(MERGED, "merge/cube/can/7")
    with pytest.raises(UserError, match="nothing/here.* prepare, "):
        rows.view_of("nothing/here")
