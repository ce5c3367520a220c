import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.spatial.transform import Rotation

from pipeline.records.poses import inverse_pose, pose_matrix, position_quaternion, transform_points


@pytest.fixture
def random_poses():
    rng = np.random.default_rng(3)
    return rng.normal(size=(50, 3)), rng.normal(size=(50, 4))


def scipy_matrix(quaternion):
    return Rotation.from_quat(quaternion, scalar_first=True).as_matrix()


def test_pose_matrix_agrees_with_scipy(random_poses):
    position, quaternion = random_poses
    T = pose_matrix(position, quaternion)
    np.testing.assert_allclose(T[:, :3, :3], scipy_matrix(quaternion), atol=1e-14)
    np.testing.assert_array_equal(T[:, :3, 3], position)
    np.testing.assert_array_equal(T[:, 3], np.tile([0, 0, 0, 1.0], (50, 1)))


def test_known_quarter_turn():
    T = pose_matrix([1.0, 2.0, 3.0], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # 90 degrees about z
    np.testing.assert_allclose(transform_points(T, [[1.0, 0, 0]]), [[1.0, 3.0, 3.0]], atol=1e-15)


def test_round_trip_keeps_pose_and_picks_one_sign(random_poses):
    position, quaternion = random_poses
    p, q = position_quaternion(pose_matrix(position, quaternion))
    np.testing.assert_allclose(p, position)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1, atol=1e-12)
    assert (q[:, 0] >= 0).all()
    np.testing.assert_allclose(scipy_matrix(q), scipy_matrix(quaternion), atol=1e-12)


def test_inverse_undoes(random_poses):
    T = pose_matrix(*random_poses)
    np.testing.assert_allclose(inverse_pose(T) @ T, np.broadcast_to(np.eye(4), T.shape), atol=1e-12)
    np.testing.assert_allclose(inverse_pose(T), np.linalg.inv(T), atol=1e-12)


def test_points_are_mapped_per_pose(random_poses):
    position, quaternion = random_poses
    points = np.random.default_rng(4).normal(size=(50, 7, 3))
    expected = np.stack(
        [Rotation.from_quat(q, scalar_first=True).apply(x) + p for p, q, x in zip(*random_poses, points, strict=True)]
    )
    np.testing.assert_allclose(transform_points(pose_matrix(position, quaternion), points), expected, atol=1e-12)


@given(
    arrays.arrays(np.float64, 4, elements=st.floats(-5, 5)).filter(lambda q: np.linalg.norm(q) > 1e-3),
    arrays.arrays(np.float64, 3, elements=st.floats(-2, 2)),
)
def test_every_matrix_is_a_rigid_transform(quaternion, position):
    R = pose_matrix(position, quaternion)[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)
