"""The experiments of docs/comparing.md can be run, and change what they name."""

import re
import shlex
from pathlib import Path

import pytest
import yaml

from pipeline.records.parameters import read_parameters
from tools.scales import flatten

PAGE = Path(__file__).resolve().parents[2] / "docs/comparing.md"
EXPERIMENTS = [shlex.split(line) for line in re.findall(r"^dvc exp run -n .*$", PAGE.read_text(), re.MULTILINE)]


@pytest.mark.parametrize("words", EXPERIMENTS, ids=lambda words: words[words.index("-n") + 1])
def test_an_experiment_changes_what_it_names_and_is_accepted(repository, tmp_path, words):
    from dvc.utils.hydra import compose_and_dump

    values = [words[index + 1] for index, word in enumerate(words) if word == "-S"]
    composed = tmp_path / "params.yaml"
    compose_and_dump(composed, str(repository / "conf"), None, "config", "", values)
    read_parameters(composed)
    before, after = (flatten(yaml.safe_load(file.read_text())) for file in (repository / "params.yaml", composed))
    changed = {key for key in before | after if before.get(key) != after.get(key)}
    assert changed == {value.partition("=")[0] for value in values}
