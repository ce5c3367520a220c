"""Three grasps in one hand, from constructed ones."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.hand.moves import finger_joints
from pipeline.hand.support import PLANE, Support
from pipeline.pairing.combination import Task, check_combination
from pipeline.pairing.readiness import ReadyFirst, as_synthesized, ready_first
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.several import SeveralParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose
from pipeline.records.tables import JOINED, read_table, write_table
from pipeline.several.joining import join_all, joined_row
from tests.merge.constructed import box, cylinder, pinch, side

GROUPS = (("thumb", "index"), ("middle", "palm"), ("ring", "palm"))
SMALL = (0.015, 0.03)  # radius and height of what fits beside another one, m


def task() -> Task:
    disc = cylinder(*SMALL)
    settings = MergeParameters(physics_test=False, mount_clearance=-1.0)
    return Task((box(), disc, disc), GROUPS, (PLANE,) * 3, settings, PhysicsParameters(), ValidateParameters())


def palm_grasp(finger: str, y: float):
    """A disc before the palm at height ``y`` over the hand's middle, the finger curled around it."""
    ring = side(*SMALL)
    T = inverse_pose(ring.T_object_hand)
    T[1, 3] = y
    q = ring.q.copy()
    q[finger_joints([finger])] = ring.q[finger_joints(["ring"])]
    return replace(ring, fingers=(finger, "palm"), T_object_hand=inverse_pose(T), q=q)


def first() -> ReadyFirst:
    return ready_first(box(), None, pinch(), ("middle", "ring"))


def test_discs_in_one_another_are_refused_and_apart_are_not() -> None:
    def verdict(y: float):
        chosen = [first(), as_synthesized(palm_grasp("middle", y)), as_synthesized(palm_grasp("ring", -0.045))]
        return check_combination(task(), chosen)

    near, apart = verdict(-0.03), verdict(0.0)
    assert near.rejected_by == "object_clearance" and near.object_clearance == pytest.approx(0.015 - 0.03, abs=2e-3)
    assert apart.object_clearance == pytest.approx(0.045 - 0.03, abs=1e-3)
    assert apart.rejected_by != "object_clearance" and apart.hand_clearance is not None


def test_an_object_must_not_be_passed_too_closely() -> None:
    """From a post, as a table would be in the way of the ring finger below; the checks go on to the approaches."""
    posts = (PLANE, Support(0.005, 0.2), PLANE)
    chosen = [first(), as_synthesized(palm_grasp("middle", 0.0)), as_synthesized(palm_grasp("ring", -0.075))]
    free = check_combination(replace(task(), supports=posts), chosen)
    strict = check_combination(replace(task(), supports=posts, approach_clearance=0.1), chosen)
    assert free.rejected_by == "" and free.sweep_penetrations == [0, 0] and len(free.open_q) == 3
    assert strict.rejected_by == "second_approach" and len(strict.open_q) == 2


def test_a_finger_of_another_group_is_refused() -> None:
    ring = as_synthesized(palm_grasp("ring", -0.045))
    verdict = check_combination(task(), [first(), ring, ring])
    assert verdict.rejected_by == "fingers" and verdict.open_q == []


def test_rows_fit_their_table_and_no_grasp_is_used_too_often(tmp_path) -> None:
    sequence = SeveralParameters.model_validate(
        {
            "seed": 1,
            "grasps": 50,
            "most_per_grasp": 1,
            "picks": [
                {
                    "name": name,
                    "shape": {"recipe": "box", "extents": [0.04, 0.04, 0.04]},
                    "style": style,
                    "fingers": list(fingers),
                    "place": [0.5, 0.0],
                }
                for name, style, fingers in zip("abc", ("pinch", "side", "side"), GROUPS, strict=True)
            ],
        }
    )
    ready = [
        [first()] * 2,
        [as_synthesized(replace(palm_grasp("middle", y), grasp_id=index)) for index, y in enumerate((0.0, -0.03))],
        [as_synthesized(palm_grasp("ring", -0.045))],
    ]
    table = join_all(task(), ready, sequence, np.random.default_rng(0), 1)
    accepted = table[table.rejected_by == ""]
    assert len(accepted) <= 1 and len(table) >= 2
    write_table(tmp_path / "joined.parquet", table, JOINED)
    back = read_table(tmp_path / "joined.parquet", JOINED, "several")
    assert back.fingers.iloc[0].tolist() == ["thumb+index", "middle+palm", "ring+palm"]
    row = joined_row(task(), check_combination(task(), [own[0] for own in ready]))
    assert set(row) | {"merged_id"} == set(JOINED.names)
