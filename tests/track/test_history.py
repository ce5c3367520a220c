"""Results of the past, read from small git repositories made here."""

import hashlib
import json
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from pipeline.records.errors import UserError
from pipeline.track import backfill, store
from pipeline.track.backfill import record_all
from pipeline.track.history import Cache, check_repository, read_result, versions

STAGES = {"stages": {"train": {"cmd": "x"}, "merge": {"foreach": "${first}", "do": {}}, "report": {"cmd": "x"}}}
EXPERIMENT = "test"


def git(root: Path, *arguments: str, seconds: int = 1_700_000_000) -> str:
    who = {"GIT_AUTHOR_NAME": "a", "GIT_AUTHOR_EMAIL": "a@b", "GIT_COMMITTER_NAME": "a", "GIT_COMMITTER_EMAIL": "a@b"}
    when = {"GIT_AUTHOR_DATE": f"{seconds} +0000", "GIT_COMMITTER_DATE": f"{seconds} +0000"}
    done = subprocess.run(
        ["git", *arguments], cwd=root, env={**who, **when, "PATH": "/usr/bin:/bin"}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def put_in_cache(root: Path, content: bytes) -> str:
    fingerprint = hashlib.md5(content).hexdigest()
    place = root / ".dvc/cache/files/md5" / fingerprint[:2] / fingerprint[2:]
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(content)
    return fingerprint


def put_result(root: Path, width: int, cached: bool = False, first: str = "cube") -> None:
    """Write the files of a result: that of a model of this width."""
    summary = json.dumps({"train.training_loss": 1 / width}).encode()
    history, page, model = b"step,training_loss\n10,0.5\n20,0.25\n", f"<p>{width}".encode(), "aa" * 16
    if cached:
        listing = [{"relpath": "history.csv", "md5": put_in_cache(root, history)}]
        model = put_in_cache(root, json.dumps(listing).encode())
        put_in_cache(root, page)
    stages = {
        "train": {
            "params": {"params.yaml": {"train": {"width": width}}},
            "outs": [{"path": "models/train", "md5": model}],
        },
        f"merge@{first}": {"outs": [{"path": f"data/merge/{first}", "md5": "bb" * 16}]},
        "merge@gone": {},
        "report": {
            "outs": [
                {"path": "reports/index.html", "md5": hashlib.md5(page).hexdigest()},
                {"path": "reports/summary.json", "md5": hashlib.md5(summary).hexdigest()},
            ]
        },
    }
    (root / "reports").mkdir(exist_ok=True)
    (root / "reports/summary.json").write_bytes(summary)
    (root / "reports/durations.json").write_text('{"train": {"cpu_seconds": 80.0}, "merge@cube": "odd"}')
    (root / "dvc.lock").write_text(yaml.safe_dump({"stages": stages}))
    (root / "dvc.yaml").write_text(yaml.safe_dump(STAGES, sort_keys=False))
    (root / "params.yaml").write_text(yaml.safe_dump({"first": {first: {}}, "train": {"width": width}}))


def commit(root: Path, subject: str, seconds: int) -> str:
    git(root, "add", "dvc.lock", "dvc.yaml", "params.yaml", "reports")
    git(root, "commit", "-q", "-m", subject, seconds=seconds)
    return git(root, "rev-parse", "HEAD")


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    """A repository with two results, a commit that changed none, and an experiment."""
    root = tmp_path / "project"
    root.mkdir()
    git(root, "init", "-q")
    put_result(root, 256, cached=True)
    commit(root, "First", 1_700_000_000)
    put_result(root, 128)
    commit(root, "Second", 1_700_000_100)
    (root / "params.yaml").write_text("changed: {}\n")
    commit(root, "No result", 1_700_000_200)
    git(root, "checkout", "-q", "--detach")
    put_result(root, 64)
    tip = commit(root, "dvc: commit experiment 123", 1_700_000_300)
    git(root, "checkout", "-q", "-")
    git(root, "update-ref", f"refs/exps/ab/{'c' * 38}/tiny-network", tip)
    git(root, "update-ref", "refs/exps/exec/EXEC_BASELINE", tip)
    monkeypatch.setattr(backfill, "open_cache", lambda folder: Cache(folder / ".dvc/cache"))
    return root


@pytest.fixture
def with_database(project, empty_database) -> Path:
    shutil.copy(empty_database, project / "mlflow.db")
    return project


def recorded(root: Path):
    client = store.open_client(root)
    home = client.get_experiment_by_name(EXPERIMENT).experiment_id
    order = ["attributes.start_time ASC"]
    return client, client.search_runs([home], "tags.`record.kind` = 'result'", order_by=order)


def test_the_commits_of_results_and_the_experiments_come_in_order_of_time(project):
    found = versions(project)
    assert [version.title.split(" ", 1)[1] for version in found] == ["First", "Second", "[tiny-network]"]
    assert [version.seconds for version in found] == [1_700_000_000, 1_700_000_100, 1_700_000_300]


def test_a_result_of_the_past_is_what_its_commit_holds(project):
    past = read_result(project, versions(project)[0])
    assert past.summary == {"train.training_loss": 1 / 256} and past.parameters == {"train.width": 256}
    assert [stage.name for stage in past.stages] == ["train", "merge@cube", "report"]  # not the one that is gone
    assert past.durations == {"train": {"cpu_seconds": 80.0}}


def test_every_result_is_recorded_once(with_database, capsys):
    said = record_all(with_database, EXPERIMENT)
    assert said.startswith("3 commits and experiments hold 3 distinct results: 3 recorded now, 0 before; 0 skipped")
    assert "2 are without page or curves" in said
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3 and lines[1].endswith("without its page and its curves")
    client, (first, second, experiment) = recorded(with_database)
    assert first.info.start_time == 1_700_000_000_000
    assert (first.data.params["train.width"], second.data.params["train.width"]) == ("256", "128")
    assert experiment.info.run_name == experiment.data.tags["dvc.experiment"] == "tiny-network"
    assert [run.data.metrics["stages.reused"] for run in (first, second, experiment)] == [0, 1, 1]
    curve = client.get_metric_history(first.info.run_id, "train.curve.training_loss")
    assert [(point.step, point.value) for point in curve] == [(10, 0.5), (20, 0.25)]
    kept = with_database / "mlartifacts" / first.info.run_id / "artifacts"
    assert (kept / "index.html").read_text() == "<p>256"
    assert "0 recorded now, 3 before" in record_all(with_database, EXPERIMENT)
    assert capsys.readouterr().out == ""
    assert len(recorded(with_database)[1]) == 3


def test_commits_without_a_whole_result_are_skipped_with_the_reason(with_database, capsys):
    put_result(with_database, 256)
    (with_database / "reports/summary.json").write_text('{"a": 1}')
    commit(with_database, "Edited by hand", 1_700_000_400)
    put_result(with_database, 256)
    (with_database / "params.yaml").write_text("{}\n")
    commit(with_database, "No objects", 1_700_000_500)
    (with_database / "dvc.lock").write_text("stages: [")
    commit(with_database, "Broken", 1_700_000_600)
    git(with_database, "rm", "-q", "dvc.lock")
    git(with_database, "commit", "-q", "-m", "Gone", seconds=1_700_000_700)
    assert "3 recorded now, 0 before; 4 skipped" in record_all(with_database, EXPERIMENT)
    said = capsys.readouterr().out
    for reason in (
        "Edited by hand: skipped, its reports/summary.json is not the one that dvc.lock names",
        "No objects: skipped, its stages are unknown: params.yaml does not hold what dvc.yaml lists as ${first}",
        "Broken: skipped, its dvc.lock is damaged",
        "Gone: skipped, it has no dvc.lock",
    ):
        assert reason in said


def test_a_part_of_a_history_is_refused(project, tmp_path):
    git(tmp_path, "clone", "-q", "--depth", "1", project.as_uri(), "shallow")
    with pytest.raises(UserError, match="unshallow"):
        check_repository(tmp_path / "shallow")
    (tmp_path / "bare").mkdir()
    with pytest.raises(UserError, match="no git repository"):
        check_repository(tmp_path / "bare")
    git(tmp_path / "bare", "init", "-q")
    with pytest.raises(UserError, match="no commit yet"):
        check_repository(tmp_path / "bare")


def test_without_git_it_is_one_sentence(project, monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(UserError, match="install git"):
        check_repository(project)
