"""Forward kinematics and Jacobians against two independent implementations and finite differences."""

import numpy as np
import pytest

from pipeline.hand.kinematics import link_poses, point_jacobian, points_on_links
from pipeline.hand.model import load_hand

HAND = load_hand("allegro")


def random_postures(count: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(HAND.lower, HAND.upper, (count, 16))


def test_link_poses_equal_pytorch_kinematics() -> None:
    chains = pytest.importorskip("pytorch_kinematics")
    import torch

    chain = chains.build_chain_from_urdf(HAND.urdf.read_bytes()).to(dtype=torch.float64)
    names = chain.get_joint_parameter_names()
    q = random_postures(20)
    theirs = chain.forward_kinematics(torch.tensor(q[:, [HAND.joint_names.index(name) for name in names]]))
    root = theirs["base_link"].get_matrix().numpy()
    ours = link_poses(HAND, q)
    for link, name in enumerate(HAND.link_names):
        expected = np.linalg.inv(root) @ theirs[name].get_matrix().numpy()
        np.testing.assert_allclose(ours[:, link], expected, atol=2e-7, err_msg=name)


def test_points_on_links_are_transformed_by_their_own_link() -> None:
    q = random_postures(2)
    poses = link_poses(HAND, q)
    links = np.array([0, 7, 20])
    points = np.array([[0.01, 0, 0], [0, 0.02, 0], [0, 0, 0.03]])
    moved = points_on_links(poses, links, points)
    for batch in range(2):
        for index, link in enumerate(links):
            expected = poses[batch, link] @ np.append(points[index], 1)
            np.testing.assert_allclose(moved[batch, index], expected[:3], atol=1e-15)


@pytest.mark.parametrize("name", ["link_3.0_tip", "link_6.0", "link_11.0_tip", "link_12.0", "link_15.0", "base_link"])
def test_point_jacobian_equals_finite_differences(name: str) -> None:
    link, local, step = HAND.link(name), np.array([[0.007, -0.003, 0.011]]), 1e-6
    for q in random_postures(5):

        def position(angles: np.ndarray) -> np.ndarray:
            return points_on_links(link_poses(HAND, angles[None]), np.array([link]), local)[0, 0]

        J = point_jacobian(HAND, link_poses(HAND, q[None])[0], link, position(q))
        numeric = np.stack([(position(q + d) - position(q - d)) / (2 * step) for d in step * np.eye(16)], axis=1)
        np.testing.assert_allclose(J, numeric, atol=1e-8)
