import numpy as np
import pytest

from pipeline.records.errors import UserError
from pipeline.records.parameters.train import TrainDataParameters
from pipeline.records.poses import pose_matrix
from pipeline.train.data import gather_examples, held_out_objects
from tests.train.conftest import FIRSTS, SECONDS


def gather(tables, objects, settings, seed=1, **data):
    return gather_examples(tables, objects, TrainDataParameters(**data), settings.encoder, seed)


def test_accepted_rows_become_grasps_of_their_pair(tables, objects, settings):
    examples = gather(tables, objects, settings)
    assert len(examples.grasps) == 4 * 24
    assert examples.objects == ("cube", "can", "slender", "ball")
    assert len(examples.clouds) == 4 * settings.encoder.clouds
    row = tables["ball", "can"].iloc[5]
    found = examples.grasps[np.flatnonzero(examples.pair == examples.pairs.index(("ball", "can")))[5:6]]
    np.testing.assert_allclose(found.q[0], row["q"])
    T = pose_matrix(row["position_hand_object1"], row["quaternion_hand_object1"])
    np.testing.assert_allclose(found.T_hand_object[0, 1], T)


def test_no_training_example_shares_a_held_out_grasp(tables, objects, settings):
    examples = gather(tables, objects, settings, held_out=0.2)
    seen, held = {}, {}
    index = 0
    for (first, second), table in sorted(tables.items(), key=lambda item: examples.pairs.index(item[0])):
        for _, row in table[table["rejected_by"] == ""].iterrows():
            own = {(first, 0, row["grasp0_id"]), (second, 1, row["grasp1_id"])}
            (seen if examples.split[index] == "training" else held)[index] = own
            index += 1
    assert held and seen
    used = set().union(*seen.values())
    assert all(not own <= used for own in held.values())  # each has a part that training never saw
    again = gather(tables, objects, settings, held_out=0.2)
    assert (again.split == examples.split).all()
    assert (gather(tables, objects, settings, seed=2, held_out=0.2).split != examples.split).any()


def test_held_out_pairs_are_never_trained_together(tables, objects, settings):
    examples = gather(tables, objects, settings, held_out=0, held_out_pairs=[["cube", "can"]])
    assert ((examples.split == "held_out_pair") == (examples.pair == examples.pairs.index(("cube", "can")))).all()
    assert set(examples.split) == {"training", "held_out_pair"}


def test_what_cannot_be_learned_from_is_named(tables, objects, settings):
    with pytest.raises(UserError, match="unknown pair \\[cube, cube\\]"):
        gather(tables, objects, settings, held_out_pairs=[["cube", "cube"]])
    with pytest.raises(UserError, match="keeps every grasp from training"):
        gather(tables, objects, settings, held_out_pairs=[[a, b] for a in FIRSTS for b in SECONDS])
    empty = {pair: table[table["rejected_by"] != ""] for pair, table in tables.items()}
    with pytest.raises(UserError, match="no accepted grasp"):
        gather(empty, objects, settings)


def test_a_share_of_objects_is_drawn_one_by_one_and_poses_together():
    names = [f"shop_{number}" for number in range(2000)]
    data = TrainDataParameters(held_out_share=0.3)
    drawn = held_out_objects(names, data, seed=1)
    assert abs(len(drawn) - 600) < 5 * np.sqrt(2000 * 0.3 * 0.7)
    assert held_out_objects(names[:50], data, seed=1) == drawn & set(names[:50])
    assert held_out_objects(names, data, seed=2) != drawn
    poses = {f"{name}_pose2" for name in names}
    assert held_out_objects(poses, data, seed=1) == {f"{name}_pose2" for name in drawn}
    assert held_out_objects(names, TrainDataParameters(), seed=1) == set()


def test_a_source_and_names_are_held_out():
    data = TrainDataParameters(held_out_sources=["ycb"], held_out_objects=["mug"])
    assert held_out_objects(["ycb_mug", "mug", "ycbx", "can"], data, seed=1) == {"ycb_mug", "mug"}
