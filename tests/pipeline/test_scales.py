"""`params.yaml` and `conf/`: composed, complete, and never overwritten by accident."""

import shutil
import sys

import pytest
import yaml
from pydantic import BaseModel

from pipeline.records.errors import UserError
from pipeline.records.parameters import ObjectParameters, Parameters
from pipeline.records.parameters.capture import RenderingParameters
from tools import scales
from tools.scales import flatten
from tools.typed_defaults import MISSING, defaults_of

SCALES = ["demo", "paper", "three", "tiny", "wide"]


@pytest.fixture
def project(repository, empty_folder):
    shutil.copytree(repository / "conf", "conf")
    shutil.copy(repository / "params.yaml", "params.yaml")
    return empty_folder


def edit(folder, value):
    path = folder / "params.yaml"
    content = yaml.safe_load(path.read_text())
    content["synthesize"]["pinch"]["chains"] = value
    path.write_text(yaml.safe_dump(content, sort_keys=False))


def test_committed_parameters_are_the_composed_demo(repository, project):
    scales.compose("demo", project / "composed.yaml")
    committed = (repository / "params.yaml").read_bytes()
    assert (project / "composed.yaml").read_bytes() == committed, "run `./dev compose demo --force` and commit"


def test_dvc_itself_composes_the_same(fresh):
    """`dvc exp run -S scale=...` must not disagree with `./dev compose`."""
    (fresh / "dvc.yaml").write_text("stages:\n  look:\n    cmd: cp params.yaml seen.yaml\n    outs: [seen.yaml]\n")
    fresh.commit("One stage")
    fresh.dvc("exp", "run", "--set-param", "scale=tiny")
    by_dvc = yaml.safe_load((fresh / "params.yaml").read_text())
    composed = fresh.command(sys.executable, "-m", "tools.scales", "compose", "tiny", "--force")
    assert composed.returncode == 0, composed.stderr
    assert yaml.safe_load((fresh / "params.yaml").read_text()) == by_dvc


def stated(file) -> dict:
    """Values in a file of conf/, by dotted name."""
    content = yaml.safe_load(file.read_text())
    return flatten({name: value for name, value in content.items() if name != "defaults"})


def test_a_value_is_a_typed_default_or_in_conf_but_not_both(repository):
    """Entries of a catalogue, such as objects, are not settings: each is whole, and may have an ordinary value."""
    rendering = defaults_of(RenderingParameters)
    defaults = flatten({**defaults_of(Parameters), "renderings": {"demo": rendering, "tiny": rendering}})
    shared = stated(repository / "conf/config.yaml")
    assert {defaults[name] for name in shared} == {MISSING}
    defaults |= shared
    demo, paper = (stated(repository / f"conf/scale/{name}.yaml") for name in ("demo", "paper"))
    parents = {"paper": demo, "wide": demo | paper}
    below: set[str] = set()  # set by a file over which this one may be composed
    for group in ("scale", "hand", "preset"):
        files = sorted((repository / "conf" / group).glob("*.yaml"))
        for file in files:
            replaced = below | set(parents.get(file.stem, {}))
            repeated = [k for k, v in stated(file).items() if k not in replaced and defaults.get(k, MISSING) == v]
            assert repeated == [], f"{file.name} repeats what holds without it"
        below |= {name for file in files for name in stated(file)}


@pytest.mark.parametrize("scale", SCALES)
def test_every_scale_is_valid_and_states_every_value(project, scale):
    scales.compose(scale, project / "params.yaml")
    content = yaml.safe_load((project / "params.yaml").read_text())
    assert content["scale"] == scale
    assert missing(Parameters, content) == []


@pytest.mark.parametrize("scale", SCALES)
def test_the_official_preset_has_the_released_settings_on_any_scale(project, scale):
    """Figures of the released code: step, switch, temperature, iterations, contacts, links, height over the table."""
    scales.compose(scale, project / "ours.yaml")
    scales.compose(scale, project / "params.yaml", "official")
    ours, official = (yaml.safe_load((project / name).read_text()) for name in ("ours.yaml", "params.yaml"))
    assert missing(Parameters, official) == []
    assert (official["scale"], official["preset"]) == (scale, "official")
    changed = {name for name in flatten(ours) if flatten(official).get(name) != flatten(ours)[name]}
    assert {name.split(".")[0] for name in changed} == {"synthesize", "validate", "preset"}
    # Of the validation its cost, the paper's frictions, and the squeeze with which the pinches were compared.
    tests = {"sapien_contact_offset": 0.02, "early_rejection": False, "friction": None, "pinch_squeeze": 0.01}
    assert {name for name in changed if name.startswith("validate.")} == {f"validate.{name}" for name in tests}
    assert tests.items() <= official["validate"].items()
    chains = official["synthesize"]["optimizer"]
    released = {"step": 0.005, "step_period": 50, "switch_probability": 0.5, "temperature": 18.0, "noise": 0.0}
    released |= {"temperature_period": 30, "momentum": 0.02, "polish_iterations": 0}
    assert released.items() <= chains.items()
    for style, contacts, clearance in (("pinch", [2, 2, 3], 0.005), ("side", [4], 0.02)):
        settings = official["synthesize"][style]
        assert settings["iterations"] == 6000 and settings["table_clearance"] == clearance
        assert [settings["contacts"]["+".join(fingers)] for fingers in settings["finger_sets"]] == contacts
        assert settings["chains"] == ours["synthesize"][style]["chains"]
    assert scales.describe() == f"scale {scale} with the official preset"


