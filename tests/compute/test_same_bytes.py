"""Validation and merge write the same bytes wherever their items run."""

from pathlib import Path

import pytest

from pipeline.compute.fan_out import Workers
from pipeline.hand.support import PLANE
from pipeline.records.parameters.compute import ComputeParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.tables import MERGED, VALIDATED, write_table
from pipeline.validate.table import validate_table
from tests.merge.test_merge_pairs import merged
from tests.validate.test_validation import SETTINGS, block_grasp, rows

pytest.importorskip("distributed", reason="needs the extra `cluster`")


def validated(target: Path, workers: Workers) -> None:
    prepared, candidate = block_grasp()
    candidates = rows(prepared, candidate, ["", "duplicate", "", ""])
    for index, shift in ((2, 0.002), (3, 0.02)):  # one that holds otherwise, and one that does not
        candidates.at[index, "position_object_hand"] = candidates.at[index, "position_object_hand"] + shift
    limits = ValidateParameters()
    table = validate_table(candidates, prepared, SETTINGS, limits, workers, "validated", PLANE, candidate.hand)
    assert len(set(table["rejected_by"])) > 2
    write_table(target, table, VALIDATED)


def merged_pair(target: Path, workers: Workers) -> None:
    write_table(target, merged(workers, physics_test=True), MERGED)


@pytest.mark.slow
@pytest.mark.parametrize("work", [validated, merged_pair], ids=["validate", "merge"])
def test_the_same_bytes_for_any_backend_and_number_of_workers(work, tmp_path):
    ways = {"one": 1, "two": 2, "dask": ComputeParameters(backend="dask", workers=2)}
    found = {}
    for name, workers in ways.items():
        work(tmp_path / f"{name}.parquet", workers)
        found[name] = (tmp_path / f"{name}.parquet").read_bytes()
    assert found["two"] == found["one"] and found["dask"] == found["one"]
