import copy

import pytest
import yaml
from pydantic import BaseModel

from pipeline.records.errors import UserError
from pipeline.records.parameters import Parameters, load_parameters, read_parameters, require_conditions


@pytest.fixture
def content(repository):
    return yaml.safe_load((repository / "params.yaml").read_text())


@pytest.fixture
def check(tmp_path):
    """Write a changed params.yaml and return the error that reading it raises."""

    def read(changed) -> str:
        source = tmp_path / "params.yaml"
        source.write_text(yaml.safe_dump(changed, sort_keys=False))
        with pytest.raises(UserError) as caught:
            require_conditions(read_parameters(source), source)
        text = str(caught.value)
        assert "\n" not in text and str(source) in text
        return text

    return read


def with_value(content, path, value):
    changed = copy.deepcopy(content)
    *folders, last = path.split(".")
    section = changed
    for folder in folders:
        section = section[folder]
    section[last] = value
    return changed


def test_the_committed_file_is_valid(repository):
    assert read_parameters(repository / "params.yaml").scale == "demo"


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        ("synthesize.pinch.chains", 0, "synthesize.pinch.chains: "),
        ("synthesize.pinch.chains", "many", "synthesize.pinch.chains: "),
        ("synthesize.pinch.chain", 9, "synthesize.pinch.chain: unknown"),
        ("physics.object_friction", float("nan"), "physics.object_friction: "),
        ("evaluatee", {}, "evaluatee: unknown"),
        ("seed", -1, "seed: "),
        ("styles.pinch", ["cube", "dragon"], "styles.pinch lists the unknown object 'dragon'"),
        ("styles.pinch", ["cube", "cube"], "styles.pinch lists an object twice"),
        ("objects.cube.ycb", "018_plum", "objects.cube: "),
        ("objects.cube.extents", None, "objects.cube: "),
        ("objects.cube.extents", [0.1, 0.1, -0.1], "objects.cube: extents"),
        ("objects.Cube", {"recipe": "box", "extents": [1, 1, 1]}, "'Cube'"),
        ("validate.gravity_directions", ["down"], "validate.gravity_directions.0: "),
        ("objects.cube.fit_longest", 0.05, "objects.cube: give extents or fit_longest"),
        ("objects.plum", {"ycb": "018_plum", "scale": 2.0, "fit_longest": 0.05}, "give scale or fit_longest"),
        ("objects.plum.pose", 2, "objects.plum: pose is for `up: auto`"),
        ("meshes.mug", {"file": "../mug.stl"}, "meshes.mug.file is not below data/raw"),
        ("meshes.mug", {"file": "/tmp/mug.stl"}, "meshes.mug.file is not below data/raw"),
        ("meshes.mug", {"file": "data/mug.stl"}, "meshes.mug.file is not below data/raw"),
        ("meshes.mug", {"file": "data/raw"}, "meshes.mug.file is not below data/raw"),
        ("meshes.mug", {"file": "data/raw/../mug.stl"}, "meshes.mug.file is not below data/raw"),
        ("captures.mine", {"folder": "/tmp/photos"}, "captures.mine.folder"),
        ("captures.mine", {"folder": "data/capture/gone"}, "captures.mine.folder"),
        ("captures.mine", {"folder": "data/raw/../photos"}, "captures.mine.folder"),
        ("pairs", 0, "pairs"),
        ("pairs", "some", "pairs"),
        ("pairs", [["cube", "plum"]], "plum is not in styles.side"),
        ("pairs", [["cube", "soup_can"]] * 2, "pairs lists a pair twice"),
        ("meshes.mug", {"file": "data/raw/mug.stl", "unit": "ell"}, "meshes.mug.unit: "),
        ("objects.cube.file", "data/raw/cube.stl", "objects.cube.file: unknown"),
        ("meshes.cube", {"file": "data/raw/cube.stl"}, "'cube' is used in both objects and meshes"),
        ("meshes.mug", {"unit": "mm"}, "meshes.mug.file: "),
        ("evaluate.lift_height", 0.2, "evaluate: lift_height"),
        ("evaluate.control_frequency", 30, "evaluate.control_frequency must divide physics.frequency (200)"),
        ("evaluate.shorter_entries", [0.1, -0.1], "evaluate.shorter_entries.1: "),
        ("merge.approach_lengths", [0.0], "merge.approach_lengths.0: "),
        ("conditions.pairs", [["cube", "lemon"]], "conditions.pairs: cube, lemon"),
        ("conditions.pairs", [["cube", "soup_can"]] * 2, "conditions: pairs lists a pair twice"),
        ("conditions.pairs", [], "conditions: pairs is empty"),
        ("conditions.trials", 26, "conditions.trials must not exceed evaluate.trials (25)"),
        ("conditions.sources", ["guessed"], "there is no source 'guessed'"),
        ("conditions.engines", ["abacus"], "conditions.engines.0: "),
        ("conditions.settings.mu_0_5.drawn", True, "conditions.settings.mu_0_5: friction is drawn"),
        ("conditions.settings.mu_0_5.physics", {"tip_static_friction": 1}, "or physics.tip_static_friction"),
        ("conditions.settings.placement.physics", {"engine": "sapien"}, "remove physics.engine"),
        ("conditions.distribution.friction", [0.9, 0.3], "conditions.distribution.friction: "),
        ("conditions.settings.placement.evaluate.trials", 2, "conditions.settings.placement.evaluate.trials"),
        (
            "conditions.settings.mu_0_5.physics",
            {"friction": 1},
            "mu_0_5 with sapien: friction: unknown",
        ),
        ("conditions.settings.placement.evaluate.perturbation", 9, "placement with sapien: perturbation: "),
        ("conditions.settings.placement.evaluate.lift_height", 0.1, "placement with sapien: lift_height"),
        (
            "conditions.settings.placement.physics",
            {"frequency": 400},
            "placement: remove its frequency",
        ),
        ("conditions.settings.Windy", {}, "'Windy'"),
        ("prepare.surface_points", 1000, "prepare.surface_points"),
    ],
)
def test_a_wrong_value_is_named_in_one_sentence(content, check, path, value, named):
    assert named in check(with_value(content, path, value))


