from __future__ import annotations

import os
from pathlib import Path

import pytest
import yaml

from pipeline.evaluate.inputs import sections
from pipeline.records.parameters import load_parameters


def test_sections_exist_in_the_committed_parameters(repository: Path) -> None:
    wanted = [*sections("synthesized", "cube"), *sections("reconstructed", "cube")]
    assert set(load_parameters(wanted, repository / "params.yaml")) == set(wanted)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--object", "teapot"), "styles.pinch does not name 'teapot'"),
        (
            ("--object", "cube", "--source", "reconstructed"),
            "data/train_reconstructed/cube/slender_cylinder.parquet is",
        ),
        (("--object", "duck", "--source", "reconstructed"), "there is no object 'duck' under `reconstructed`"),
        (("--object", "cube"), "data/merge/cube/slender_cylinder.parquet is missing; run `dvc repro merge@cube`"),
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
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "data" / "evaluate").exists()


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
