"""Three grasps in one hand, from constructed ones."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.compute.pool import run_one
from pipeline.hand.moves import finger_joints
from pipeline.hand.support import PLANE, Support
from pipeline.merge.search import Inputs, merging
from pipeline.pairing.combination import check_combination
from pipeline.pairing.readiness import ready
from pipeline.pairing.task import Task
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose
from pipeline.records.tables import MERGED, read_table, write_table
from tests.merge.constructed import HAND, box, cylinder, pinch, side

GROUPS = (("thumb", "index"), ("middle", "palm"), ("ring", "palm"))
SMALL = (0.015, 0.03)  # radius and height of what fits beside another one, m


def task(*supports: Support, **settings) -> Task:
    disc = cylinder(*SMALL)
    merge = MergeParameters(**{"physics_test": False, "mount_clearance": -1.0} | settings)
    objects = (box(), replace(disc, name="disc"), replace(disc, name="puck"))
    return Task(HAND, objects, GROUPS, supports or (PLANE,) * 3, merge, PhysicsParameters(), ValidateParameters())


def palm_grasp(finger: str, y: float):
    """A disc before the palm at height ``y`` over the hand's middle, the finger curled around it."""
    ring = side(*SMALL)
    T = inverse_pose(ring.T_object_hand)
    T[1, 3] = y
    q = ring.q.copy()
    q[finger_joints([finger], HAND)] = ring.q[finger_joints(["ring"], HAND)]
    return replace(ring, fingers=(finger, "palm"), T_object_hand=inverse_pose(T), q=q)


def row_of(task: Task, *singles):
    return check_combination(task, [ready(task, number, single) for number, single in enumerate(singles)])


def test_discs_in_one_another_are_refused_and_apart_are_not() -> None:
    near, apart = (row_of(task(), pinch(), palm_grasp("middle", y), palm_grasp("ring", -0.045)) for y in (-0.03, 0.0))
    assert near["rejected_by"] == "object_clearance"
    assert near["object_clearance"] == pytest.approx(0.015 - 0.03, abs=2e-3)
    assert apart["object_clearance"] == pytest.approx(0.045 - 0.03, abs=1e-3)
    assert apart["rejected_by"] != "object_clearance" and apart["hand_clearance"] is not None


def test_an_object_must_not_be_passed_too_closely() -> None:
    """From a post, as a table would be in the way of the ring finger below; the checks go on to the approaches."""
    posts = (PLANE, Support(0.005, 0.2), PLANE)
    chosen = (pinch(), palm_grasp("middle", 0.0), palm_grasp("ring", -0.075))
    free, strict = row_of(task(*posts), *chosen), row_of(task(*posts, approach_clearance=0.1), *chosen)
    assert free["rejected_by"] == "" and free["sweep_penetrations"] == [None, 0, 0] and len(free["open_q"]) == 3
    assert strict["rejected_by"] == "second_approach" and len(strict["open_q"]) == 2


def test_a_finger_of_another_group_is_refused() -> None:
    ring = palm_grasp("ring", -0.045)
    row = row_of(task(), pinch(), ring, ring)
    assert row["rejected_by"] == "fingers" and row["open_q"] == []


def test_rows_fit_the_table_and_no_grasp_is_used_too_often(tmp_path) -> None:
    middles = [replace(palm_grasp("middle", y), grasp_id=index) for index, y in enumerate((0.0, -0.03))]
    grasps = ([pinch()] * 2, middles, [palm_grasp("ring", -0.045)])
    found = {}
    inputs = {"three": Inputs(task(most_per_grasp=1), grasps, np.random.default_rng(0))}
    run_one(merging(inputs, found.__setitem__), 1, "merge")
    table = found["three"]
    assert (table.rejected_by == "").sum() <= 1 and len(table) >= 2
    write_table(tmp_path / "three.parquet", table, MERGED)
    back = read_table(tmp_path / "three.parquet", MERGED, "merge")
    assert back.fingers.iloc[0].tolist() == ["thumb+index", "middle+palm", "ring+palm"]
