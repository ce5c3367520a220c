from __future__ import annotations

import os

import pytest


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--object", "teapot"), "styles.pinch does not list 'teapot'"),
        (("--object", "cube", "--source", "reconstructed"), "data/prepare/cube/object.json is missing"),
        (("--object", "duck", "--source", "reconstructed"), "there is no object 'duck' under `reconstructed`"),
        (("--object", "cube"), "run `dvc repro prepare`"),
    ],
)
def test_bad_input_is_one_sentence(run_module, tmp_path, repository, arguments, sentence) -> None:
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
    assert len([line for line in done.stderr.splitlines() if line and "%|" not in line]) == 1  # but progress bars
    assert not list(tmp_path.glob("data/evaluate/*/*"))
