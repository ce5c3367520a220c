from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from pipeline.compute.pool import Calls
from pipeline.hand.model import load_hand
from pipeline.model.representation import GraspBatch
from pipeline.records.parameters import read_parameters
from pipeline.records.poses import inverse_pose
from pipeline.sample import proposals
from pipeline.sample.contacts import choose_contacts, choose_fingers
from pipeline.sample.proposals import quality
from pipeline.sample.quality import grasp_distances, nearest_samples, penetration_depth
from pipeline.sample.refinement import PairEnergy, refine
from pipeline.shapes.distance_field import DistanceField
from tests.synthesize import shapes

HAND = load_hand("allegro")


@pytest.fixture(scope="module")
def parameters(repository):
    return read_parameters(repository / "params.yaml").synthesize


@pytest.fixture(scope="module")
def pair(parameters) -> PairEnergy:
    objects = shapes.box("cube"), shapes.cylinder("can")
    return PairEnergy(objects, parameters.energy, (parameters.pinch, parameters.side), clearance=0.001, hand=HAND)


def grasps(count: int, position0, position1, seed: int = 0) -> GraspBatch:
    rng = np.random.default_rng(seed)
    T = np.tile(np.eye(4), (count, 2, 1, 1))
    for slot, position in enumerate((position0, position1)):
        T[:, slot, :3, :3] = Rotation.random(count, rng=rng).as_matrix()
        T[:, slot, :3, 3] = np.asarray(position) + 0.002 * rng.normal(size=(count, 3))
    q = np.clip(rng.normal(0.5, 0.1, (count, 16)), HAND.lower, HAND.upper)
    return GraspBatch(T, q)


def test_a_pair_of_which_no_sample_is_accepted_has_no_figures_of_accepted_ones(monkeypatch):
    """The folder faults/stage-whole-loss: this was a traceback, and the pair took others along."""
    table = pd.DataFrame({"rejected_by": ["penetration"] * 3, "merged_id": range(3)})

    def checking(request, drawn):
        yield Calls(len, [])
        return table

    monkeypatch.setattr(proposals, "checking", checking)
    drawn = SimpleNamespace(ranked=SimpleNamespace(grasps=[1, 2, 3]), joint_violation=np.zeros(3))
    work = proposals.sampling(None, SimpleNamespace())
    next(work)
    work.send([(drawn, {"penetration_mm_median": 1.0})])
    with pytest.raises(StopIteration) as end:
        work.send([])
    assert end.value.value[0] is table
    assert end.value.value[2] == {
        "drawn": 3,
        "joint_violation_mean": 0.0,
        "raw": {"penetration_mm_median": 1.0},
        "ranked": {},
    }


def test_slopes_of_the_objects_overlap_are_those_of_differences(pair):
    """Far from the hand only the overlap changes; all 12 degrees of freedom of the poses are moved one by one."""
    batch = grasps(4, [0.6, 0.0, 0.0], [0.63, 0.0, 0.0])
    contacts = pair.contacts(batch, np.random.default_rng(0))
    bare = pair.settings.model_copy(update={"weight_distance": 0.0, "weight_force_closure": 0.0})
    first, second = (style.model_copy(update={"weight_offset": 0.0}) for style in pair.styles)
    still = PairEnergy(pair.objects, bare, (first, second), pair.clearance, HAND)
    energy, gradient, _, overlap = still.evaluate(batch, contacts)
    assert (overlap > 0.001).all()
    step = 3e-5  # the kernel works in single precision
    for degree in range(12):
        move = np.zeros((4, 28))
        move[:, degree] = step
        forward = still.evaluate(still.moved(batch, move), contacts)[0]
        backward = still.evaluate(still.moved(batch, -move), contacts)[0]
        slope = (forward - backward) / (2 * step)
        # Points near a cell's border or an edge make the energy's slope jump.
        np.testing.assert_allclose(gradient[:, degree], slope, rtol=0.05, atol=0.02 * np.abs(gradient).max())


def test_moves_are_in_the_frames_of_the_objects(pair):
    batch = grasps(1, [0.1, 0.0, 0.0], [0.0, 0.1, 0.0])
    move = np.zeros((1, 28))
    move[0, :3], move[0, 9:12] = [0.01, 0, 0], [0, 0, 0.1]
    moved = pair.moved(batch, move)
    before, after = inverse_pose(batch.T_hand_object[0]), inverse_pose(moved.T_hand_object[0])
    np.testing.assert_allclose(after[0, :3, 3] - before[0, :3, 3], [0.01, 0, 0], atol=1e-12)
    np.testing.assert_allclose(after[1, :3, 3], before[1, :3, 3], atol=1e-12)
    turn = Rotation.from_rotvec([0, 0, 0.1]).as_matrix()
    np.testing.assert_allclose(after[1, :3, :3], before[1, :3, :3] @ turn, atol=1e-12)
    far = pair.moved(batch, np.full((1, 28), 9.0))
    assert (far.q <= HAND.upper).all()


