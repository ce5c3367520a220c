from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.evaluate.__main__ import sections
from pipeline.records.parameters import load_parameters


def test_sections_exist_in_the_committed_parameters(repository: Path) -> None:
    wanted = sections("cube")
    assert set(load_parameters(wanted, repository / "params.yaml")) == set(wanted)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--object", "teapot"), "styles.pinch does not name 'teapot'"),
        (("--object", "cube"), "data/merge/cube--slender_cylinder.parquet is missing; run `dvc repro merge`"),
    ],
)
def test_bad_input_is_one_sentence(run_module, tmp_path, repository, arguments, sentence) -> None:
    import os

    (tmp_path / "params.yaml").write_text((repository / "params.yaml").read_text())
    done = run_module(
        "pipeline.evaluate",
        "--source",
        "synthesized",
        *arguments,
        folder=tmp_path,
        env=os.environ | {"PYTHONPATH": str(repository)},
    )
    assert done.returncode == 2 and sentence in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "data" / "evaluate").exists()


def test_help_is_there(run_module) -> None:
    done = run_module("pipeline.evaluate", "--help")
    assert done.returncode == 0 and "--source" in done.stdout
