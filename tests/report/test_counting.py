"""What is read from files agrees with the tables themselves, and the table of pairs with the counts."""

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.flat import PAIR_GRASPS, PAIR_TRIALS, read_flat, read_flat_columns
from pipeline.records.parameters.objects import StylesParameters
from pipeline.records.tables import CANDIDATES, VALIDATED, write_table
from pipeline.records.writing import write_json
from pipeline.report.counting import Counts, count_all, pair_counts
from pipeline.report.learned import load_quality
from pipeline.report.pairs_table import PAIRS, pairs_table
from pipeline.report.rates import spread
from tests.pairs import write_pairs
from tests.report import made_up

PARTNERS = {"cube": ("can", "box"), "plum": ("can",)}
RECONSTRUCTED = {"cube": ("box",)}


def grasps(first: str, seconds: tuple[str, ...]) -> pd.DataFrame:
    tables = [made_up.merged(first, second, 2 + index) for index, second in enumerate(seconds)]
    rows = pd.concat(tables, ignore_index=True)
    rows["gravity_drift"] = [None if check else [0.001, 0.004, 0.002] for check in rows["rejected_by"]]
    return rows


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A run of three pairs, one of them reconstructed too."""
    monkeypatch.chdir(tmp_path)
    for style, names in (("pinch", PARTNERS), ("side", ("can", "box"))):
        for name in names:
            write_table(paths.candidates_file(style, name), made_up.candidates(style, name), CANDIDATES)
            write_table(paths.validated_file(style, name), made_up.validated(style, name), VALIDATED)
    for source, pairs in (("synthesized", PARTNERS), ("learned", PARTNERS), ("reconstructed", RECONSTRUCTED)):
        for first, seconds in pairs.items():
            file = paths.merged_file(first) if source == "synthesized" else paths.sampled_file(source, first)
            write_pairs(file, grasps(first, seconds), PAIR_GRASPS)
            write_pairs(paths.trials_file(source, first), made_up.trials(first, list(seconds), source), PAIR_TRIALS)
    write_json(
        paths.sample_quality_file("learned"), {first: made_up.quality(first, own) for first, own in PARTNERS.items()}
    )
    return tmp_path


@pytest.fixture
def counts(folder) -> Counts:
    styles = StylesParameters(pinch=list(PARTNERS), side=["can", "box"])
    return count_all(styles, PARTNERS, RECONSTRUCTED, workers=1)


def test_every_pair_of_every_source_is_counted_from_its_own_rows(counts):
    found = [(one.source, one.first, one.second) for one in counts.pairs]
    pairs = [("cube", "can"), ("cube", "box"), ("plum", "can")]
    assert found == [(source, *pair) for source in ("synthesized", "learned") for pair in pairs] + [
        ("reconstructed", "cube", "box")
    ]
    assert [merge.accepted for merge in counts.merges] == [2, 3, 2]
    assert {one.source: one.trials.trials for one in counts.pairs} == dict.fromkeys(counts.sources, 3)
    assert list(counts.trials) == ["synthesized", "learned", "reconstructed"] == list(counts.sources)
    assert [(funnel.style, funnel.object_name, funnel.validated) for funnel in counts.funnels] == [
        *[("pinch", "cube", 2), ("pinch", "plum", 2), ("side", "can", 2), ("side", "box", 2)]
    ]
    np.testing.assert_array_equal(counts.pairs[1].drifts, [0.004] * 3)
    assert counts.pairs[1].grasp_ids.shape == (3, 2)


def test_pairs_for_training_alone_are_counted_as_merged_and_neither_as_sampled_nor_as_tried(folder):
    paths.sampled_file("learned", "plum").unlink()
    for source in ("synthesized", "learned"):
        paths.trials_file(source, "plum").unlink()
    styles = StylesParameters(pinch=list(PARTNERS), side=["can", "box"])
    counts = count_all(styles, PARTNERS, RECONSTRUCTED, 1, only_trained={"plum"})
    assert [(one.source, one.first) for one in counts.pairs if one.first == "plum"] == [("synthesized", "plum")]
    assert [merge.accepted for merge in counts.merges] == [2, 3, 2]
    assert {source: {one.first for one in own} for source, own in counts.trials.items()} == {
        source: {"cube"} for source in counts.sources
    }


def test_a_drift_that_was_not_tested_is_no_number():
    rows = made_up.merged("cube", "can")
    counted = pair_counts("synthesized", "cube", "can", rows, made_up.trials("cube", ["can"]))
    assert len(counted.drifts) == 2 and np.isnan(counted.drifts).all()


def test_a_missing_table_names_its_stage(folder, counts):
    paths.sampled_file("reconstructed", "cube").unlink()
    with pytest.raises(UserError, match="dvc repro sample@reconstructed"):
        count_all(StylesParameters(pinch=[], side=[]), {}, RECONSTRUCTED, workers=1)


def test_some_columns_of_a_table_are_those_of_the_whole_in_the_order_asked_for(folder):
    file, columns = paths.trials_file("learned", "cube"), ["success", "object1", "trial"]
    some = read_flat_columns(file, PAIR_TRIALS, "x", columns)
    assert list(some) == columns
    assert some == {name: read_flat(file, PAIR_TRIALS, "x")[name].tolist() for name in columns}
    with pytest.raises(UserError, match="other columns"):
        read_flat_columns(file, PAIR_GRASPS, "x", ["object1"])


def test_the_table_of_pairs_has_every_pair_and_source(counts, folder):
    quality = {"learned": load_quality("learned", PARTNERS)}
    write_table(paths.PAIRS_TABLE, pairs_table(counts.pairs, quality), PAIRS)
    rows = pd.read_parquet(paths.PAIRS_TABLE).set_index(["source", "first", "second"])
    assert len(rows) == 7 and rows.index.is_unique
    made = rows.loc["synthesized", "cube", "box"]
    assert (made["tried"], made["accepted"], dict(made["rejected"])) == (4, 3, {"hand_clearance": 1})
    assert (made["pinch_grasps"], made["side_grasps"], made["most_uses"]) == (1, 1, 3)
    assert made["drift_mm_median"] == pytest.approx(4.0) and np.isnan(made["overlap_mm_median"])
    assert (made["trials"], made["successes"], made["successes_10cm"], made["planning_failures"]) == (3, 1, 2, 1)
    assert dict(made["failed"]) == {"dropped in hold": 1, "plan second": 1}
    assert made["success_low"] < made["success_rate"] < made["success_high"]
    drawn = rows.loc["learned", "cube", "box"]
    assert (drawn["trained"], drawn["overlap_mm_median"], drawn["overlap_mm_median_raw"]) == (False, 0.5, 1.0)
    assert np.isnan(drawn["pinch_grasps"])


def test_every_column_of_the_table_of_pairs_says_what_it_holds(counts, folder):
    write_table(paths.PAIRS_TABLE, pairs_table(counts.pairs, {}), PAIRS)
    schema = pq.read_schema(paths.PAIRS_TABLE)
    assert [field.name for field in schema if not (field.metadata or {}).get(b"description")] == []


def test_figures_that_lack_a_pair_are_refused(folder):
    with pytest.raises(UserError, match="quality.json lacks a pair .*sample@learned"):
        load_quality("learned", {"cube": ("can", "bottle")})


def test_a_spread_is_that_of_numpy():
    values = np.random.default_rng(1).normal(size=37)
    own = spread(values.tolist())
    found = (own.least, own.quartile_1, own.median, own.quartile_3, own.most)
    assert found == pytest.approx(np.quantile(values, [0, 0.25, 0.5, 0.75, 1]))
    assert own.mean == pytest.approx(values.mean()) and spread([]).most == 0
