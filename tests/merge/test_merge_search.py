"""Every tried combination keeps its outcome; results are balanced and independent of the number of workers."""

from collections import Counter
from dataclasses import replace
from itertools import combinations

import numpy as np
import pandas as pd
import pytest

from pipeline.compute.pool import run_one
from pipeline.hand.kinematics import link_poses
from pipeline.hand.parts import part_links
from pipeline.merge.search import Inputs, merging, summary
from pipeline.pairing.combination import CHECKS, check_combination
from pipeline.pairing.grasps import distinct_grasps
from pipeline.pairing.readiness import ready
from pipeline.pairing.task import task_of
from pipeline.records.merge_reasons import MergeReason
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.parameters.physics import PhysicsParameters, SapienParameters
from pipeline.records.parameters.robustness import RobustnessParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.tables import MARGINS, MERGED, read_table, write_table
from pipeline.robustness.measures import measuring
from tests.merge.constructed import GROUPS, HAND, box, cylinder, pair, pinch, side
from tests.pairs import PAIR


def row_of(task, *singles):
    return check_combination(task, [ready(task, number, single) for number, single in enumerate(singles)])


def in_hand_at_object_1():
    """A pinch grasp whose object stands where object 1 of the constructed side grasp stands."""
    return replace(pinch(), T_object_hand=side().T_object_hand)


def in_thumb():
    """A side grasp whose object stands in a joint of the thumb."""
    T = side().T_object_hand.copy()
    T[:3, 3] = -T[:3, :3] @ link_poses(HAND, pinch().q[None])[0, HAND.link("link_14.0"), :3, 3]
    return replace(side(), T_object_hand=T)


def with_mount_low():
    """A side grasp held so low that the flange is in the support."""
    T = side().T_object_hand.copy()
    T[2, 3] -= 0.03
    return replace(side(), T_object_hand=T)


@pytest.mark.parametrize(
    ("first", "second", "outcome"),
    [
        (pinch(), side(), ""),
        (replace(pinch(), fingers=("thumb", "ring")), side(), "fingers"),
        (in_hand_at_object_1(), side(), "object_clearance"),
        (pinch(), in_thumb(), "hand_clearance"),
        (pinch(), with_mount_low(), "mount_clearance"),
        (replace(pinch(), squeeze_q=pinch().q), side(), "gravity"),
    ],
)
def test_outcome_of_a_combination(first, second, outcome: str) -> None:
    row = row_of(pair(), first, second)
    assert row["rejected_by"] == outcome and outcome in ["", *MergeReason]
    assert set(row) == set(MERGED.names)
    if outcome == "":
        assert row["object_clearance"] > 0 and row["sweep_penetrations"] == [None, 0]
        assert max(row["gravity_drift"]) < 0.02 and len(row["gravity_drift"]) == 6


def several(count: int):
    """The constructed grasps under several names, every third one with a mount in the support."""
    firsts = [replace(pinch(), grasp_id=index) for index in range(count)]
    seconds = [replace(with_mount_low() if index % 3 == 2 else side(), grasp_id=index) for index in range(count)]
    return firsts, seconds


def tables_of(inputs: dict[str, Inputs], workers: int) -> dict[str, pd.DataFrame]:
    tables: dict[str, pd.DataFrame] = {}
    run_one(merging(inputs, tables.__setitem__), workers, "merge")
    return tables


def all_merged(
    workers: int, seconds: dict, measured: RobustnessParameters | None = None, **settings
) -> dict[str, pd.DataFrame]:
    settings = {"grasps_per_pair": 6, "most_per_grasp": 2, "distinct_distance": 0.0, "physics_test": False} | settings
    firsts, _ = several(6)
    task = replace(pair(**settings), measuring=measured and measuring(measured, 1, "box", "can"))
    inputs = {
        name: Inputs(
            replace(task, objects=(box(), replace(cylinder(), name=name))),
            (firsts, own),
            np.random.default_rng(4 + len(name)),
        )
        for name, own in seconds.items()
    }
    return tables_of(inputs, workers)


def merged(workers: int, **settings) -> pd.DataFrame:
    return all_merged(workers, {"can": several(6)[1]}, **settings)["can"]


def test_settling_is_a_test_with_a_floating_hand() -> None:
    physics = PhysicsParameters(sapien=SapienParameters(contact_offset=0.03))
    validate = ValidateParameters(sapien_contact_offset=0.004, friction=None)

    def task(physics_test: bool):
        merge = MergeParameters(physics_test=physics_test)
        return task_of(HAND, PAIR, (box(), cylinder()), merge, physics, validate)

    assert task(physics_test=False).settling_physics is None
    assert task(physics_test=True).settling_physics == PhysicsParameters(sapien=SapienParameters(contact_offset=0.004))


