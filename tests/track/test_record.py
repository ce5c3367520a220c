import csv

import pytest

from pipeline.track.lock import digest, flatten, locked_stages, stage_names
from pipeline.track.rates import csv_text, success_rows, survival_rows
from pipeline.track.record import (
    MOST_MEMBERS,
    MOST_POINTS,
    build_record,
    condensed,
    numbers,
    stage_metrics,
    thinned,
)

LOCK = {
    "schema": "2.0",
    "stages": {
        "merge@cube": {
            "cmd": "python -m pipeline.merge --object cube",
            "deps": [{"path": "pipeline/merge", "md5": "aa.dir"}, {"path": "data/validate/side", "md5": "dd"}],
            "params": {"params.yaml": {"seed": 1, "merge": {"grasps_per_pair": 4}}},
            "outs": [{"path": "data/merge/cube", "md5": "bb.dir"}],
        },
        "prepare@gone": {"cmd": "x"},
        "report": {"cmd": "x", "outs": [{"path": "reports/index.html", "md5": "cc"}]},
    },
}
DECLARED = {
    "stages": {
        "prepare": {"foreach": "${objects}", "do": {}},
        "prepare-mesh": {"foreach": "${meshes}", "do": {}},
        "merge": {"foreach": "${styles.pinch}", "do": {}},
        "train": {"cmd": "x"},
        "report": {"cmd": "x"},
        "track": {"cmd": "x"},
    }
}
PARAMETERS = {"styles": {"pinch": ["cube"]}, "objects": {"cube": {}, "can": {}}, "meshes": {}}
NAMES = stage_names(DECLARED, PARAMETERS)


def stages(lock=LOCK):
    return locked_stages(lock, NAMES)


def changed(key: str, value):
    return {**LOCK, "stages": {**LOCK["stages"], "merge@cube": {**LOCK["stages"]["merge@cube"], key: value}}}


def test_flat_parameters():
    nested = {"a": {"b": 1, "c": [1, 2], "d": None}, "e": {"thumb+index": 2}, "f": True}
    assert flatten(nested) == {"a.b": 1, "a.c": "[1, 2]", "e.thumb-index": 2, "f": True}


def test_only_live_stages_are_taken_from_the_lock():
    assert [stage.name for stage in stages()] == ["merge@cube", "report"]
    assert stages()[0].parameters == {"seed": 1, "merge.grasps_per_pair": 4}
    assert NAMES == ["prepare@cube", "prepare@can", "merge@cube", "train", "report"]
    assert stages()[0].inputs == {"data/validate/side": "dd"} and stages()[0].outputs == {"data/merge/cube": "bb.dir"}


def test_the_names_of_stages_are_those_that_dvc_makes(repository):
    import yaml
    from dvc.repo import Repo

    declared, parameters = (yaml.safe_load((repository / name).read_text()) for name in ("dvc.yaml", "params.yaml"))
    made = {stage.addressing for stage in Repo(str(repository)).index.stages}
    assert {*stage_names(declared, parameters), "track"} == made - {"code"}


def test_the_items_of_a_stage_may_stand_in_its_declaration():
    declared = {
        "code": {"cmd": "x"},
        "validate": {"foreach": ["pinch", "side"], "do": {}},
        "merge": {"cmd": "x"},
        "sample": {"foreach": ["learned", "reconstructed"], "do": {}},
        "track": {"cmd": "x"},
    }
    wanted = ["validate@pinch", "validate@side", "merge", "sample@learned", "sample@reconstructed"]
    assert stage_names({"stages": declared}, {}) == wanted


@pytest.mark.parametrize("entry", [{"foreach": "${nothing}"}, {"foreach": "some ${objects}"}, {"matrix": {"a": [1]}}])
def test_stages_whose_items_cannot_be_told_are_refused(entry):
    with pytest.raises(ValueError, match="nothing|objects|matrix"):
        stage_names({"stages": {"x": entry}}, PARAMETERS)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("deps", [{"path": "pipeline/merge", "md5": "other"}]),
        ("params", {"params.yaml": {"seed": 2}}),
        ("outs", [{"path": "data/merge/cube", "md5": "other"}]),
    ],
)
def test_a_stage_with_other_inputs_or_outputs_is_another(key, value):
    assert stages(changed(key, value))[0].fingerprint != stages()[0].fingerprint


