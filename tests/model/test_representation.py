import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pipeline.hand.model import load_hand
from pipeline.model.representation import (
    GraspBatch,
    fit_normalisation,
    from_vectors,
    joint_violation,
    nearest_rotation,
    to_vectors,
    turn_objects,
)
from pipeline.records.poses import transform_points

HAND = load_hand("allegro")


def random_grasps(count: int, seed: int = 0) -> GraspBatch:
    rng = np.random.default_rng(seed)
    T = np.zeros((count, 2, 4, 4))
    T[..., 3, 3] = 1
    T[..., :3, :3] = Rotation.random(2 * count, rng=rng).as_matrix().reshape(count, 2, 3, 3)
    T[..., :3, 3] = rng.normal(size=(count, 2, 3))
    return GraspBatch(T, rng.uniform(HAND.lower, HAND.upper, (count, 16)))


def test_a_grasp_survives_the_way_to_numbers_and_back():
    grasps = random_grasps(20)
    vectors = to_vectors(HAND, grasps)
    assert vectors.shape == (20, 40)
    normalisation = fit_normalisation(vectors, True)
    normal = normalisation.apply(vectors)
    np.testing.assert_allclose(normal.mean(0), 0, atol=1e-12)
    np.testing.assert_allclose(normal.std(0), 1, atol=1e-12)
    back = from_vectors(HAND, normalisation.undo(normal))
    np.testing.assert_allclose(back.T_hand_object, grasps.T_hand_object, atol=1e-9)
    np.testing.assert_allclose(back.q, grasps.q, atol=1e-9)


def test_joint_limits_are_one_and_what_is_beyond_is_measured_and_clamped():
    low, high = (GraspBatch(random_grasps(1).T_hand_object, limit[None]) for limit in (HAND.lower, HAND.upper))
    np.testing.assert_allclose(to_vectors(HAND, low)[0, 24:], -1)
    vectors = to_vectors(HAND, high)
    np.testing.assert_allclose(vectors[0, 24:], 1)
    assert joint_violation(vectors, HAND).max() < 1e-12
    vectors[0, 24] += 0.1
    np.testing.assert_allclose(joint_violation(vectors, HAND)[0, 0], 0.1 * (HAND.upper[0] - HAND.lower[0]) / 2)
    np.testing.assert_allclose(from_vectors(HAND, vectors).q[0], HAND.upper)


@given(st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_no_rotation_is_nearer_than_the_nearest(seed):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(3, 3))
    found = nearest_rotation(matrix)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(found), 1)
    # Small turns about the answer and rotations from anywhere else are farther from the matrix.
    near = found @ Rotation.from_rotvec(0.05 * rng.normal(size=(100, 3))).as_matrix()
    others = np.concatenate([near, Rotation.random(100, rng=rng).as_matrix()])
    assert (np.linalg.norm(others - matrix, axis=(1, 2)) >= np.linalg.norm(found - matrix) - 1e-12).all()


def test_turned_object_frames_leave_every_point_where_it_is():
    """The object's points and the pose turn together: a pose multiplied from the wrong side would move them."""
    grasps = random_grasps(5)
    rng = np.random.default_rng(1)
    points, angles = rng.normal(size=(7, 3)), rng.uniform(-3, 3, (5, 2))
    turned = turn_objects(grasps, angles)
    for index in range(5):
        for slot in (0, 1):
            turn = Rotation.from_euler("z", angles[index, slot]).as_matrix()
            np.testing.assert_allclose(
                transform_points(turned.T_hand_object[index, slot], points @ turn.T),
                transform_points(grasps.T_hand_object[index, slot], points),
                atol=1e-12,
            )
    assert turned.q is grasps.q
