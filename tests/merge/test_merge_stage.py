"""The command, in a folder of its own."""

import dataclasses
from pathlib import Path

import pandas as pd
import pytest
import yaml

from pipeline.merge import __main__ as stage
from pipeline.records import paths
from pipeline.records.objects import write_prepared_object
from pipeline.records.poses import position_quaternion
from pipeline.records.tables import MERGED, VALIDATED, read_table, rows_of, write_table
from tests.merge.constructed import box, cylinder, pinch, side


def write_validated(style: str, name: str, grasp, outcomes: list[str]) -> None:
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
    rows = [row | {"grasp_id": index, "rejected_by": outcome} for index, outcome in enumerate(outcomes)]
    write_table(paths.validated_file(style, name), pd.DataFrame(rows, dtype=object), VALIDATED)


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    content = yaml.safe_load(Path("params.yaml").read_text())
    content["styles"] = {"pinch": ["box"], "side": ["cylinder"]}
    recipe = {"recipe": "box", "extents": [0.042, 0.042, 0.042]}
    content["objects"] = {"box": recipe, "cylinder": recipe}
    content |= {"renderings": {}, "captures": {}, "reconstructed": {}}
    content["conditions"] |= {"pairs": [], "settings": {}}
    content["merge"] |= {"grasps_per_pair": 2, "distinct_distance": 0.0}
    content["robustness"] |= {"ladder": [0.9, 0.01], "conditions": 2}
    content["compute"]["workers"] = 1
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["merge", "--object", "box"])
    paths.PARAMETERS_FILE.write_text(yaml.safe_dump(content))
    for prepared in (box(), cylinder()):
        write_prepared_object(paths.prepared_folder(prepared.name), prepared)
    write_validated("pinch", "box", pinch(), ["", "gravity:-z", ""])
    write_validated("side", "cylinder", side(), ["", "distance"])
    return tmp_path


def test_command_writes_one_table_for_its_object_and_leaves_others(
    project: Path, capsys: pytest.CaptureFixture
) -> None:
    paths.merged_file("other").parent.mkdir(parents=True)
    paths.merged_file("other").write_text("of another object")
    assert stage.main() == 0
    assert sorted(path.name for path in paths.merged_file("").parent.iterdir()) == ["box.parquet", "other.parquet"]
    table = read_table(paths.merged_file("box"), MERGED, "merge")
    assert {tuple(names) for names in table.objects} == {("box", "cylinder")}
    assert table.rejected_by.tolist() == ["", ""]
    assert sorted(map(tuple, table.grasp_ids)) == [(0, 0), (2, 0)]  # rejected grasps are not used
    for row in table.itertuples():
        assert len(row.margin_mass_factors) == 2 and all(value >= 0 for value in row.margin_push_forces)
        assert row.lowest_friction == 0.9  # nothing holds at 0.01
        assert row.robustness in (0.0, 0.5, 1.0) and row.robustness_low <= row.robustness <= row.robustness_high
    assert "box then cylinder: 2 accepted of 2 tried" in capsys.readouterr().out
    before = paths.merged_file("box").read_bytes()
    assert stage.main() == 0
    assert paths.merged_file("box").read_bytes() == before


def test_pairs_are_those_of_the_parameters_in_their_order(project: Path) -> None:
    content = yaml.safe_load(paths.PARAMETERS_FILE.read_text())
    content["objects"] |= dict.fromkeys(("first", "left_out"), content["objects"]["box"])
    content["styles"]["side"] = ["first", "left_out", "cylinder"]
    content["pairs"] = [["box", "cylinder"], ["box", "first"]]
    paths.PARAMETERS_FILE.write_text(yaml.safe_dump(content))
    write_prepared_object(paths.prepared_folder("first"), dataclasses.replace(cylinder(), name="first"))
    write_validated("side", "first", side(), ["", ""])
    assert stage.main() == 0
    table = read_table(paths.merged_file("box"), MERGED, "merge")
    assert list(dict.fromkeys(second for _, second in table.objects)) == ["first", "cylinder"]
    # Whichever pairs are searched beside it, a pair has the same rows.
    content["pairs"] = [["box", "cylinder"]]
    paths.PARAMETERS_FILE.write_text(yaml.safe_dump(content))
    assert stage.main() == 0
    alone = read_table(paths.merged_file("box"), MERGED, "merge")
    pd.testing.assert_frame_equal(alone, rows_of(table, ("box", "cylinder")))


def test_pair_without_grasps_gets_an_empty_table_and_a_warning(project: Path, capsys: pytest.CaptureFixture) -> None:
    write_validated("side", "cylinder", side(), ["gravity:-z"])
    assert stage.main() == 0
    assert len(read_table(paths.merged_file("box"), MERGED, "merge")) == 0
    assert "0 of 2 grasps of box then cylinder" in capsys.readouterr().err


def test_an_object_that_is_not_pinched_is_named(
    project: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["merge", "--object", "cylinder"])
    assert stage.main() == 2
    assert "merge: params.yaml: styles.pinch does not list 'cylinder'" in capsys.readouterr().err


def test_missing_input_is_one_sentence_and_leaves_the_old_result(project: Path, capsys: pytest.CaptureFixture) -> None:
    assert stage.main() == 0
    before = paths.merged_file("box").read_bytes()
    paths.validated_file("side", "cylinder").unlink()
    capsys.readouterr()
    assert stage.main() == 2
    error = capsys.readouterr().err.strip()
    assert error.count("\n") == 0 and "validate@side" in error
    assert paths.merged_file("box").read_bytes() == before
