import errno
import json
import os
import stat

import pytest

from pipeline.records.errors import UserError
from pipeline.records.writing import whole_file, whole_folder, write_json


def names(folder):
    return sorted(path.name for path in folder.rglob("*"))


def test_file_appears_whole_with_its_parents(tmp_path):
    target = tmp_path / "a" / "b.txt"
    with whole_file(target) as temporary:
        temporary.write_text("done")
        assert not target.exists()
    assert target.read_text() == "done"
    assert names(tmp_path) == ["a", "b.txt"]


def test_failure_keeps_the_old_file_and_leaves_nothing(tmp_path):
    target = tmp_path / "b.txt"
    target.write_text("old")
    with pytest.raises(ZeroDivisionError), whole_file(target) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert target.read_text() == "old"
    assert names(tmp_path) == ["b.txt"]


def test_folder_replaces_the_old_one_whole(tmp_path):
    target = tmp_path / "object"
    (target / "parts").mkdir(parents=True)
    (target / "parts" / "stale.ply").write_text("old")
    with whole_folder(target) as temporary:
        (temporary / "mesh.ply").write_text("new")
    assert names(tmp_path) == ["mesh.ply", "object"]


def test_failed_folder_keeps_the_old_one_and_leaves_nothing(tmp_path):
    target = tmp_path / "object"
    target.mkdir()
    (target / "mesh.ply").write_text("old")
    with pytest.raises(ZeroDivisionError), whole_folder(target) as temporary:
        (temporary / "mesh.ply").write_text("half")
        raise ZeroDivisionError
    assert names(tmp_path) == ["mesh.ply", "object"]
    assert (target / "mesh.ply").read_text() == "old"


@pytest.mark.parametrize("writer", [whole_file, whole_folder])
@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EACCES, "read-only"),
        (errno.EROFS, "read-only"),
        (errno.EPERM, "read-only"),
        (errno.ENOSPC, "disk is full"),
    ],
)
def test_refusals_of_the_system_become_one_sentence(tmp_path, writer, number, words):
    with pytest.raises(UserError, match=words) as caught, writer(tmp_path / "out"):
        raise OSError(number, os.strerror(number))
    assert str(tmp_path / "out") in str(caught.value)
    assert "\n" not in str(caught.value)
    assert names(tmp_path) == []


@pytest.mark.parametrize("writer", [whole_file, whole_folder])
def test_a_file_in_the_way_of_the_folder_is_named(tmp_path, writer):
    (tmp_path / "data").write_text("a file, not a folder")
    with pytest.raises(UserError, match="cannot write .*data/out"), writer(tmp_path / "data" / "out"):
        pass
    assert names(tmp_path) == ["data"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
@pytest.mark.parametrize("writer", [whole_file, whole_folder])
def test_a_folder_without_write_permission_is_named(tmp_path, writer):
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    try:
        with pytest.raises(UserError, match="read-only"), writer(tmp_path / "out") as temporary:
            temporary.write_text("x")
    finally:
        tmp_path.chmod(stat.S_IRWXU)


def test_json_is_sorted_and_ends_with_a_newline(tmp_path):
    write_json(tmp_path / "a.json", {"b": 1, "a": {"d": 2.5, "c": None}})
    text = (tmp_path / "a.json").read_text()
    assert list(json.loads(text)) == ["a", "b"]
    assert text.endswith("}\n")
