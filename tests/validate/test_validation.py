from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.support import PLANE
from pipeline.physics.holding import Holding
from pipeline.physics.table_pick import TablePick
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.robustness import RobustnessParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose, position_quaternion
from pipeline.records.tables import CANDIDATES, VALIDATED, read_table, write_table
from pipeline.robustness.measures import measuring
from pipeline.validate.checks import (
    Candidate,
    assigned_links,
    check_candidate,
    contact_only,
    squeeze_target,
    table_failure,
)
from pipeline.validate.table import candidate_of, validate_table
from tests.physics.test_holding import HAND, clamped_block

SETTINGS = PhysicsParameters()


def nearest_candidate(finger_tip: str, q: np.ndarray, target: np.ndarray) -> int:
    own = np.nonzero(HAND.contact_link == HAND.link(finger_tip))[0]
    points = points_on_links(link_poses(HAND, q[None]), HAND.contact_link[own], HAND.contact_points[own])[0]
    return int(own[np.linalg.norm(points - target, axis=1).argmin()])


def block_grasp() -> tuple[PreparedObject, Candidate]:
    """Index and thumb on opposite faces of a block, as a candidate."""
    q, _, held = clamped_block()
    T, half = held.T_hand_object, held.prepared.extents[0] / 2
    contacts = [
        nearest_candidate("link_3.0_tip", q, T[:3, 3] - half * T[:3, 0]),
        nearest_candidate("link_15.0_tip", q, T[:3, 3] + half * T[:3, 0]),
    ]
    normals = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    fingers = ("thumb", "index")
    return held.prepared, Candidate("pinch", fingers, inverse_pose(T), q, np.array(contacts), normals, HAND)


def rows(prepared: PreparedObject, candidate: Candidate, rejected: list[str]) -> pd.DataFrame:
    position, quaternion = position_quaternion(candidate.T_object_hand)
    row = {
        "object": prepared.name,
        "style": candidate.style,
        "fingers": "+".join(candidate.fingers),
        "position_object_hand": position,
        "quaternion_object_hand": quaternion,
        "q": candidate.q,
        "contact_candidates": candidate.contact_candidates.tolist(),
        "contact_points": [[0.0, 0, 0], [0.0, 0, 0]],
        "contact_normals": candidate.contact_normals.tolist(),
        **{name: 0.0 for name in CANDIDATES.names if name.startswith("energy")},
    }
    return pd.DataFrame([{**row, "grasp_id": index, "rejected_by": reason} for index, reason in enumerate(rejected)])


def test_squeeze_moves_assigned_contacts_along_the_inward_normals() -> None:
    _, candidate = block_grasp()
    squeeze_q = squeeze_target(candidate, 0.005)
    unassigned = list(range(4, 12))
    np.testing.assert_array_equal(squeeze_q[unassigned], candidate.q[unassigned])

    def contacts_in_object(q: np.ndarray) -> np.ndarray:
        own = candidate.contact_candidates
        p = points_on_links(link_poses(HAND, q[None]), HAND.contact_link[own], HAND.contact_points[own])[0]
        return p @ candidate.T_object_hand[:3, :3].T + candidate.T_object_hand[:3, 3]

    moved = contacts_in_object(squeeze_q) - contacts_in_object(candidate.q)
    np.testing.assert_allclose(moved, -0.005 * candidate.contact_normals, atol=1e-3)


def test_good_grasp_passes_everything() -> None:
    prepared, candidate = block_grasp()
    columns = check_candidate(prepared, candidate, SETTINGS, ValidateParameters())
    assert columns["rejected_by"] == ""
    assert columns["contact_only_pass"] is True
    assert len(columns["gravity_drift"]) == 6 and max(columns["gravity_drift"]) < 0.02
    assert columns["table_approach_push"] < 0.005 and columns["table_drift"] < 0.02
    # Both contacts press by 5 mm, and only one side can give way.
    assert 0.0025 < columns["settling_drift"] < 0.0075
    assert np.linalg.norm(columns["approach_direction"]) == pytest.approx(1)


@pytest.mark.parametrize(("single_grasps", "passes"), [(False, True), (True, True), (True, False)])
def test_a_grasp_that_passes_is_measured_and_others_are_not(single_grasps: bool, passes: bool) -> None:
    prepared, candidate = block_grasp()
    settings = RobustnessParameters(single_grasps=single_grasps, ladder=[0.9], conditions=1)
    limits = ValidateParameters(gravity_directions=["-z"], table_test=False, friction=None if passes else 0.0)
    own = measuring(settings, 1, prepared.name)
    columns = check_candidate(prepared, candidate, SETTINGS, limits, measuring=own)
    assert columns["rejected_by"] == ("" if passes else "gravity:-z")
    assert (columns["margin_mass_factor"] is not None) is passes
    assert (columns["lowest_friction"] == 0.9) is (passes and single_grasps)
    assert (columns["robustness"] in (0.0, 1.0)) is (passes and single_grasps)


