import shutil
import sqlite3

import pytest

from pipeline.records.errors import UserError
from pipeline.track import runs as mlflow_runs
from pipeline.track import store
from pipeline.track.origin import origin_tags, record_root, run_name
from pipeline.track.record import Record, StageRecord
from pipeline.track.runs import COMPLETED, KNOWN, RECORDED, Origin, write_record

EXPERIMENT = "test"


def record(key: str = "k1", merge: str = "m1") -> Record:
    parameters = {f"group.parameter_{index}": index for index in range(250)}
    return Record(
        key=key,
        parameters=parameters,
        metrics={"merge.grasps": 8.0},
        stages=[
            StageRecord("prepare@cube", "p1", {"density": 500}, {}, {"wall_seconds": 2.0}),
            StageRecord(
                "merge@cube",
                merge,
                {"merge.grasps_per_pair": 4},
                {"grasps": 8.0},
                {"wall_seconds": 30.0, "cpu_seconds": 50.0},
                inputs={"data/validate/side": "aa" * 16},
                outputs={"data/merge/cube": "bb" * 16 + ".dir"},
            ),  # fmt: skip
        ],
    )


@pytest.fixture
def root(empty_database, tmp_path):
    shutil.copy(empty_database, tmp_path / "mlflow.db")
    return tmp_path


def write(root, one: Record, files=(), **origin) -> bool:
    said = Origin(name="first try", tags={"git.commit": "abc"}, files=list(files), **origin)
    return write_record(root, EXPERIMENT, one, said) == RECORDED


def runs(root, condition: str):
    client = store.open_client(root)
    home = client.get_experiment_by_name(EXPERIMENT)
    return client.search_runs([home.experiment_id], condition, order_by=["attributes.start_time ASC"])


def test_a_result_is_a_finished_parent_with_its_stages(root):
    page = root / "index.html"
    page.write_text("<p>")
    assert write(root, record(), [page])
    (parent,) = runs(root, "tags.`record.kind` = 'result'")
    assert parent.info.status == "FINISHED"
    assert parent.info.run_name == "first try"
    assert len(parent.data.params) == 250
    assert parent.data.metrics == {
        "merge.grasps": 8.0, "stages.run": 2.0, "stages.reused": 0.0, "stages.cpu_seconds": 50.0
    }  # fmt: skip
    assert parent.data.tags["git.commit"] == "abc" and parent.data.tags["record.key"] == "k1"
    nested = runs(root, f"tags.mlflow.parentRunId = '{parent.info.run_id}'")
    assert sorted(run.data.tags["dvc.stage"] for run in nested) == ["merge@cube", "prepare@cube"]
    assert {run.data.tags["dvc.stage_state"] for run in nested} == {"fresh"}
    merge = next(run for run in nested if run.data.tags["dvc.stage"] == "merge@cube")
    assert merge.data.metrics == {"grasps": 8.0, "wall_seconds": 30.0, "cpu_seconds": 50.0}
    kept = root / "mlartifacts" / parent.info.run_id / "artifacts" / "index.html"
    assert kept.read_text() == "<p>"


def test_a_curve_is_recorded_once_step_by_step(root):
    curve = tuple({"step": float(step), "loss": 1.0 / step} for step in (100, 200, 300))
    stage = StageRecord("train", "t1", {}, {"loss": 0.5}, {}, curve)
    for key in ("k1", "k2"):  # another result with the same training
        assert write(root, Record(key, {}, {}, [stage]))
    client = store.open_client(root)
    for parent in runs(root, "tags.`record.kind` = 'result'"):  # where they are compared, whoever trained
        points = client.get_metric_history(parent.info.run_id, "train.curve.loss")
        assert [(point.step, point.value) for point in points] == [(100, 0.01), (200, 0.005), (300, 1 / 300)]
    fresh, reused = runs(root, "tags.`dvc.stage` = 'train'")
    points = client.get_metric_history(fresh.info.run_id, "curve.loss")
    assert [(point.step, point.value) for point in points] == [(100, 0.01), (200, 0.005), (300, 1 / 300)]
    assert client.get_metric_history(reused.info.run_id, "curve.loss") == []
    assert fresh.data.metrics["loss"] == 0.5


def test_the_same_result_is_recorded_once(root):
    assert write(root, record())
    assert not write(root, record())
    assert len(runs(root, "")) == 3


def test_a_stage_that_was_reused_points_to_its_first_run(root):
    write(root, record("k1", "m1"))
    write(root, record("k2", "m2"))
    write(root, record("k3", "m1"))
    first, second, third = runs(root, "tags.`dvc.stage` = 'merge@cube'")
    assert [run.data.tags["dvc.stage_state"] for run in (first, second, third)] == ["fresh", "fresh", "reused"]
    assert third.data.tags["dvc.first_run_id"] == first.info.run_id
    assert "wall_seconds" not in third.data.metrics and third.data.metrics["grasps"] == 8.0
    assert len(runs(root, "tags.`dvc.stage` = 'prepare@cube' and tags.`dvc.stage_state` = 'fresh'")) == 1


