"""Sequences as data: which fingers hold which object, and where it stands."""

from pathlib import Path

import pytest
import yaml

from pipeline.hand.support import PLANE, Support, support_of
from pipeline.records.errors import UserError
from pipeline.records.parameters import Parameters, chosen_sequences, read_parameters, second_objects
from pipeline.records.parameters.pairs import sequences
from pipeline.records.parameters.picks import narrowed, pick_of, waiting_fingers
from tools.scales import compose


@pytest.fixture(scope="module")
def three(tmp_path_factory, repository: Path) -> Path:
    """The parameters of scale `three`."""
    target = tmp_path_factory.mktemp("three") / "params.yaml"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(repository)
        compose("three", target)
    return target


@pytest.fixture
def parameters(three: Path, repository: Path, monkeypatch) -> Parameters:
    monkeypatch.chdir(repository)
    return read_parameters(three)


def test_a_scale_names_the_sequence_of_three(parameters: Parameters) -> None:
    declared = {name: getattr(parameters, name) for name in ("seed", "styles", "pairs", "picks")}
    assert parameters.sequences() == chosen_sequences(declared, "cube") == [("cube", "puck", "tin")]
    with pytest.raises(UserError, match="3 entries"):
        second_objects(chosen_sequences(declared))


def test_settings_of_a_pick_count_from_the_plane_under_its_post(parameters: Parameters) -> None:
    base, picks = parameters.synthesize.side, parameters.picks
    cube, puck, tin = picks
    assert support_of(None) == support_of(cube) == support_of(tin) == PLANE
    assert support_of(puck) == Support(puck.post.width / 2 + 0.005, puck.post.height)
    style = narrowed(base, puck)
    assert style.table_clearance == pytest.approx(base.table_clearance - puck.post.height)
    assert style.mount_clearance == pytest.approx(base.mount_clearance - puck.post.height)
    assert style.finger_sets == [["middle", "palm"]] and style.contacts == {"middle+palm": 2} and style.chains == 160
    assert narrowed(base, tin).table_clearance == base.table_clearance
    assert [waiting_fingers(picks, number) for number in range(3)] == [("middle", "ring"), ("ring",), ()]
    assert [pick_of(picks, "side", name) for name in ("puck", "tin", "cube")] == [1, 2, None]


def test_a_pair_changes_nothing_of_its_styles(repository: Path, monkeypatch) -> None:
    monkeypatch.chdir(repository)
    parameters = read_parameters()
    for number, (pick, base) in enumerate(
        zip(parameters.picks, (parameters.synthesize.pinch, parameters.synthesize.side), strict=True)
    ):
        assert narrowed(base, pick) == base and waiting_fingers(parameters.picks, number) == ()
        assert support_of(pick) == PLANE


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        ("the middle finger is named twice", [(2, "fingers", ["middle", "palm"])]),
        ("thumb has no straight posture", [(0, "fingers", ["index", "palm"]), (1, "fingers", ["thumb", "palm"])]),
        ("name the fingers of every pick, or of none", [(1, "fingers", None)]),
        ("held against the palm", [(0, "fingers", ["thumb", "palm"]), (1, "fingers", ["middle", "index"])]),
        ("tin is already in picks.1", [(1, "objects", None)]),
        ("which is not in styles.side", [(1, "objects", ["cube"])]),
        ("picks.2 has no place", [(2, "place", None)]),
        ("picks.0.chains", [(0, "chains", 0)]),
        ("picks.0.colour", [(0, "colour", "red")]),
        ("at least evaluate.perturbation", [(1, "post", {"width": 0.016, "height": 0.12, "margin": 0.001})]),
    ],
)
def test_what_no_hand_can_do_is_refused_in_one_sentence(
    three, tmp_path, repository, monkeypatch, words, changes
) -> None:
    monkeypatch.chdir(repository)
    content = yaml.safe_load(three.read_text())
    for number, name, value in changes:
        content["picks"][number][name] = value
    (tmp_path / "wrong.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(UserError, match=words) as error:
        read_parameters(tmp_path / "wrong.yaml")
    assert str(error.value).startswith(str(tmp_path / "wrong.yaml")) and "\n" not in str(error.value)


def test_sequences_are_all_or_those_named_in_the_order_of_the_objects() -> None:
    objects = [["a", "b"], ["c"], ["d", "e"]]
    assert sequences(objects, "all", 1) == [("a", "c", "d"), ("a", "c", "e"), ("b", "c", "d"), ("b", "c", "e")]
    assert sequences(objects, [("b", "c", "d"), ("a", "c", "e")], 1) == [("a", "c", "e"), ("b", "c", "d")]
    assert sequences(objects[:2], [("b", "c")], 1) == [("b", "c")]
