"""What goes wrong around a run: disk, kills, two at once, clocks. Nothing is lost, and one sentence says what to do."""

from __future__ import annotations

import errno
import hashlib
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.records.errors import UserError
from pipeline.records.writing import whole_file, whole_folder
from pipeline.stages.running import run_stage
from tests.trust.damage import by_hand
from tools import check_cache, prune


def names(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


# --- a full disk


class LibraryError(Exception):
    """Like those of safetensors and torch: no OSError, and without its number."""


@pytest.mark.parametrize("writer", [whole_file, whole_folder])
@pytest.mark.parametrize(
    ("error", "free"),
    [
        (LibraryError("I/O error: No space left on device (os error 28)"), 10**9),
        (LibraryError("unexpected pos 704 vs 598"), 0),
        (OSError("100000 requested and 16368 written"), 0),
        (OSError(errno.EDQUOT, "Disk quota exceeded"), 10**9),
    ],
)
def test_a_full_disk_is_named_whatever_library_found_out(tmp_path, monkeypatch, writer, error, free):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 10**9 - free, free))
    with pytest.raises(UserError, match="the disk is full; free some space and run again"), writer(tmp_path / "out"):
        raise error
    assert names(tmp_path) == []


def test_other_errors_of_libraries_stay_what_they_are(tmp_path):
    with pytest.raises(LibraryError), whole_file(tmp_path / "out"):
        raise LibraryError("shapes differ")


def test_a_stage_says_that_the_disk_is_full(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def work() -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    assert run_stage("merge@cube", work) == 2
    assert capsys.readouterr().err == "merge@cube: the disk is full; free some space and run again.\n"


WRITERS = """
import sys
import numpy as np
from pathlib import Path
from pipeline.records.errors import UserError
from pipeline.records.writing import whole_file, whole_folder, write_json
place, numbers = Path(sys.argv[1]), np.random.default_rng(0).random(200_000)

def table():
    import pandas as pd, pyarrow as pa
    from pipeline.records.tables import write_table
    write_table(place / "t.parquet", pd.DataFrame({"a": numbers}), pa.schema([("a", pa.float64())]))

def folder():
    with whole_folder(place / "f") as target:
        np.save(target / "a.npy", numbers)

def checkpoint():
    import torch
    from safetensors.torch import save_file
    with whole_folder(place / "m") as target:
        save_file({"a": torch.as_tensor(numbers)}, target / "model.safetensors")

def state():
    import torch
    with whole_file(place / "s.pt") as target:
        torch.save({"a": torch.as_tensor(numbers)}, target)

def page():
    with whole_file(place / "index.html") as target:
        target.write_text("x" * 10**6)

def released():
    import h5py
    with whole_file(place / "a.h5") as target, h5py.File(target, "w") as file:
        file["a"] = numbers

def record():
    from pipeline.track.store import open_client
    open_client(place)

for work in (table, folder, checkpoint, state, page, released, record):
    try:
        work()
    except UserError as error:
        print(work.__name__, "|", error, "|", *[path.name for path in place.iterdir()])
"""


@by_hand
@pytest.mark.skipif(os.geteuid() != 0 or not shutil.which("unshare"), reason="a small disk needs root")
def test_every_kind_of_file_on_a_disk_that_is_really_full(repository, tmp_path):
    mount = f'mount -t tmpfs -o size=128k none "{tmp_path}" && exec "$0" -c "$1" "{tmp_path}"'
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", mount, sys.executable, WRITERS],
        cwd=repository,
        capture_output=True,
        text=True,
    )
    if "ermitted" in done.stderr or "ermission denied" in done.stderr:
        pytest.skip("this machine lets nobody mount")
    lines = done.stdout.splitlines()
    kinds = ["table", "folder", "checkpoint", "state", "page", "released", "record"]
    assert [line.split(" | ")[0] for line in lines] == kinds, done.stdout + done.stderr
    for line in lines:
        _, sentence, left = line.split(" |")
        assert "the disk is full; free some space and run again" in sentence and left.strip() == "", line


# --- killed while writing, and two at once


def test_what_a_killed_process_of_the_same_number_left_is_no_hindrance(tmp_path):
    (tmp_path / f".out.{os.getpid()}.tmp").mkdir()
    (tmp_path / f".out.{os.getpid()}.tmp/half").touch()
    with whole_folder(tmp_path / "out") as temporary:
        (temporary / "whole").touch()
    assert names(tmp_path) == ["out", "out/whole"]