def test_the_versions_of_data_are_data_sets_and_tags(root):
    write(root, record())
    (parent,) = runs(root, "tags.`record.kind` = 'result'")
    assert parent.data.tags["dvc.data.data/merge/cube"] == "bb" * 16 + ".dir"
    (result,) = parent.inputs.dataset_inputs
    assert (result.dataset.name, result.dataset.digest) == ("data/merge/cube", "bb" * 16 + ".dir")
    (merge,) = runs(root, "tags.`dvc.stage` = 'merge@cube'")
    contexts = {one.dataset.name: one.tags[0].value for one in merge.inputs.dataset_inputs}
    assert contexts == {"data/validate/side": "input", "data/merge/cube": "output"}


def test_the_parent_says_which_stages_were_reused(root):
    write(root, record("k1", "m1"))
    write(root, record("k2", "m2"))
    second = runs(root, "tags.`record.kind` = 'result'")[1]
    assert second.data.tags["dvc.stages_run"] == "1: merge@cube"
    assert second.data.tags["dvc.stages_reused"] == "1: prepare@cube"
    assert (second.data.metrics["stages.run"], second.data.metrics["stages.reused"]) == (1.0, 1.0)


def test_a_result_of_the_past_has_the_time_of_the_past_and_did_not_use_what_came_later(root):
    write(root, record("now"))
    write(root, record("past"), began=1.7e9)
    past, now = runs(root, "tags.`record.kind` = 'result'")
    assert past.info.start_time == past.info.end_time == 1_700_000_000_000
    assert past.data.metrics["stages.run"] == now.data.metrics["stages.run"] == 2.0


def test_what_a_record_lacked_is_added_once_it_is_there(root):
    page = root / "index.html"
    page.write_text("<p>")
    curve = ({"step": 1.0, "loss": 0.5},)
    without, whole = (Record("k1", {}, {}, [StageRecord("train", "t1", {}, {}, {}, c)]) for c in ((), curve))
    poor, rich = Origin("x", {}, lacks="its page and its curves"), Origin("x", {}, files=[page])
    written = [write_record(root, EXPERIMENT, one, origin) for one, origin in ((without, poor), (without, poor))]
    written += [write_record(root, EXPERIMENT, whole, rich) for _ in range(2)]
    assert written == [RECORDED, KNOWN, COMPLETED, KNOWN]
    (parent,) = runs(root, "tags.`record.kind` = 'result'")
    assert (root / "mlartifacts" / parent.info.run_id / "artifacts" / "index.html").exists()
    assert parent.data.metrics["train.curve.loss"] == 0.5
    assert runs(root, "tags.`dvc.stage` = 'train'")[0].data.metrics["curve.loss"] == 0.5


def test_an_experiment_of_dvc_gives_its_name_and_records_where_it_was_started(tmp_path, monkeypatch):
    copy, started_in = tmp_path / "copy", tmp_path / "repository"
    started_in.mkdir()
    assert (record_root(copy), run_name("k" * 32)) == (copy, "k" * 12)
    monkeypatch.setenv("DVC_ROOT", str(started_in))
    assert record_root(copy) == copy  # `dvc repro` sets it as well
    monkeypatch.setenv("DVC_EXP_NAME", "lower-friction")
    assert (record_root(copy), run_name("k" * 32)) == (started_in, "lower-friction")
    assert origin_tags(tmp_path)["dvc.experiment"] == "lower-friction"


def test_an_interrupted_recording_is_done_again(root, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(mlflow_runs, "_write_stage", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write(root, record())
    assert write(root, record())
    assert [run.info.status for run in runs(root, "tags.`record.kind` = 'result'")] == ["FINISHED"]
    assert len(runs(root, "")) == 3


def test_a_locked_database_is_one_sentence(root, monkeypatch):
    monkeypatch.setattr(store, "LOCK_SECONDS", 0.1)
    with sqlite3.connect(root / "mlflow.db", isolation_level=None) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(UserError, match="another program is writing to it"):
            write(root, record())
    other.close()


def test_a_file_that_is_no_database_is_one_sentence(tmp_path):
    (tmp_path / "mlflow.db").write_text("no database at all, but long enough to be looked at " * 40)
    with pytest.raises(UserError, match="damaged; move it away"):
        write(tmp_path, record())


@pytest.mark.parametrize("text", ["attempt to write a readonly database", "unable to open database file"])
def test_an_unwritable_database_is_one_sentence(tmp_path, text):
    assert "writable" in str(store._explained(tmp_path / "mlflow.db", text))


def test_a_moved_repository_is_one_sentence(root, tmp_path):
    write(root, record())
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.copy(root / "mlflow.db", elsewhere)
    with pytest.raises(UserError, match="moved or copied"):
        write(elsewhere, record())
