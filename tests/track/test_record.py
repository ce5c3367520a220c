import pytest

from pipeline.track.lock import digest, flatten, locked_stages, stage_names
from pipeline.track.record import build_record, numbers, stage_metrics

LOCK = {
    "schema": "2.0",
    "stages": {
        "merge@cube": {
            "cmd": "python -m pipeline.merge --object cube",
            "deps": [{"path": "pipeline/merge", "md5": "aa.dir"}],
            "params": {"params.yaml": {"seed": 1, "merge": {"grasps_per_pair": 4}}},
            "outs": [{"path": "data/merge/cube", "md5": "bb.dir"}],
        },
        "prepare@gone": {"cmd": "x"},
        "report": {"cmd": "x", "outs": [{"path": "reports/index.html", "md5": "cc"}]},
    },
}
NAMES = stage_names({"pinch": ["cube"], "side": ["can", "mug"]}, ["cube", "can"], ["mug"], ["synthesized"])


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
    assert NAMES[:4] == ["prepare@cube", "prepare@can", "prepare-mesh@mug", "synthesize-pinch@cube"]


def test_harder_settings_are_stages_too():
    assert stage_names({"pinch": ["cube"]}, [], [], [], harder=["icy"])[-2:] == ["evaluate-harder@icy", "report"]


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
    def key(summary=None, parameters=None, lock=LOCK):
        return build_record(summary or {"a": 1}, parameters or {"seed": 1}, stages(lock), {}).key

    page = {**LOCK, "stages": {**LOCK["stages"], "report": {"outs": [{"path": "reports/index.html", "md5": "dd"}]}}}
    assert key() == key(lock=changed("deps", [])) == key(lock=page)
    assert len({key(), key({"a": 2}), key(None, {"seed": 2}), key(lock=changed("outs", []))}) == 4


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


def test_only_numbers_are_metrics():
    assert numbers({"scale": "demo", "a": 1, "b": 0.5}) == {"a": 1.0, "b": 0.5}


def test_digest_ignores_order():
    assert digest({"a": 1, "b": [1, 2]}) == digest({"b": [1, 2], "a": 1}) != digest({"a": 1, "b": [2, 1]})
