"""The columns of pairs are the parts of the lists of any number of objects."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from pipeline.records.errors import UserError
from pipeline.records.flat import PAIR_GRASPS, PAIR_TRIALS, flat, read_flat, read_flat_columns, stored
from pipeline.records.tables import CANDIDATES, MERGED, TRIALS, arrow_table, write_table


def rows(*objects: tuple[str, ...]) -> pd.DataFrame:
    """Rows in which every number tells row and object; the last row was rejected before any approach was sought."""
    found = []
    for index, names in enumerate(objects):
        count = len(names)
        reached = count if index < len(objects) - 1 else 0
        each = [100.0 * index + number for number in range(count)]
        found.append(
            dict.fromkeys(MERGED.names)
            | {
                "merged_id": index,
                "objects": list(names),
                "grasp_ids": [int(value) for value in each],
                "fingers": ["thumb+index", "ring+palm", "middle+palm"][:count],
                "q": [0.0] * 16,
                "squeeze_q": [1.0] * 16,
                "positions_hand_object": [[value, 0.0, 0.0] for value in each],
                "quaternions_hand_object": [[1.0, 0.0, 0.0, value] for value in each],
                "open_q": [[value] * 16 for value in each[:reached]],
                "approach_directions": [[0.0, 0.0, value] for value in each[: max(reached, 1)]],
                "approach_lengths": [None, *each[1:]][:reached],
                "sweep_penetrations": [None, *(int(value) for value in each[1:])][:reached],
                "rejected_by": "" if reached else "fingers",
            }
        )
    return pd.DataFrame(found, dtype=object)


def test_columns_of_a_pair_are_the_parts_of_the_lists(tmp_path) -> None:
    target = tmp_path / "a.parquet"
    write_table(target, rows(("cube", "can"), ("cube", "jar")), MERGED)
    found = read_flat(target, PAIR_GRASPS, "merge")
    assert list(found.columns) == PAIR_GRASPS.names
    assert found["object0"].tolist() == ["cube", "cube"] and found["object1"].tolist() == ["can", "jar"]
    assert found["grasp1_id"].tolist() == [1, 101] and found["fingers1"].tolist() == ["ring+palm"] * 2
    assert found["position_hand_object1"][1].tolist() == [101.0, 0.0, 0.0]
    assert found["open_q1"][0].tolist() == [1.0] * 16 and found["open_q1"][1] is None  # not reached
    assert found["approach_length1"][0] == 1.0 and np.isnan(found["sweep_penetrations"][1])
    assert found["approach_direction0"][1].tolist() == [0.0, 0.0, 100.0] and found["approach_direction1"][1] is None
    some = read_flat_columns(target, PAIR_GRASPS, "merge", ["object1", "grasp0_id"])
    assert some == {"object1": ["can", "jar"], "grasp0_id": [0, 100]}


def test_every_column_comes_from_one_of_the_files() -> None:
    for schema, files in ((PAIR_GRASPS, MERGED), (PAIR_TRIALS, TRIALS)):
        assert stored(schema) is files
        sources = [(field.metadata or {}).get(b"list", field.name.encode()).decode() for field in schema]
        assert set(sources) == set(files.names)
    assert stored(CANDIDATES) is CANDIDATES


def test_a_part_of_a_table_is_flat_like_the_whole() -> None:
    whole = arrow_table(rows(*[("cube", name) for name in "abcd"]), MERGED)
    assert flat(whole.slice(1, 2), PAIR_GRASPS).equals(flat(whole, PAIR_GRASPS).slice(1, 2))
    parts = pa.concat_tables([whole.slice(0, 1), whole.slice(1)])
    assert flat(parts, PAIR_GRASPS).equals(flat(whole, PAIR_GRASPS))
    assert len(flat(whole.slice(0, 0), PAIR_GRASPS)) == 0


def test_a_table_of_three_objects_is_no_table_of_pairs(tmp_path) -> None:
    target = tmp_path / "a.parquet"
    write_table(target, rows(("cube", "puck", "tin"), ("cube", "puck", "tin")), MERGED)
    with pytest.raises(UserError, match="a.parquet: its rows are not about two objects each"):
        read_flat_columns(target, PAIR_GRASPS, "merge", ["rejected_by"])