def test_the_published_model_changes_the_training_alone(project):
    scales.compose("paper", project / "ours.yaml")
    scales.compose("paper", project / "params.yaml", "published_model")
    ours, published = (flatten(yaml.safe_load((project / n).read_text())) for n in ("ours.yaml", "params.yaml"))
    changed = {name for name in ours if published.get(name) != ours[name]}
    assert {name.split(".")[0] for name in changed} == {"train", "preset"}
    assert published["train.diffusion.schedule"] == "published" and published["train.optimization.batch"] == 512


def test_every_switch_of_the_synthesis_is_used_by_one_preset(project):
    for preset in ("ours", "official"):
        scales.compose("demo", project / f"{preset}.yaml", preset)
    ours, official = (
        flatten(yaml.safe_load((project / f"{name}.yaml").read_text())["synthesize"]) for name in ("ours", "official")
    )
    alike = {name for name, value in ours.items() if isinstance(value, bool) and official[name] == value}
    assert not alike


def test_an_unknown_preset_is_answered_with_the_known_ones(project):
    with pytest.raises(UserError, match="no preset 'huge' .* use one of official, ours, published_model"):
        scales.switch("demo", force=True, preset="huge")


def missing(model: type[BaseModel], content: dict, where: str = "") -> list[str]:
    """Fields of ``model`` that ``content`` leaves to a default; of an object, only those that apply to it count."""
    found = []
    for name, field in model.model_fields.items():
        key = field.alias or name
        if key not in content:
            if model is not ObjectParameters or field.default is not None:
                found.append(where + key)
        elif isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            found += missing(field.annotation, content[key], f"{where}{key}.")
        elif key == "objects":
            for item, values in content[key].items():
                found += missing(ObjectParameters, values, f"objects.{item}.")
    return found


def test_tiny_covers_both_styles(project):
    scales.compose("tiny", project / "params.yaml")
    styles = yaml.safe_load((project / "params.yaml").read_text())["styles"]
    assert len(styles["pinch"]) == len(styles["side"]) == 1


def test_scale_is_said_with_hand_edits(project):
    assert scales.describe() == "scale demo"
    edit(project, 7)
    assert scales.describe() == "scale demo, edited in params.yaml: synthesize.pinch.chains"


def test_hand_edits_are_not_overwritten_without_force(project, capsys):
    edit(project, 7)
    before = (project / "params.yaml").read_bytes()
    assert scales.main(["compose", "paper"]) == 2
    said = capsys.readouterr().err
    assert "synthesize.pinch.chains" in said and "--force" in said and said.count("\n") == 1
    assert (project / "params.yaml").read_bytes() == before
    assert scales.main(["compose", "paper", "--force"]) == 0
    assert yaml.safe_load((project / "params.yaml").read_text())["scale"] == "paper"


def test_a_file_of_another_version_is_composed_anew_with_force(project, capsys):
    text = (project / "params.yaml").read_text()
    (project / "params.yaml").write_text(text.replace("weight_distance:", "weight_of_earlier_versions:"))
    assert scales.main(["compose", "demo"]) == 2
    assert "weight_of_earlier_versions" in (said := capsys.readouterr().err) and "--force" in said
    assert scales.main(["compose", "demo", "--force"]) == 0
    assert (project / "params.yaml").read_text() == text


def test_switching_there_and_back_gives_the_same_bytes(project):
    before = (project / "params.yaml").read_bytes()
    scales.switch("paper", force=False)
    assert (project / "params.yaml").read_bytes() != before
    scales.switch("demo", force=False)
    assert (project / "params.yaml").read_bytes() == before


def test_an_unknown_scale_is_answered_with_the_known_ones(project):
    with pytest.raises(UserError, match="no scale 'huge' .* use one of demo, paper, three, tiny"):
        scales.switch("huge", force=False)


def test_a_wrong_value_in_conf_does_not_reach_params(project):
    path = project / "conf/scale/paper.yaml"
    path.write_text(path.read_text() + "\nseed: -3\n")
    before = (project / "params.yaml").read_bytes()
    with pytest.raises(UserError, match="seed"):
        scales.switch("paper", force=False)
    assert (project / "params.yaml").read_bytes() == before


def test_differences_see_removed_and_added_objects(project):
    content = yaml.safe_load((project / "params.yaml").read_text())
    content["styles"]["pinch"] = ["cube"]
    del content["objects"]["plum"]
    (project / "params.yaml").write_text(yaml.safe_dump(content))
    named = scales.differences("demo")
    assert "styles.pinch" in named and "objects.plum.ycb" in named