def test_wanted_number_is_reached_balanced_and_without_repetition() -> None:
    table = merged(1)
    accepted = table[table.rejected_by == ""]
    assert len(accepted) == 6
    assert table.merged_id.tolist() == list(range(len(table)))
    assert not table.grasp_ids.map(tuple).duplicated().any()
    for ids in zip(*accepted.grasp_ids, strict=True):
        assert max(Counter(ids).values()) <= 2
    assert (table[table.grasp_ids.map(lambda ids: ids[1] % 3 == 2)].rejected_by == "mount_clearance").all()
    assert "6 accepted" in summary(table) and "mount_clearance" in summary(table)


def test_result_does_not_depend_on_workers(tmp_path) -> None:
    for workers in (1, 2):
        write_table(tmp_path / f"{workers}.parquet", merged(workers, physics_test=True), MERGED)
    assert (tmp_path / "1.parquet").read_bytes() == (tmp_path / "2.parquet").read_bytes()
    back = read_table(tmp_path / "1.parquet", MERGED, "merge")
    assert len(back) > 6 and all(len(own) < 2 for own in back[back.rejected_by != ""].open_q)


def test_the_first_accepted_grasps_are_measured() -> None:
    none, some, every = (
        merged(1, measured=measured)
        for measured in (None, RobustnessParameters(merged_grasps=2), RobustnessParameters(merged_grasps=None))
    )
    accepted = every.index[every.rejected_by == ""]
    measures = [f"{name}s" for name in MARGINS.names]
    assert every.loc[accepted, measures].notna().all(axis=None) and every.drop(accepted)[measures].isna().all(axis=None)
    pd.testing.assert_frame_equal(some.loc[accepted[:2]], every.loc[accepted[:2]])
    assert some.drop(accepted[:2])[measures].isna().all(axis=None) and none[measures].isna().all(axis=None)
    pd.testing.assert_frame_equal(some.drop(columns=measures), every.drop(columns=measures))


def test_limits_end_the_search() -> None:
    assert len(merged(1, most_combinations=5)) == 5
    few = merged(1, grasps_per_pair=40)  # 4 usable side grasps, twice each
    assert (few.rejected_by == "").sum() == 8
    nothing = tables_of({"can": Inputs(pair(physics_test=False), ([], [side()]), np.random.default_rng(0))}, 1)["can"]
    assert len(nothing) == 0 and list(nothing.columns) == MERGED.names
    assert summary(nothing) == "0 accepted of 0 tried"


def hand_around_object(single) -> np.ndarray:
    """Positions, object frame, of the links that a merged grasp takes from a single one."""
    ring = part_links(["ring"], HAND)
    own = [name for name in HAND.link_names if ("ring" in single.fingers) == (name in ring) or name == "base_link"]
    T = single.T_object_hand @ link_poses(HAND, single.q[None])[0, [HAND.link(name) for name in own]]
    return T[:, :3, 3]


def test_merged_grasps_are_distinct() -> None:
    """Single grasps 1.1 mm apart: whatever two merged grasps share one half of differs by 3 mm in the other."""

    def shifted(single, index: int):
        T = single.T_object_hand.copy()
        T[0, 3] += 0.0011 * index
        return replace(single, grasp_id=index, T_object_hand=T)

    firsts = distinct_grasps(HAND, [shifted(pinch(), index) for index in range(7)], GROUPS, 0, 0.003)
    seconds = distinct_grasps(HAND, [shifted(side(), index) for index in range(7)], GROUPS, 1, 0.003)
    settings = {"grasps_per_pair": 9, "most_per_grasp": 3, "clearance": -1.0, "penetration_tolerance": 1.0}
    chosen = pair(**settings, mount_clearance=-1.0, physics_test=False)
    table = tables_of({"can": Inputs(chosen, (firsts, seconds), np.random.default_rng(0))}, 1)["can"]
    assert (table.rejected_by == "").all() and len(table) == 9
    of_id = [{single.grasp_id: hand_around_object(single) for single in singles} for singles in (firsts, seconds)]
    halves = [(of_id[0][a], of_id[1][b]) for a, b in table.grasp_ids]
    for one, other in combinations(halves, 2):
        apart = [np.linalg.norm(a - b, axis=1).mean() for a, b in zip(one, other, strict=True)]
        assert max(apart) >= 0.003 - 1e-9


def test_a_pair_does_not_depend_on_its_neighbours() -> None:
    seconds = several(6)[1]
    beside = all_merged(1, {"can": seconds, "empty": [], "bottle": seconds[:2]}, grasps_per_pair=4)
    alone = all_merged(1, {"can": seconds}, grasps_per_pair=4)["can"]
    pd.testing.assert_frame_equal(beside["can"], alone)
    assert len(beside["empty"]) == 0 and (beside["bottle"].rejected_by == "").sum() == 4


def test_reasons_come_in_the_order_of_the_checks() -> None:
    """A new check is a function in ``CHECKS``: what fails several checks is rejected by the first."""
    task = pair(physics_test=False)
    assert row_of(task, in_hand_at_object_1(), with_mount_low())["rejected_by"] == "object_clearance"
    assert len(CHECKS) == len(set(CHECKS)) and all(reason.meaning for reason in MergeReason)
