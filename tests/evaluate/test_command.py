from __future__ import annotations

import os
from pathlib import Path

import pytest
import yaml

from pipeline.evaluate.inputs import sections
from pipeline.records.parameters import load_parameters


def test_sections_exist_in_the_committed_parameters(repository: Path) -> None:
    wanted = {*sections("synthesized"), *sections("reconstructed")}
    assert set(load_parameters(wanted, repository / "params.yaml")) == wanted


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


def test_control_frequency_must_divide_that_of_physics(run_module, tmp_path, repository) -> None:
    content = yaml.safe_load((repository / "params.yaml").read_text())
    content["evaluate"] = {"control_frequency": 30}
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(content))
    arguments = ("--source", "synthesized", "--object", "cube")
    environment = os.environ | {"PYTHONPATH": str(repository)}
    done = run_module("pipeline.evaluate", *arguments, folder=tmp_path, env=environment)
    assert done.returncode == 2 and "evaluate.control_frequency must divide" in done.stderr


def test_help_is_there(run_module) -> None:
    done = run_module("pipeline.evaluate", "--help")
    assert done.returncode == 0 and "--source" in done.stdout