def _replace_often(target: Path, mark: str) -> None:
    for _ in range(60):
        with whole_folder(target) as temporary:
            for index in range(5):
                (temporary / f"{index}").write_text(mark)


def test_two_writers_of_a_folder_leave_one_of_both_whole(tmp_path):
    target = tmp_path / "out"
    fork = multiprocessing.get_context("fork")
    writers = [fork.Process(target=_replace_often, args=(target, mark)) for mark in "ab"]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert [writer.exitcode for writer in writers] == [0, 0]
    assert len({(target / f"{index}").read_text() for index in range(5)}) == 1
    assert names(tmp_path) == ["out", *(f"out/{index}" for index in range(5))]


def _dead_process() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_files_of_dvc_that_a_kill_cut_off_are_put_aside(empty_folder):
    (empty_folder / ".dvc/tmp").mkdir(parents=True)
    lock, busy = empty_folder / "dvc.lock", empty_folder / ".dvc/tmp/rwlock"
    assert prune.mend() == []
    lock.write_text("schema: '2.0'\nstages: {}\n")
    busy.write_text("{}")
    assert prune.mend() == []
    for cut in ("", "schema: '2.0'\nstages:\n  a: {cmd: 'x", "stages: {}\n"):
        lock.write_text(cut)
        assert prune.mend() == [prune.LOCK_FILE]
        assert not lock.exists() and (empty_folder / "dvc.lock.damaged.tmp").read_text() == cut
    busy.write_text(f'{{"a": {{"write": {{"pid": {_dead_process()}, "cmd": "dv')
    assert prune.mend() == [prune.BUSY_FILE] and not busy.exists()


def test_nothing_is_put_aside_while_dvc_runs(empty_folder):
    (empty_folder / ".dvc/tmp").mkdir(parents=True)
    (empty_folder / "dvc.lock").write_text("stages:\n  a: {")
    (empty_folder / ".dvc/tmp/rwlock").write_text(f'{{"a": {{"write": {{"pid": {os.getpid()}, "cmd": "dvc repro"}}}}}}')
    assert prune.mend() == []
    assert (empty_folder / "dvc.lock").exists()


# --- a damaged cache


def put(cache: Path, content: bytes, suffix: str = "") -> str:
    """Store a file as DVC does and return its hash."""
    name = hashlib.md5(content).hexdigest() + suffix
    (cache / name[:2]).mkdir(parents=True, exist_ok=True)
    (cache / name[:2] / name[2:]).write_bytes(content)
    (cache / name[:2] / name[2:]).chmod(0o444)
    return name


def test_damaged_cache_files_are_removed_with_what_was_made_of_them(empty_folder):
    cache = empty_folder / "cache"
    good, bad, member = (put(cache, content) for content in (b"good", b"bad", b"member"))
    listed = put(cache, f'[{{"md5": "{member}", "relpath": "m"}}]'.encode(), ".dir")
    outputs = {"good.txt": good, "bad.txt": bad, "folder": listed, "gone.txt": bad}
    lock = "".join(f"  {name}:\n    outs:\n    - {{path: {name}, md5: {value}}}\n" for name, value in outputs.items())
    (empty_folder / "dvc.lock").write_text(f"schema: '2.0'\nstages:\n{lock}")
    (empty_folder / "folder").mkdir()
    for name in ("good.txt", "bad.txt", "folder/m"):
        (empty_folder / name).touch()
    assert check_cache.check(cache) == []
    for name in (bad, member):
        path = cache / name[:2] / name[2:]
        path.chmod(0o644)
        path.write_bytes(b"spoilt")
    removed = {str(path.relative_to(empty_folder) if path.is_absolute() else path) for path in check_cache.check(cache)}
    assert removed == {*(f"cache/{name[:2]}/{name[2:]}" for name in (bad, member)), "bad.txt", "folder", "gone.txt"}
    assert (empty_folder / "good.txt").exists() and not (empty_folder / "folder").exists()
    assert check_cache.check(cache) == []


@by_hand
def test_a_record_killed_while_its_database_is_made_is_made_again(repository, tmp_path):
    work = (
        f"from pathlib import Path; from pipeline.track.store import open_client; open_client(Path({str(tmp_path)!r}))"
    )
    command = [sys.executable, "-c", work]
    process = subprocess.Popen(command, cwd=repository, stderr=subprocess.DEVNULL)
    while process.poll() is None and not any(
        path.stat().st_size > 50_000 for path in tmp_path.glob(".mlflow.db.*.tmp")
    ):
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "mlflow.db").exists()
    done = subprocess.run(command, cwd=repository, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "mlflow.db").exists()
