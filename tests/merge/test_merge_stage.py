"""The command, in a folder of its own."""

from pathlib import Path

import pandas as pd
import pytest
import yaml

from pipeline.merge import __main__ as stage
from pipeline.records import paths
from pipeline.records.objects import write_prepared_object
from pipeline.records.parameters import read_parameters
from pipeline.records.poses import position_quaternion
from pipeline.records.tables import MERGED, VALIDATED, read_table, write_table
from tests.merge.constructed import box, cylinder, pinch, side


def write_validated(style: str, name: str, grasp, fates: list[str]) -> None:
    position, quaternion = position_quaternion(grasp.T_object_hand)
    row = dict.fromkeys(VALIDATED.names) | {
        "object": name,
        "style": style,
        "fingers": "+".join(grasp.fingers),
        "position_object_hand": position,
        "quaternion_object_hand": quaternion,
        "q": grasp.q,
        "contact_candidates": grasp.contact_candidates,
        "squeeze_q": grasp.squeeze_q,
        "open_q": grasp.open_q,
        "approach_direction": grasp.approach_direction,
    }
    rows = [row | {"grasp_id": index, "rejected_by": fate} for index, fate in enumerate(fates)]
    write_table(paths.validated_file(style, name), pd.DataFrame(rows, dtype=object), VALIDATED)


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    content = yaml.safe_load(Path("params.yaml").read_text())
    content["styles"] = {"pinch": ["box"], "side": ["cylinder"]}
    recipe = {"recipe": "box", "extents": [0.042, 0.042, 0.042]}
    content["objects"] = {"box": recipe, "cylinder": recipe}
    content |= {"renderings": {}, "captures": {}, "reconstructed": {}}
    content["harder"] |= {"pairs": [], "settings": {}}
    content["merge"] |= {"grasps_per_pair": 2, "distinct_distance": 0.0}
    content["compute"]["workers"] = 1
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["merge", "--object", "box"])
    paths.PARAMETERS_FILE.write_text(yaml.safe_dump(content))
    for prepared in (box(), cylinder()):
        write_prepared_object(paths.prepared_folder(prepared.name), prepared)
    write_validated("pinch", "box", pinch(), ["", "gravity:-z", ""])
    write_validated("side", "cylinder", side(), ["", "distance"])
    return tmp_path


def test_command_writes_one_table_per_pair_and_nothing_else(project: Path, capsys: pytest.CaptureFixture) -> None:
    paths.merged_folder("box").mkdir(parents=True)
    paths.merged_file("box", "gone").write_text("of an object that is no longer listed")
    assert stage.main() == 0
    assert [path.name for path in paths.merged_folder("box").iterdir()] == ["cylinder.parquet"]
    table = read_table(paths.merged_file("box", "cylinder"), MERGED, "merge@box")
    assert table.rejected_by.tolist() == ["", ""]
    assert sorted(table.grasp0_id) == [0, 2] and set(table.grasp1_id) == {0}  # rejected grasps are not used
    assert "box then cylinder: 2 accepted of 2 tried" in capsys.readouterr().out
    before = paths.merged_file("box", "cylinder").read_bytes()
    assert stage.main() == 0
    assert paths.merged_file("box", "cylinder").read_bytes() == before


def test_pair_without_grasps_gets_an_empty_table_and_a_warning(project: Path, capsys: pytest.CaptureFixture) -> None:
    write_validated("side", "cylinder", side(), ["gravity:-z"])
    assert stage.main() == 0
    assert len(read_table(paths.merged_file("box", "cylinder"), MERGED, "merge@box")) == 0
    assert "0 of 2 two-object grasps of box then cylinder" in capsys.readouterr().err


def test_an_object_that_is_not_pinched_is_named(
    project: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["merge", "--object", "cylinder"])
    assert stage.main() == 2
    assert "merge@cylinder: params.yaml: styles.pinch does not name 'cylinder'" in capsys.readouterr().err


def test_missing_input_is_one_sentence_and_leaves_the_old_result(project: Path, capsys: pytest.CaptureFixture) -> None:
    assert stage.main() == 0
    before = paths.merged_file("box", "cylinder").read_bytes()
    paths.validated_file("side", "cylinder").unlink()
    capsys.readouterr()
    assert stage.main() == 2
    error = capsys.readouterr().err.strip()
    assert error.count("\n") == 0 and "validate-side@cylinder" in error
    assert paths.merged_file("box", "cylinder").read_bytes() == before


def test_sections_exist(project: Path) -> None:
    parameters = read_parameters()
    for section in stage.sections():
        assert hasattr(parameters, "validate_" if section == "validate" else section)