def test_the_key_follows_the_result_and_not_the_code():
    def key(summary=None, lock=LOCK):
        return build_record(summary or {"a": 1}, {}, stages(lock), {}).key

    page = {**LOCK, "stages": {**LOCK["stages"], "report": {"outs": [{"path": "reports/index.html", "md5": "dd"}]}}}
    assert key() == key(lock=changed("deps", [])) == key(lock=page)
    other_seed = changed("params", {"params.yaml": {"seed": 2}})
    assert len({key(), key({"a": 2}), key(lock=other_seed), key(lock=changed("outs", []))}) == 4


WITH_ITEMS = {
    "cmd": "python -m pipeline.merge",
    "deps": [{"path": "data/validate/side", "md5": "dd.dir"}],
    "params": {"code.yaml": {"merge": "0123456789abcdef"}, "params.yaml": {"merge": {"grasps_per_pair": 4}}},
    "outs": [{"path": "data/items/merge.json", "md5": "ee"}, {"path": "data/merge", "md5": "bb.dir"}],
}


def of_code(code: str, index: str, data: str = "bb.dir"):
    """The stage as it is after a run with this code, which wrote this index of items and this data."""
    outs = [{"path": "data/items/merge.json", "md5": index}, {"path": "data/merge", "md5": data}]
    params = {**WITH_ITEMS["params"], "code.yaml": {"merge": code}}
    return locked_stages({"stages": {"merge": {**WITH_ITEMS, "params": params, "outs": outs}}}, ["merge"])


def test_code_and_the_index_of_items_are_no_part_of_a_result():
    (stage,) = locked_stages({"stages": {"merge": WITH_ITEMS}}, ["merge"])
    assert stage.parameters == {"merge.grasps_per_pair": 4} and stage.outputs == {"data/merge": "bb.dir"}
    same, other = of_code("f" * 16, "ff"), of_code("f" * 16, "ff", data="cc.dir")
    assert stage.fingerprint == same[0].fingerprint != other[0].fingerprint
    keys = [build_record({"a": 1}, {}, stages, {}).key for stages in ([stage], same, other)]
    assert keys[0] == keys[1] != keys[2]


def objects(count: int, density: float = 500.0) -> dict:
    return {f"objects.o{index}.{name}": density for index in range(count) for name in ("density", "scale")}


def test_parameters_of_many_objects_are_a_count_and_a_digest():
    few = {**objects(MOST_MEMBERS), "seed": 1}
    assert condensed(few) == few
    many = condensed({**objects(MOST_MEMBERS + 1), "seed": 1})
    assert set(many) == {"objects.count", "objects.digest", "seed"} and many["objects.count"] == MOST_MEMBERS + 1
    assert many == condensed({"seed": 1, **objects(MOST_MEMBERS + 1)})
    assert many["objects.digest"] != condensed(objects(MOST_MEMBERS + 1, density=600.0))["objects.digest"]


def test_long_texts_are_a_digest_that_tells_them_apart():
    one, other = (condensed({"styles.pinch": f"{'x' * 7000}{end}"})["styles.pinch"] for end in "ab")
    assert one != other and len(one) < 100


def test_a_record_of_a_thousand_objects_is_no_longer_than_one_of_a_hundred():
    lengths = []
    for count in (100, 1000):
        lock = {
            "stages": {"prepare": {"params": {"params.yaml": {"objects": {f"o{i}": {"d": 1} for i in range(count)}}}}}
        }
        record = build_record({}, objects(count), locked_stages(lock, ["prepare"]), {})
        lengths.append(len(record.parameters) + len(record.stages[0].parameters))
    assert lengths == [4, 4]


@pytest.mark.parametrize("count", [0, 1, MOST_POINTS, MOST_POINTS + 1, 1234])
def test_a_long_curve_is_thinned_evenly_and_keeps_its_end(count):
    curve = [{"step": float(index), "loss": 0.5} for index in range(count)]
    steps = [point["step"] for point in thinned(curve)]
    assert len(steps) == min(count, MOST_POINTS) == len(set(steps))
    assert not steps or steps[-1] == count - 1
    gaps = {later - sooner for sooner, later in zip(steps, steps[1:], strict=False)}
    assert not gaps or max(gaps) - min(gaps) <= 1


def test_data_versions_are_of_all_outputs_but_the_report():
    assert build_record({}, {}, stages(), {}).data_versions() == {"data/merge/cube": "bb.dir"}