def test_a_friction_of_the_tests_is_that_of_every_contact() -> None:
    own = ValidateParameters(friction=0.45).for_floating_hand(SETTINGS)
    frictions = {name for name in PhysicsParameters.model_fields if name.endswith("friction")}
    assert {getattr(own, name) for name in frictions} == {0.45} and len(frictions) == 5
    materials = ValidateParameters(friction=None).for_floating_hand(SETTINGS)
    assert all(getattr(materials, name) == getattr(SETTINGS, name) for name in frictions)


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        ({"pinch_squeeze": 0.0, "side_squeeze": 0.0, "gravity_directions": ["+z", "-z"]}, "gravity:+z"),
        ({"rotation_limit": 1e-9, "gravity_directions": ["+y"]}, "gravity:+y"),
        ({"drift_limit": 1e-9, "gravity_directions": ["-z"]}, "gravity:-z"),
    ],
)
def test_bad_grasp_is_rejected_by_name(limits: dict, reason: str) -> None:
    prepared, candidate = block_grasp()
    columns = check_candidate(prepared, candidate, SETTINGS, ValidateParameters(**limits))
    assert columns["rejected_by"] == reason
    assert columns["table_drift"] is None and columns["open_q"] is None
    assert len(columns["gravity_drift"]) == 1


def test_all_checks_run_without_early_rejection() -> None:
    prepared, candidate = block_grasp()
    columns = check_candidate(
        prepared, candidate, SETTINGS, ValidateParameters(pinch_squeeze=0.0, side_squeeze=0.0, early_rejection=False)
    )
    assert columns["rejected_by"].startswith("gravity:")
    assert len(columns["gravity_drift"]) == 6 and columns["table_drift"] is not None
    assert columns["contact_only_pass"] is False


def test_hand_below_the_table_is_rejected_by_the_approach() -> None:
    prepared, candidate = block_grasp()
    raised = replace(prepared, vertices=prepared.vertices + [0, 0, 0.1])  # support plane far above the fingertips
    columns = check_candidate(raised, candidate, SETTINGS, ValidateParameters())
    assert columns["rejected_by"] == "approach"


@pytest.mark.parametrize("slide", [0.021, np.nan])
def test_an_object_that_slides_out_of_a_gentle_squeeze_is_rejected(monkeypatch, slide: float) -> None:  # type: ignore[no-untyped-def]
    prepared, candidate = block_grasp()

    def slid(prepared, T_hand_object, q, squeeze_q, settings, waiting, hand):  # type: ignore[no-untyped-def]
        T = T_hand_object.copy()
        T[0, 3] += slide
        return q, T

    monkeypatch.setattr("pipeline.validate.checks.settle_grasp", slid)
    columns = check_candidate(prepared, candidate, SETTINGS, ValidateParameters(gravity_directions=["-z"]))
    assert columns["rejected_by"] == "settling"
    np.testing.assert_allclose(columns["settling_drift"], slide)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({}, ""),
        ({"push": 0.1, "in_contact": False}, "table:push"),
        ({"touched_support": True, "in_contact": False}, "table:touch"),
        ({"in_contact": False}, "table:drop"),
        ({"drift": 0.03}, "table:drift"),
        ({"rotation": 1.0}, "table:drift"),
        ({"push": np.nan}, "table:push"),
        ({"drift": np.nan}, "table:drift"),
    ],
)
def test_failures_of_the_tabletop_test_are_named_in_order(changes: dict, reason: str) -> None:
    fine = TablePick(push=0.0, touched_support=False, drift=0.0, rotation=0.0, in_contact=True)
    assert table_failure(replace(fine, **changes), ValidateParameters()) == reason


def test_contact_only_rule() -> None:
    held = Holding(
        ("-z", "+z"), np.zeros((2, 1)), np.zeros((2, 1)), np.ones((2, 1), bool), np.ones((2, 1), bool), "", 1
    )
    assert contact_only(held, 2) is True
    assert contact_only(held, 6) is None
    assert contact_only(replace(held, any_contact=np.array([[True], [False]])), 6) is False


def test_assigned_links_of_a_side_grasp() -> None:
    links = assigned_links(HAND, ("ring", "palm"))
    assert "base_link" in links and "link_11.0_tip" in links and "link_3.0_tip" not in links


def test_table_keeps_all_rows_and_reads_back(tmp_path) -> None:  # type: ignore[no-untyped-def]
    prepared, candidate = block_grasp()
    table = rows(prepared, candidate, ["force_closure", "", ""])
    limits = ValidateParameters(most_candidates=1, table_test=False)
    result = validate_table(table.iloc[::-1], prepared, SETTINGS, limits, 1, "test", PLANE, HAND)
    assert result.rejected_by.tolist() == ["force_closure", "", "not_tested"]
    write_table(tmp_path / "v.parquet", result, VALIDATED)
    again = read_table(tmp_path / "v.parquet", VALIDATED, "test")
    assert again.grasp_id.tolist() == [0, 1, 2]
    assert again.squeeze_q[0] is None and len(again.squeeze_q[1]) == 16
    assert again.gravity_in_contact[1].tolist() == [True] * 6
    read = candidate_of(again.loc[1].to_dict(), PLANE, HAND)
    np.testing.assert_allclose(read.T_object_hand, candidate.T_object_hand, atol=1e-12)


def test_result_does_not_depend_on_workers_or_neighbours(tmp_path) -> None:  # type: ignore[no-untyped-def]
    prepared, candidate = block_grasp()
    limits = ValidateParameters(gravity_directions=["-z"], table_test=False)
    for name, reasons, workers in (("a", ["", "", ""], 1), ("b", ["", "", ""], 2)):
        table = rows(prepared, candidate, reasons)
        result = validate_table(table, prepared, SETTINGS, limits, workers, "test", PLANE, HAND)
        write_table(tmp_path / name, result, VALIDATED)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
