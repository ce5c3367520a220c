"""Which fingers hold which object, as data."""

from pathlib import Path

import pytest
import yaml

from pipeline.hand.support import PLANE, Support
from pipeline.records.errors import UserError
from pipeline.records.parameters import read_parameters
from pipeline.records.parameters.several import SeveralParameters, read_sequence
from pipeline.several.demonstration import main
from pipeline.several.singles import style_of, support_of

THREE = Path(__file__).resolve().parents[2] / "conf" / "several" / "three.yaml"


def changed(path: Path, *changes: tuple[int, str, object]) -> Path:
    content = yaml.safe_load(THREE.read_text())
    for number, name, value in changes:
        content["picks"][number][name] = value
    path.write_text(yaml.safe_dump(content))
    return path


def test_three_objects_share_the_palm_and_no_finger() -> None:
    sequence = read_sequence(THREE)
    assert [pick.fingers for pick in sequence.picks] == [["thumb", "index"], ["middle", "palm"], ["ring", "palm"]]
    assert sequence.trials >= 25


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((2, "fingers", ["middle", "palm"]), "the middle finger is named twice"),
        ((1, "fingers", ["thumb", "palm"]), "the thumb"),
        ((0, "style", "side"), "against the palm"),
        ((2, "name", "puck"), "the same name"),
        ((0, "chains", 0), "picks.0.chains"),
        ((0, "colour", "red"), "picks.0.colour"),
    ],
)
def test_what_no_hand_can_do_is_refused_in_one_sentence(tmp_path, change, words: str) -> None:
    with pytest.raises(UserError, match=words) as error:
        read_sequence(changed(tmp_path / "wrong.yaml", change))
    assert str(error.value).startswith(str(tmp_path / "wrong.yaml")) and "\n" not in str(error.value)


def test_command_says_what_is_missing(tmp_path, monkeypatch, capsys, repository) -> None:
    monkeypatch.chdir(repository)
    assert main(["--sequence", str(tmp_path / "nothing.yaml"), "--output", str(tmp_path / "out")]) == 2
    assert "nothing.yaml is missing" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_heights_of_a_style_count_from_the_plane_under_the_post(repository, monkeypatch) -> None:
    monkeypatch.chdir(repository)
    sequence, base = read_sequence(THREE), read_parameters().synthesize.side
    cube, puck, tin = sequence.picks
    assert support_of(cube, 0.005) == support_of(tin, 0.005) == PLANE
    post = support_of(puck, 0.005)
    assert post == Support(puck.post.width / 2 + 0.005, puck.post.height)
    style = style_of(puck, post, base)
    assert style.table_clearance == pytest.approx(base.table_clearance - puck.post.height)
    assert style.mount_clearance == pytest.approx(base.mount_clearance - puck.post.height)
    assert style.finger_sets == [["middle", "palm"]] and style.contacts == {"middle+palm": 2}
    assert style_of(tin, PLANE, base).table_clearance == base.table_clearance


def test_two_objects_are_a_sequence_too() -> None:
    content = yaml.safe_load(THREE.read_text())
    content["picks"] = [content["picks"][0] | {"fingers": ["thumb", "index", "middle"]}, content["picks"][2]]
    assert len(SeveralParameters.model_validate(content).picks) == 2
