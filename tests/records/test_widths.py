"""Tables of two-object grasps and trials have room for the joints of the hand and the robot as they are described."""

from pipeline.hand.model import load_hand
from pipeline.hand.robot import robot_joint_names
from pipeline.records.hands import ALLEGRO
from pipeline.records.tables import CANDIDATES, MERGED, TRIALS


def test_vectors_are_as_long_as_the_hand_and_the_robot_have_joints():
    hand = load_hand(ALLEGRO)
    joints, all_joints = len(hand.joint_names), len(robot_joint_names(hand))
    assert CANDIDATES.field("q").type.list_size == joints
    assert MERGED.field("q").type.list_size == MERGED.field("squeeze_q").type.list_size == joints
    assert MERGED.field("open_q").type.value_type.list_size == joints
    assert TRIALS.field("snapshot_robot_q").type.value_type.list_size == all_joints