def test_rates_are_tables_of_objects_and_pairs():
    summary = {
        "validate.pinch.cube.survival_rate": 0.5,
        "validate.pinch.cube.survival_rate_of_passed": 0.9,
        "validate.survival_rate_mean": 0.5,
        "evaluate.learned.cube--soup_can.success_rate": 1,
        "evaluate.learned.cube--soup_can.success_rate_10cm": 0.5,
        "evaluate.conditions.icy.sapien.learned.cube--soup_can.success_rate": 0.25,
        "evaluate.conditions.icy.sapien.learned.success_rate_mean": 0.25,
        "scale": "demo",
    }
    assert survival_rows(summary) == [("cube, pinch", 0.5)]
    many = {"evaluate.learned.success_rate_median": 0.9, "validate.side.survival_rate_quartile_1": 0.2}
    assert success_rows(many) == [("median: learned", 0.9)]
    assert survival_rows(many) == [("quartile_1, side", 0.2)]
    assert success_rows(summary) == [("cube, soup_can: icy, sapien, learned", 0.25), ("cube, soup_can: learned", 1.0)]
    lines = csv.reader(csv_text("object", survival_rows(summary)).splitlines())
    assert list(lines) == [["object", "rate"], ["cube, pinch", "0.5"]]


def test_metrics_go_to_the_stage_that_they_are_of():
    metrics = {
        "validate.pinch.cube.survival_rate": 0.5,
        "validate.pinch.cube.rejected.gravity.minus_x": 0.1,
        "validate.survival_rate_mean": 0.4,
        "merge.grasps": 8,
        "merge.cube--can.accepted": 4,
        "merge.plum--can.accepted": 3,
        "evaluate.synthesized.cube--can.success_rate": 1.0,
        "evaluate.synthesized.plum--can.success_rate": 0.0,
        "train.validation_loss": 0.5,
        "sample.cube--can.tried": 9,
        "evaluate.harder.placement.lost": 0.25,
        "evaluate.harder.placement.cube--can.success_rate": 0.75,
    }
    assert stage_metrics("validate-pinch@cube", metrics) == {"survival_rate": 0.5, "rejected.gravity.minus_x": 0.1}
    assert stage_metrics("merge@cube", metrics) == {"cube--can.accepted": 4}
    assert stage_metrics("evaluate-synthesized@cube", metrics) == {"cube--can.success_rate": 1.0}
    assert stage_metrics("prepare@cube", metrics) == {}
    assert stage_metrics("train", metrics) == {"validation_loss": 0.5}
    assert stage_metrics("evaluate-harder@placement", metrics) == {"lost": 0.25, "cube--can.success_rate": 0.75}
    assert stage_metrics("sample@cube", metrics) == {"cube--can.tried": 9}


def test_metrics_of_all_items_go_to_the_stage_that_makes_them_all():
    metrics = {
        "validate.pinch.cube.survival_rate": 0.5,
        "validate.side.can.survival_rate": 0.4,
        "merge.grasps": 8,
        "merge.cube--can.accepted": 4,
        "sample.cube--can.tried": 9,
        "evaluate.learned.trials": 25,
        "evaluate.conditions.icy.sapien.learned.lost": 0.5,
        "evaluate.harder.placement.lost": 0.25,
        "reconstruct.demo.alignment_mm": 0.1,
    }
    assert stage_metrics("validate@pinch", metrics) == {"cube.survival_rate": 0.5}
    assert stage_metrics("merge", metrics) == {"grasps": 8, "cube--can.accepted": 4}
    assert stage_metrics("sample@learned", metrics) == {"cube--can.tried": 9}
    assert stage_metrics("sample@reconstructed", metrics) == {} == stage_metrics("evaluate@synthesized", metrics)
    assert stage_metrics("evaluate@learned", metrics) == {"trials": 25}
    assert stage_metrics("evaluate-conditions", metrics) == {"icy.sapien.learned.lost": 0.5}
    assert stage_metrics("evaluate-harder", metrics) == {"placement.lost": 0.25}  # of an earlier result
    assert stage_metrics("reconstruct", metrics) == {"demo.alignment_mm": 0.1}


def test_only_numbers_are_metrics():
    assert numbers({"scale": "demo", "a": 1, "b": 0.5}) == {"a": 1.0, "b": 0.5}


def test_digest_ignores_order():
    assert digest({"a": 1, "b": [1, 2]}) == digest({"b": [1, 2], "a": 1}) != digest({"a": 1, "b": [2, 1]})
