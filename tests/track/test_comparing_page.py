"""The experiments of docs/comparing.md are ones that can be run."""

import re
import shlex

import pytest
import yaml

from pipeline.records.parameters import read_parameters
from tools.scales import flatten


def experiments(repository):
    """Each `dvc exp run -n NAME -S ...` of the page, as (name, values)."""
    text = (repository / "docs/comparing.md").read_text()
    commands = [shlex.split(line) for line in re.findall(r"^dvc exp run .*$", text, re.MULTILINE)]
    return {words[words.index("-n") + 1]: [words[i + 1] for i, word in enumerate(words) if word == "-S"]
            for words in commands if "-n" in words}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("smaller-network", {"train.denoiser.width", "train.denoiser.blocks"}),
        ("lower-friction", {f"physics.{name}_friction" for name in ("object", "tip_static", "tip_dynamic")}),
        ("fewer-contacts", {"synthesize.pinch.finger_sets"}),
    ],
)
def test_an_experiment_changes_what_it_names_and_is_accepted(repository, tmp_path, name, changed):
    from dvc.utils.hydra import compose_and_dump

    composed = tmp_path / "params.yaml"
    values = experiments(repository)[name]
    compose_and_dump(composed, str(repository / "conf"), None, "config", "", values)
    read_parameters(composed)
    before, after = (flatten(yaml.safe_load(file.read_text())) for file in (repository / "params.yaml", composed))
    assert {key for key in before | after if before.get(key) != after.get(key)} == changed
