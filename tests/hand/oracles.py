"""Where links are and how they move, by implementations that share nothing with the project's kinematics."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from pipeline.hand.kinematics import link_poses, point_jacobian
from pipeline.hand.model import Hand

LOCAL = np.array([0.007, -0.003, 0.011])  # m, a point of every link


def coupled_positions(text: str | bytes, hand: Hand, q: np.ndarray) -> tuple[dict[str, float], np.ndarray, list[str]]:
    """Return positions of all joints of a URDF by its own `mimic`, and their derivatives (P, J) by ``q`` (J,)."""
    joints = {joint.get("name", ""): joint for joint in ElementTree.fromstring(text).iter("joint")}
    values, slopes = {}, {}

    def place(name: str) -> tuple[float, np.ndarray]:
        mimic = joints[name].find("mimic")
        if mimic is None:
            index = hand.joint_names.index(name)
            return float(q[index]), np.eye(hand.joint_count)[index]
        value, slope = place(mimic.get("joint", ""))
        multiplier = float(mimic.get("multiplier", "1"))
        return multiplier * value + float(mimic.get("offset", "0")), multiplier * slope

    names = [name for name in hand.physical.names if name in joints]
    for name in names:
        values[name], slopes[name] = place(name)
    return values, np.array([slopes[name] for name in names]), names


def pytorch_errors(hand: Hand, text: str | bytes, rows: int = 5) -> tuple[float, float]:
    """Return the largest error of link poses (m, or of a rotation's entries) and of Jacobians (m/rad) of a URDF."""
    import pytorch_kinematics
    import torch

    chain = pytorch_kinematics.build_chain_from_urdf(text).to(dtype=torch.float64)
    order = chain.get_joint_parameter_names()
    rng, worst, worst_slope = np.random.default_rng(3), 0.0, 0.0
    for q in rng.uniform(hand.lower, hand.upper, (rows, hand.joint_count)):
        values, slopes, names = coupled_positions(text, hand, q)
        given = torch.tensor([values.get(name, 0.0) for name in order], dtype=torch.float64, requires_grad=True)
        theirs = chain.forward_kinematics(given[None])
        root = torch.linalg.inv(theirs[hand.root].get_matrix()[0])
        ours = link_poses(hand, q[None])[0]
        for index, name in enumerate(hand.link_names):
            pose = root @ theirs[name].get_matrix()[0]
            worst = max(worst, float(np.abs(pose.detach().numpy() - ours[index]).max()))
            point = pose[:3, :3] @ torch.tensor(LOCAL) + pose[:3, 3]
            point = point + 0.0 * given.sum()  # of the root nothing depends on the joints
            slopes_of = [torch.autograd.grad(x, given, retain_graph=True)[0] for x in point]
            full = np.array([row.numpy() for row in slopes_of])
            expected = full[:, [order.index(name) for name in names]] @ slopes
            found = point_jacobian(hand, ours, index, ours[index, :3, :3] @ LOCAL + ours[index, :3, 3])
            worst_slope = max(worst_slope, float(np.abs(found - expected).max()))
    return worst, worst_slope


def mujoco_errors(hand: Hand, file: Path, rows: int = 5) -> tuple[float, float]:
    """Return the same of an MJCF, whose joints MuJoCo places; joints that follow are placed by the hand's couplings."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    rng, worst, worst_slope = np.random.default_rng(4), 0.0, 0.0
    joints = [model.joint(name) for name in hand.physical.names]
    for q in rng.uniform(hand.lower, hand.upper, (rows, hand.joint_count)):
        mujoco.mj_resetData(model, data)
        for joint, value in zip(joints, hand.physical.positions(q), strict=True):
            data.qpos[joint.qposadr[0]] = value
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        root = data.body(hand.root)
        R, ours = root.xmat.reshape(3, 3), link_poses(hand, q[None])[0]
        for index, name in enumerate(hand.link_names):
            if ":" in name:  # a link that the reader put between two bodies
                continue
            body = data.body(name)
            rotation, position = R.T @ body.xmat.reshape(3, 3), R.T @ (body.xpos - root.xpos)
            error = max(np.abs(rotation - ours[index, :3, :3]).max(), np.abs(position - ours[index, :3, 3]).max())
            worst = max(worst, float(error))
            J, turning = np.zeros((3, model.nv)), np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, J, turning, body.xpos + body.xmat.reshape(3, 3) @ LOCAL, body.id)
            expected = np.zeros((3, hand.joint_count))
            for joint, driver, gain in zip(joints, hand.physical.driver, hand.physical.multiplier, strict=True):
                expected[:, driver] += gain * (R.T @ J[:, joint.dofadr[0]])
            found = point_jacobian(hand, ours, index, ours[index, :3, :3] @ LOCAL + ours[index, :3, 3])
            worst_slope = max(worst_slope, float(np.abs(found - expected).max()))
    return worst, worst_slope