def test_refinement_lowers_the_energy_and_parts_the_objects(pair):
    batch = grasps(6, [0.11, 0.04, 0.03], [0.06, -0.03, -0.02])
    first = refine(pair, batch, 0, 0.002, np.random.default_rng(0))
    after = refine(pair, batch, 60, 0.002, np.random.default_rng(0))
    assert (after.energy < first.energy).mean() > 0.8
    assert np.median(after.energy) < 0.5 * np.median(first.energy)
    assert (after.grasps.q >= HAND.lower).all() and (after.grasps.q <= HAND.upper).all()
    again = refine(pair, batch, 60, 0.002, np.random.default_rng(0))
    np.testing.assert_array_equal(after.grasps.q, again.grasps.q)
    figures = quality(pair, after)
    assert set(figures) == {"penetration_mm_median", "contact_distance_mm_median", "object_overlap_mm_max"}


def test_fingers_that_touch_are_chosen_and_else_the_nearest():
    sets = [("thumb", "index"), ("thumb", "middle"), ("thumb", "index", "middle")]
    nearest = {
        "thumb": np.array([0.001, 0.001, 0.02]),
        "index": np.array([0.002, 0.001, 0.03]),
        "middle": np.array([0.02, 0.003, 0.01]),
    }
    assert choose_fingers(nearest, sets) == [sets[0], sets[2], sets[1]]


def test_contacts_are_near_the_surface_and_belong_to_their_fingers(parameters):
    """A box between thumb and index of the closed hand, then 2 mm farther away."""
    prepared = shapes.box("cube")
    field = DistanceField(prepared)
    batch = grasps(20, [0.1, 0.03, 0.03], [0, 0, 0])
    T = inverse_pose(batch.T_hand_object[:, 0])
    style = parameters.pinch
    found = choose_contacts(HAND, prepared, field, T, batch.q, parameters.energy, style, np.random.default_rng(0))
    owners = np.array(HAND.contact_finger)
    for fingers, candidates, normals in zip(found.fingers, found.candidates, found.normals, strict=True):
        assert list(fingers) in style.finger_sets
        assert set(owners[candidates]) == set(fingers)
        assert len(set(candidates)) == len(candidates) == style.contacts["+".join(fingers)]
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    again = choose_contacts(HAND, prepared, field, T, batch.q, parameters.energy, style, np.random.default_rng(0))
    assert all((a == b).all() for a, b in zip(found.candidates, again.candidates, strict=True))


def test_overlap_of_a_fingertip_is_its_depth():
    prepared = shapes.box("cube")
    field = DistanceField(prepared)
    q = np.zeros((1, 16))
    from pipeline.hand.kinematics import link_poses

    tip = link_poses(HAND, q)[0, HAND.link("link_3.0_tip"), :3, 3]
    T = np.eye(4)
    for gap, expected in ((0.003, 0.0), (-0.004, 0.004)):
        T[:3, 3] = tip + [0.021 + 0.012 + gap, 0, 0]  # the box lies before the fingertip
        depth = penetration_depth(HAND, prepared, field, T[None], q)[0]
        assert abs(depth - expected) < 0.0008


def test_distance_between_grasps_is_that_of_the_hands_seen_from_the_objects():
    batch = grasps(3, [0.1, 0, 0], [0, 0.1, 0])
    moved = GraspBatch(batch.T_hand_object.copy(), batch.q)
    moved.T_hand_object[:, :, :3, 3] += [0.01, 0, 0]  # both objects 1 cm along: every point is 1 cm off
    distances = grasp_distances(HAND, batch, moved)
    np.testing.assert_allclose(np.diag(distances), 0.01, atol=1e-9)
    assert distances.shape == (3, 3)
    np.testing.assert_allclose(np.diag(grasp_distances(HAND, batch, batch)), 0, atol=1e-12)
    figures = nearest_samples(HAND, batch, moved)
    assert figures["grasps"] == 3 and figures["covered"] == 1.0
    assert figures["nearest_mm_median"] == pytest.approx(10.0, abs=1e-3)
