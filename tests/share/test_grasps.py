"""`load_grasps` from a working folder: which rows, which columns, and what is said when something is missing."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from pipeline.records.catalogue import catalogue_text
from pipeline.records.errors import UserError
from pipeline.records.flat import PAIR_GRASPS, read_flat
from pipeline.share import GRASP_COLUMNS, load_grasps
from tests.pairs import write_pairs
from tests.share.made_up import PARAMETERS, merged, write_tables


@pytest.fixture
def folder(tmp_path):
    """A working folder with two pairs."""
    write_tables(tmp_path)
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(PARAMETERS))
    return tmp_path


def test_accepted_grasps_of_all_pairs_with_the_documented_columns(folder):
    grasps = load_grasps(folder)
    assert list(grasps.columns) == list(GRASP_COLUMNS)
    assert all(GRASP_COLUMNS.values())
    assert grasps.groupby(["object0", "object1"]).size().to_dict() == {("cube", "can"): 4, ("plum", "can"): 4}
    assert set(grasps["source"]) == {"synthesized"} and set(grasps["rejected_by"]) == {""}
    assert list(grasps.index) == list(range(8))
    assert np.stack(grasps["q"]).shape == (8, 16)


def test_values_are_those_of_the_tables(folder):
    rows = read_flat(folder / "data/merge/plum.parquet", PAIR_GRASPS, "merge")
    loaded = load_grasps(folder, first="plum", only_accepted=False)
    pd.testing.assert_frame_equal(loaded.drop(columns="source"), rows)


def test_filters(folder):
    assert set(load_grasps(folder, first="cube")["object0"]) == {"cube"}
    assert len(load_grasps(folder, first=["plum", "cube"], second="can")) == 8
    assert len(load_grasps(folder, only_accepted=False)) == 10
    both = load_grasps(folder, source=["synthesized", "learned"])
    assert both["source"].value_counts().to_dict() == {"synthesized": 8, "learned": 8}


def test_pairs_are_those_of_the_parameter_each_with_its_own_rows(folder):
    generator = np.random.default_rng(1)
    tables = {second: merged("cube", second, generator) for second in ("jar", "can", "tin")}
    tables["jar"]["sweep_penetrations"] = [0, None, 1, 2, 3]
    tables["can"]["sweep_penetrations"] = [4, 5, 6, 7, 8]
    write_pairs(folder / "data/merge/cube.parquet", pd.concat(tables.values()), PAIR_GRASPS)
    names = {"pinch": ["cube"], "side": ["jar", "can", "tin"]}
    chosen = PARAMETERS | {"styles": names, "pairs": [["cube", "can"], ["cube", "jar"]]}
    (folder / "params.yaml").write_text(yaml.safe_dump(chosen))
    grasps = load_grasps(folder, only_accepted=False)
    assert list(grasps["object1"]) == ["jar"] * 5 + ["can"] * 5  # in the order of the styles
    np.testing.assert_array_equal(np.stack(grasps["q"][5:]), np.stack(tables["can"]["q"]))
    alone = load_grasps(folder, second="can", only_accepted=False)
    write_pairs(folder / "data/merge/cube.parquet", tables["can"], PAIR_GRASPS)  # as if there were no other pair
    pd.testing.assert_frame_equal(load_grasps(folder, second="can", only_accepted=False), alone)


def test_objects_of_packages_are_those_of_the_catalogue(folder):
    rows = [{"name": "can", "source": "can", "styles": "side"}, {"name": "old", "source": "gone", "styles": "side"}]
    chosen = PARAMETERS | {"styles": {"pinch": ["cube"], "side": []}, "pairs": "all", "assets": {"can": {}}}
    (folder / "params.yaml").write_text(yaml.safe_dump(chosen))
    with pytest.raises(UserError, match=r"dvc pull prepare"):
        load_grasps(folder)
    (folder / "data/prepare").mkdir(parents=True)
    (folder / "data/prepare/catalogue.csv").write_text(catalogue_text(rows))
    assert set(load_grasps(folder)["object1"]) == {"can"}


def test_tables_of_objects_that_are_no_longer_named_are_left_out(folder):
    shutil.copy(folder / "data/merge/cube.parquet", folder / "data/merge/stranger.parquet")
    assert len(load_grasps(folder)) == 8


def sentence(error: pytest.ExceptionInfo) -> str:
    text = str(error.value)
    assert "\n" not in text and text.endswith(".")
    return text


def test_a_missing_table_says_how_to_get_it(folder):
    (folder / "data/merge/plum.parquet").unlink()
    with pytest.raises(UserError) as error:
        load_grasps(folder)
    assert re.search(r"data/merge/plum\.parquet is missing; run `dvc pull merge` there", sentence(error))
    assert len(load_grasps(folder, first="cube")) == 4


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"first": "can"}, r"has no first 'can'; choose among cube, plum\.$"),
        ({"second": ["can", "mug"]}, r"has no second 'mug'; choose among can\.$"),
        ({"source": "guessed"}, r"has no source 'guessed'; choose among synthesized, learned\.$"),
    ],
)
def test_unknown_names_are_listed_with_the_known_ones(folder, asked, said):
    with pytest.raises(UserError) as error:
        load_grasps(folder, **asked)
    assert re.search(said, sentence(error))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("styles: [", "does not list objects"),
        ("{}", "does not list objects"),
        ("styles: {pinch: 3, side: []}", "does not list objects"),
        ("styles: {pinch: [../../secret], side: [can]}", "names an object '../../secret'"),
        ("{styles: {pinch: [], side: []}, pairs: all, seed: 1}", "names no such pair of objects"),
        ("{styles: {pinch: [cube], side: [can]}, pairs: [], seed: 1}", "names no such pair of objects"),
        ("{styles: {pinch: [cube], side: [can]}, seed: 1}", "has no `pairs`: another version"),
        ("{styles: {pinch: [cube], side: [can]}, pairs: all}", "says neither by `pairs` nor by `seed`"),
        ("{styles: {pinch: [cube], side: [can]}, pairs: -1, seed: 1}", "says neither by `pairs` nor by `seed`"),
        (
            "{styles: {pinch: [cube], side: [can]}, pairs: [[cube, 3]], seed: 1}",
            "says neither by `pairs` nor by `seed`",
        ),
        ("!!python/object/apply:os.system ['touch ran']", "does not list objects"),
    ],
)
def test_parameters_of_strangers_are_checked(folder, content, said, monkeypatch):
    monkeypatch.chdir(folder)
    (folder / "params.yaml").write_text(content)
    with pytest.raises(UserError) as error:
        load_grasps(folder)
    assert said in sentence(error)
    assert not (folder / "ran").exists()


def test_a_folder_that_is_no_clone(tmp_path):
    with pytest.raises(UserError) as error:
        load_grasps(tmp_path)
    assert "params.yaml is missing; name the folder of a clone" in sentence(error)


def test_damaged_tables_and_those_of_other_versions_are_refused(folder):
    path = folder / "data/merge/cube.parquet"
    whole = path.read_bytes()
    for content in (b"", whole[: len(whole) // 2], b"\x80\x04junk"):
        path.write_bytes(content)
        with pytest.raises(UserError) as error:
            load_grasps(folder)
        assert "is damaged or no parquet file" in sentence(error)
    table = pq.read_table(pa.BufferReader(whole))
    pq.write_table(table.drop_columns(["squeeze_q"]), path)
    with pytest.raises(UserError) as error:
        load_grasps(folder)
    assert "has no column squeeze_q: another version" in sentence(error)
    place = table.column_names.index("q")
    pq.write_table(table.set_column(place, "q", pa.array(["a"] * len(table))), path)
    with pytest.raises(UserError) as error:
        load_grasps(folder)
    assert "other types" in sentence(error)


def test_columns_that_a_later_version_adds_do_no_harm(folder):
    path = folder / "data/merge/cube.parquet"
    table = pq.read_table(path)
    pq.write_table(table.append_column("mood", pa.array([1.0] * len(table))), path)
    assert list(load_grasps(folder).columns) == ["source", *PAIR_GRASPS.names]