@pytest.mark.parametrize(
    ("path", "value"), [("conditions.pairs", [["cube", "lemon"]]), ("conditions.trials", 26)], ids=["pairs", "trials"]
)
def test_conditions_refuse_only_what_uses_them(content, tmp_path, path, value):
    """The folder faults/stage-whole-loss: the sections of a source's trials, of sampling, and of the conditions."""
    from pipeline.evaluate import conditions, inputs
    from pipeline.sample.__main__ import sections

    source = tmp_path / "params.yaml"
    source.write_text(yaml.safe_dump(with_value(content, path, value)))
    load_parameters(inputs.sections("synthesized"), source)
    load_parameters(sections("learned"), source)
    with pytest.raises(UserError, match=f"{path}"):
        load_parameters(conditions.sections(), source)


@pytest.mark.parametrize("folder", ["data/raw/my_capture", "data/raw/lab/monday/", "data/capture/demo/"])
def test_photos_may_lie_in_the_raw_folder_or_be_a_rendering(content, tmp_path, folder):
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(with_value(content, "captures.mine", {"folder": folder})))
    assert read_parameters(tmp_path / "params.yaml").captures["mine"].folder == folder


def test_a_missing_section_is_named(content, check):
    del content["physics"]
    assert "physics: Field required" in check(content)


def test_several_mistakes_are_counted(content, check):
    changed = with_value(with_value(content, "seed", -1), "report.picture_width", 1)
    assert "(1 more)" in check(changed)


@pytest.mark.parametrize(
    ("text", "words"), [("a: [1", "not valid YAML"), ("", "holds no parameters"), ("- 1", "holds no parameters")]
)
def test_a_damaged_file_is_one_sentence(tmp_path, text, words):
    source = tmp_path / "params.yaml"
    source.write_text(text)
    with pytest.raises(UserError, match=words) as caught:
        read_parameters(source)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_one_sentence(tmp_path):
    with pytest.raises(UserError, match="is missing; run in the root of the repository"):
        read_parameters(tmp_path / "params.yaml")


def test_only_the_sections_asked_for_are_given(repository):
    sections = load_parameters(["seed", "objects.cube", "synthesize.pinch", "validate"], repository / "params.yaml")
    assert sorted(sections) == ["objects.cube", "seed", "synthesize.pinch", "validate"]
    assert sections["objects.cube"].recipe == "box"
    assert sections["validate"].gravity_seconds == 2.5


def test_an_unknown_object_is_answered_with_the_known_ones(repository):
    with pytest.raises(
        UserError, match="there is no object 'dragon' under `objects`; add it .* or use one of cube, plum"
    ):
        load_parameters(["objects.dragon"], repository / "params.yaml")


def test_an_unknown_condition_is_called_a_condition(repository):
    with pytest.raises(UserError, match="there is no condition 'windy' under `conditions`; .* use one of dist"):
        load_parameters(["conditions.settings.windy"], repository / "params.yaml")


def test_values_are_read_only(repository):
    with pytest.raises(ValueError, match="frozen"):
        read_parameters(repository / "params.yaml").seed = 2


def sections_of(model: type[BaseModel]) -> list[type[BaseModel]]:
    found = [model]
    for field in model.model_fields.values():
        kinds = [field.annotation, *getattr(field.annotation, "__args__", ())]
        for kind in kinds:
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                found += sections_of(kind)
    return found


def test_every_field_is_documented():
    undocumented = [
        f"{model.__name__}.{name}"
        for model in sections_of(Parameters)
        for name, field in model.model_fields.items()
        if not field.description
        and not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel))
    ]
    assert undocumented == []
