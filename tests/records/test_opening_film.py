"""What stands beside the film with which the report opens."""

import json

import pytest

from pipeline.records.errors import UserError
from pipeline.records.opening_film import VIDEO, OpeningFilm, load_film, write_about


def test_a_film_comes_back_with_the_trial_that_it_shows(tmp_path):
    write_about(tmp_path, ("synthesized", ("cube", "can"), 3))
    (tmp_path / VIDEO).write_bytes(b"mp4")
    assert load_film(tmp_path) == OpeningFilm("synthesized", ("cube", "can"), 3, b"mp4")


def test_a_run_without_success_has_none(tmp_path):
    write_about(tmp_path, None)
    assert load_film(tmp_path) is None


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(UserError, match=r"trial\.json is missing; delete the folder and run `dvc repro report`"):
        load_film(tmp_path)
    write_about(tmp_path, ("synthesized", ("cube", "can"), 3))
    with pytest.raises(UserError, match=r"trial\.mp4 is missing"):
        load_film(tmp_path)


@pytest.mark.parametrize("change", [{"objects": 3}, {"trial": None}, {"trial": "first"}])
def test_a_file_that_names_no_trial_is_refused(tmp_path, change):
    write_about(tmp_path, ("synthesized", ("cube", "can"), 3))
    about = tmp_path / "trial.json"
    content = json.loads(about.read_text())
    for text in ("", "[]", json.dumps(content | change)):
        about.write_text(text)
        with pytest.raises(UserError, match="names no trial"):
            load_film(tmp_path)
