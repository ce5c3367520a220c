import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from pipeline.records import tables
from pipeline.records.errors import UserError
from pipeline.records.tables import CANDIDATES, MERGED, TRIALS, VALIDATED, read_table, write_table

SCHEMAS = {"candidates": CANDIDATES, "validated": VALIDATED, "merged": MERGED, "trials": TRIALS}


def random_value(rng: np.random.Generator, kind: pa.DataType):
    if pa.types.is_fixed_size_list(kind):
        return np.array([random_value(rng, kind.value_type) for _ in range(kind.list_size)])
    if pa.types.is_list(kind):
        return [random_value(rng, kind.value_type) for _ in range(rng.integers(0, 4))]
    if pa.types.is_boolean(kind):
        return bool(rng.integers(2))
    if pa.types.is_integer(kind):
        return int(rng.integers(0, 1000))
    if pa.types.is_floating(kind):
        return float(rng.normal())
    return f"text{rng.integers(10)}"


def plain(value):
    """The value with lists in the place of arrays, at every depth."""
    if isinstance(value, list | np.ndarray):
        return [plain(part) for part in value]
    return value.item() if isinstance(value, np.generic) else value


def random_rows(schema: pa.Schema, count: int) -> pd.DataFrame:
    rng = np.random.default_rng(8)
    return pd.DataFrame([{f.name: random_value(rng, f.type) for f in schema} for _ in range(count)])


@pytest.mark.parametrize("name", SCHEMAS)
def test_the_same_rows_give_the_same_bytes_and_come_back(tmp_path, name):
    schema, rows = SCHEMAS[name], random_rows(SCHEMAS[name], 5)
    for copy in ("a", "b"):
        write_table(tmp_path / f"{copy}.parquet", rows, schema)
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    back = read_table(tmp_path / "a.parquet", schema, "validate-pinch@cube")
    write_table(tmp_path / "c.parquet", back, schema)
    assert (tmp_path / "c.parquet").read_bytes() == (tmp_path / "a.parquet").read_bytes()
    for column in rows.columns:
        for written, read in zip(rows[column], back[column], strict=True):
            assert plain(written) == plain(read)


@pytest.mark.parametrize("name", SCHEMAS)
def test_a_table_without_rows_keeps_its_columns(tmp_path, name):
    write_table(tmp_path / "a.parquet", random_rows(SCHEMAS[name], 1).iloc[:0], SCHEMAS[name])
    back = read_table(tmp_path / "a.parquet", SCHEMAS[name], "merge")
    assert len(back) == 0
    assert list(back.columns) == SCHEMAS[name].names


def test_checks_that_were_not_reached_are_null(tmp_path):
    rows = random_rows(VALIDATED, 2)
    rows["table_drift"] = [None, 0.5]
    rows["gravity_drift"] = [None, [0.1]]
    write_table(tmp_path / "a.parquet", rows, VALIDATED)
    back = read_table(tmp_path / "a.parquet", VALIDATED, "validate-pinch@cube")
    assert np.isnan(back["table_drift"][0]) and back["table_drift"][1] == 0.5
    assert back["gravity_drift"][0] is None


def test_columns_beyond_the_schema_are_not_written_and_missing_ones_are_a_defect(tmp_path):
    rows = random_rows(MERGED, 2).assign(seconds=1.0)
    write_table(tmp_path / "a.parquet", rows, MERGED)
    assert list(read_table(tmp_path / "a.parquet", MERGED, "merge").columns) == MERGED.names
    with pytest.raises(ValueError, match="rejected_by"):
        write_table(tmp_path / "b.parquet", rows.drop(columns="rejected_by"), MERGED)
    assert not (tmp_path / "b.parquet").exists()


@pytest.mark.parametrize("keep", [0, 3, 100, -1])
def test_a_truncated_table_is_one_sentence(tmp_path, keep):
    target = tmp_path / "cube.parquet"
    write_table(target, random_rows(CANDIDATES, 3), CANDIDATES)
    target.write_bytes(target.read_bytes()[:keep])
    with pytest.raises(UserError, match="damaged.*dvc repro synthesize-pinch@cube") as caught:
        read_table(target, CANDIDATES, "synthesize-pinch@cube")
    assert str(target) in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_table_says_what_makes_it(tmp_path):
    with pytest.raises(UserError, match="cube.parquet is missing; run `dvc repro synthesize-pinch@cube`"):
        read_table(tmp_path / "cube.parquet", CANDIDATES, "synthesize-pinch@cube")


def test_another_version_s_table_is_refused(tmp_path):
    write_table(tmp_path / "a.parquet", random_rows(CANDIDATES, 1), CANDIDATES)
    with pytest.raises(UserError, match="other columns"):
        read_table(tmp_path / "a.parquet", VALIDATED, "validate-pinch@cube")


def test_validated_rows_begin_like_candidates():
    assert VALIDATED.names[: len(CANDIDATES.names)] == CANDIDATES.names
    assert all(name in tables.__dict__ for name in ("CANDIDATES", "VALIDATED", "MERGED", "TRIALS"))
