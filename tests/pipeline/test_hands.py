"""The hand is a parameter: what it composes, what it refuses, and what its tables say."""

import shutil
from importlib import import_module
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from pipeline.hand.model import load_hand
from pipeline.hand.robot import require_arm
from pipeline.records.errors import UserError
from pipeline.records.hands import known_hands
from pipeline.records.parameters import load_parameters, read_parameters
from pipeline.records.tables import CANDIDATES, VALIDATED, hand_of_schema, of_hand, read_table, write_table
from tests.pipeline.declared import declared_stages
from tools import scales

ROOT = Path(__file__).resolve().parents[2]
AFTER_VALIDATION = [
    stage for stage in declared_stages(ROOT) if stage.room in ("merge", "train", "evaluate", "report", "track")
]


@pytest.fixture
def project(repository, empty_folder):
    shutil.copytree(repository / "conf", "conf")
    return empty_folder


@pytest.fixture(scope="module")
def composed_text(tmp_path_factory):
    """``params.yaml`` of the demo with the other hand."""
    target = tmp_path_factory.mktemp("composed") / "params.yaml"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        scales.compose("demo", target, hand="dclaw")
    return target.read_text()


@pytest.fixture
def with_dclaw(composed_text, empty_folder):
    (empty_folder / "params.yaml").write_text(composed_text)
    return yaml.safe_load(composed_text)


def test_every_described_hand_can_be_composed(project):
    assert scales.choices("hand") == known_hands() == ["allegro", "dclaw"]


@pytest.mark.parametrize("scale", ["demo", "paper", "tiny"])
def test_another_hand_goes_with_every_scale(project, scale):
    scales.compose(scale, project / "params.yaml", hand="dclaw")
    composed = read_parameters()
    assert (composed.hand, composed.scale, composed.styles.side) == ("dclaw", scale, [])
    named = {finger for fingers in composed.synthesize.pinch.finger_sets for finger in fingers}
    assert named == {"one", "two", "three"}


def test_composing_says_which_hand_and_leads_back(project):
    said = scales.switch("tiny", force=True, hand="dclaw")
    assert said == "scale tiny with the hand dclaw, composed from conf/ into params.yaml"
    assert scales.describe() == "scale tiny with the hand dclaw"
    scales.switch("demo", force=False)  # nothing was edited
    assert read_parameters().hand == "allegro"


def test_an_unknown_hand_is_answered_with_the_known_ones(project):
    with pytest.raises(UserError, match="no hand 'claw' in conf/hand; use one of allegro, dclaw"):
        scales.switch("demo", force=True, hand="claw")


@pytest.mark.parametrize("stage", AFTER_VALIDATION, ids=lambda stage: stage.name)
def test_what_needs_a_hand_that_carries_out_all_picks_says_so_before_any_work(with_dclaw, stage):
    with pytest.raises(UserError, match="the hand dclaw has no side grasps"):
        import_module(stage.module).work() if stage.reads_everything else load_parameters(stage.sections())


def test_a_hand_on_no_arm_has_no_trials() -> None:
    require_arm(load_hand("allegro"))
    with pytest.raises(UserError, match="the hand dclaw is on no arm.*hands/dclaw/hand.yaml"):
        require_arm(load_hand("dclaw"))


def test_single_grasps_need_no_second_style(with_dclaw):
    for stage in declared_stages(ROOT):
        if stage.room in ("synthesize", "validate", "prepare"):
            assert load_parameters(stage.sections()).get("hand", "dclaw") == "dclaw"


def test_everything_is_refused_where_it_begins(with_dclaw, capsys):
    assert scales.main(["check", "--everything"]) == 2
    assert capsys.readouterr().err.startswith("scales: params.yaml: the hand dclaw has no side grasps")


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        ("hand", "claw", "hand: there is no hand 'claw'"),
        (
            "synthesize.pinch.contacts",
            {"one+two": 2, "one+three": 2, "two+three": 2, "one+two+three": 3, "one+tow": 2},
            "synthesize.pinch.contacts: 'tow'",
        ),
        ("synthesize.pinch.finger_sets", [["one", "thumb"]], "synthesize.pinch.finger_sets: 'thumb'"),
        ("synthesize.pinch.keep_out_margin", 0.002, "synthesize.pinch.keep_out_margin"),
        ("synthesize.pinch.mount_clearance", 0.005, "synthesize.pinch.mount_clearance"),
        ("styles.side", ["cube"], "synthesize.side.finger_sets is empty"),
        ("synthesize.side.finger_sets", [["one", "palm"]], "synthesize.side: the hand dclaw has no style side"),
    ],
)
def test_parameters_that_do_not_fit_the_hand_are_refused(with_dclaw, path, value, sentence):
    *folders, last = path.split(".")
    section = with_dclaw
    for folder in folders:
        section = section[folder]
    section[last] = value
    if last == "finger_sets":
        section["contacts"] = {"+".join(fingers): len(fingers) for fingers in value}
    Path("params.yaml").write_text(yaml.safe_dump(with_dclaw))
    with pytest.raises(UserError) as caught:
        read_parameters()
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


def test_tables_of_another_hand_have_its_joints_and_its_name(tmp_path):
    assert of_hand(CANDIDATES, "allegro", 16) is CANDIDATES and CANDIDATES.metadata is None
    schema = of_hand(VALIDATED, "dclaw", 9)
    assert schema.names == VALIDATED.names and schema.field("q").type == pa.list_(pa.float64(), 9)
    kinds = {pa.string(): "", pa.int32(): 1, pa.float64(): 0.5, pa.bool_(): True}
    row = {
        field.name: kinds.get(field.type, [0.5] * getattr(field.type, "list_size", 0)) for field in CANDIDATES
    } | dict.fromkeys(VALIDATED.names[len(CANDIDATES.names) :])
    for name, own in (("dclaw", schema), ("allegro", VALIDATED)):
        file = tmp_path / f"{name}.parquet"
        write_table(file, pd.DataFrame([row | {"q": [0.1] * own.field("q").type.list_size}]), own)
        assert hand_of_schema(pq.read_schema(file)) == name
        assert len(read_table(file, own, "validate-pinch@cube")) == 1
    assert b"hand" not in (pq.read_schema(tmp_path / "allegro.parquet").metadata or {})
    with pytest.raises(UserError, match="holds grasps of the hand dclaw, not of the allegro; run `dvc repro validate"):
        read_table(tmp_path / "dclaw.parquet", VALIDATED, "validate-pinch@cube")
