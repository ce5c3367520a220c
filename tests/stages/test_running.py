import json
import subprocess
import sys
from pathlib import Path

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.stages.running import run_stage


def test_success_is_zero_and_leaves_a_line_of_durations(empty_folder):
    assert run_stage("prepare@cube", lambda: None) == 0
    assert run_stage("merge", lambda: None) == 0
    known = json.loads(paths.DURATIONS_FILE.read_text())
    assert sorted(known) == ["merge", "prepare@cube"]
    assert set(known["merge"]) == {"wall_seconds", "cpu_seconds", "peak_megabytes_largest_process"}


def test_user_error_is_one_line_and_two(empty_folder, capsys):
    def work():
        raise UserError("data/x is missing; run `dvc repro x`.")

    assert run_stage("merge", work) == 2
    assert capsys.readouterr().err == "merge: data/x is missing; run `dvc repro x`.\n"
    assert not paths.DURATIONS_FILE.exists()


def test_operating_system_error_names_the_file(empty_folder, capsys):
    assert run_stage("merge", lambda: open("absent.txt").close()) == 2
    assert capsys.readouterr().err == "merge: cannot use absent.txt: No such file or directory.\n"


def test_a_defect_is_one_line_with_the_path_of_its_traceback(empty_folder, capsys):
    assert run_stage("merge", lambda: 1 / 0) == 1
    assert capsys.readouterr().err == (
        "merge: stopped by a defect of the program (ZeroDivisionError: division by zero); please report it with the "
        "log data/.unfinished/logs/merge.log.\n"
    )
    assert "ZeroDivisionError: division by zero" in Path("data/.unfinished/logs/merge.log").read_text()


def test_a_log_goes_elsewhere_where_the_project_cannot_be_written(empty_folder, capsys, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(empty_folder / "other"))
    monkeypatch.setattr("tempfile.tempdir", None)
    (empty_folder / "other").mkdir()
    (empty_folder / "data").write_text("a file where the folder should be")
    assert run_stage("merge", lambda: [][0]) == 1
    assert f"the log {empty_folder}/other/merge.log." in capsys.readouterr().err


def test_an_interrupted_command_says_so(empty_folder, capsys):
    def work():
        raise KeyboardInterrupt

    assert run_stage("merge", work) == 130
    assert capsys.readouterr().err == "merge: interrupted; run again to go on.\n"


def test_damaged_durations_do_not_stop_a_stage(empty_folder):
    paths.DURATIONS_FILE.parent.mkdir()
    paths.DURATIONS_FILE.write_text("{half")
    assert run_stage("merge", lambda: None) == 0
    assert "merge" in json.loads(paths.DURATIONS_FILE.read_text())


def test_work_of_living_workers_is_counted(empty_folder):
    """The operating system's own sum leaves out children that have not ended."""
    burn = "x = 0\nwhile __import__('time').process_time() < 0.5: x += 1\nprint('burnt', flush=True)\ninput()"
    worker = subprocess.Popen(
        [sys.executable, "-c", f"data = b'x' * 200_000_000\n{burn}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert worker.stdout.readline() == "burnt\n"
        run_stage("merge", lambda: None)
    finally:
        worker.communicate("end\n")
    entry = json.loads(paths.DURATIONS_FILE.read_text())["merge"]
    assert entry["cpu_seconds"] >= 0.5
    assert entry["peak_megabytes_largest_process"] >= 190
