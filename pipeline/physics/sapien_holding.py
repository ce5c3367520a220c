"""The six-gravity holding test of many grasps at once in one PhysX scene on a CUDA device.

Not tested on a GPU: written against SAPIEN's interface as ManiSkill uses it. What does not need one is shared with the
CPU and tested there: rigs and verdicts (``physics.holding``). One scene has one gravity, so every rig is turned until
the tested direction points down. PhysX on a GPU neither repeats bit for bit nor agrees with the CPU, and nothing ends
early within a direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sapien import physx

from pipeline.physics.engine import GRAVITY, steps_in
from pipeline.physics.holding import HeldGrasp, Holding, Outcome, gravity_vector, holding_of, judge, place_rig
from pipeline.physics.sapien_bodies import to_sapien
from pipeline.physics.sapien_world import SapienWorld, configure
from pipeline.records.errors import UserError
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose, pose_matrix

RIGS_AT_ONCE = 1024
RIG_SPACING = 2.0  # m between neighbouring rigs: more than anything falls to the side


def require_cuda() -> None:
    """Check that PhysX can use a GPU.

    Raises:
        UserError: there is no CUDA device.
    """
    import torch

    if not torch.cuda.is_available():
        raise UserError("validate.device is cuda, but there is no usable CUDA device here; set it to cpu.")


def upright_hand(direction: str, T_hand_object: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``T_world_hand`` (4, 4), at the origin, for which gravity in ``direction`` of the object is world -z."""
    up = -gravity_vector(direction, T_hand_object) / GRAVITY
    side = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    side /= np.linalg.norm(side)
    T = np.eye(4)
    T[:3, :3] = side, np.cross(up, side), up
    return T


def hold_all_in_gravities(
    settings: PhysicsParameters, limits: ValidateParameters, grasps: Sequence[HeldGrasp]
) -> list[Holding]:
    """Do what ``holding.hold_in_gravities`` does for every grasp, direction by direction.

    Raises:
        UserError: there is no CUDA device, or SAPIEN is not the only engine.
    """
    if settings.engine != "sapien":
        raise UserError(
            f"validate.device is cuda, which only SAPIEN can use, but physics.engine is {settings.engine}; set the "
            "device to cpu, or the engine to sapien."
        )
    require_cuda()
    settings = limits.for_floating_hand(settings)
    outcomes: list[list[Outcome]] = [[] for _ in grasps]
    pending = list(range(len(grasps)))
    steps = steps_in(limits.gravity_seconds, settings.frequency)
    for direction in limits.gravity_directions:
        for begin in range(0, len(pending), RIGS_AT_ONCE):
            chosen = pending[begin : begin + RIGS_AT_ONCE]
            ended = _hold_rigs(settings, limits, [grasps[index] for index in chosen], direction, steps)
            for index, outcome in zip(chosen, ended, strict=True):
                outcomes[index].append(outcome)
        if limits.early_rejection:
            pending = [index for index in pending if outcomes[index][-1].held(limits)]
    return [holding_of(limits.gravity_directions, done, limits, steps * len(done)) for done in outcomes]


def _hold_rigs(
    settings: PhysicsParameters,
    limits: ValidateParameters,
    grasps: Sequence[HeldGrasp],
    direction: str,
    steps: int,
) -> list[Outcome]:
    """Hold all grasps in one direction, in one PhysX scene."""
    if not physx.is_gpu_enabled():
        physx.enable_gpu()
    configure(settings, (0.0, 0.0, -GRAVITY))
    system = physx.PhysxGpuSystem("cuda")
    system.timestep = 1.0 / settings.frequency
    columns = int(np.ceil(np.sqrt(len(grasps))))
    hands = [upright_hand(direction, grasp.objects[0].T_hand_object) for grasp in grasps]
    rigs = []
    for index, (grasp, T_world_hand) in enumerate(zip(grasps, hands, strict=True)):
        rig = SapienWorld(settings, system)
        system.set_scene_offset(rig.scene, [RIG_SPACING * (index % columns), RIG_SPACING * (index // columns), 0.0])
        place_rig(rig, grasp, T_world_hand)
        rigs.append(rig)
    _start(system, grasps, hands, rigs)
    pairs = [(link, body.component) for rig in rigs for body in rig.objects for link in rig.robots[0].links.values()]
    query = system.gpu_create_contact_pair_impulse_query(pairs)
    for _ in range(steps):
        system.step()
    system.gpu_query_contact_pair_impulses(query)
    system.gpu_fetch_rigid_dynamic_data()
    strength = np.linalg.norm(query.cuda_impulses.torch().cpu().numpy(), axis=-1)
    data = system.cuda_rigid_body_data.torch().cpu().numpy().astype(np.float64)
    outcomes, read = [], 0
    for grasp, T_world_hand, rig in zip(grasps, hands, rigs, strict=True):
        links = rig.robots[0].links
        poses, pressing = [], []
        for body in rig.objects:
            row = data[body.component.gpu_pose_index]
            poses.append(inverse_pose(T_world_hand) @ pose_matrix(row[:3], row[3:7]))
            touching = strength[read : read + len(links)] > limits.contact_impulse
            pressing.append({name for name, touches in zip(links, touching, strict=True) if touches})
            read += len(links)
        outcomes.append(judge(grasp.objects, poses, pressing))
    return outcomes


def _start(
    system: Any, grasps: Sequence[HeldGrasp], hands: Sequence[NDArray[np.float64]], rigs: Sequence[SapienWorld]
) -> None:
    """Put everything where it begins: ``gpu_init`` makes a step of its own, so the state is written after it."""
    import torch

    system.gpu_init()
    body_data, qpos, targets = (
        array.torch()
        for array in (system.cuda_rigid_body_data, system.cuda_articulation_qpos, system.cuda_articulation_target_qpos)
    )
    for grasp, T_world_hand, rig in zip(grasps, hands, rigs, strict=True):
        (robot,) = rig.robots
        poses = [(robot.articulation.root.gpu_pose_index, T_world_hand)]
        poses += [
            (body.component.gpu_pose_index, T_world_hand @ held.T_hand_object)
            for held, body in zip(grasp.objects, rig.objects, strict=True)
        ]
        for index, T in poses:
            pose = to_sapien(T)
            body_data[index, :7] = torch.tensor([*pose.p, *pose.q], device=body_data.device)
        row, order = robot.articulation.gpu_index, torch.tensor(robot.order, device=qpos.device)
        qpos[row, order] = torch.tensor(grasp.q, dtype=qpos.dtype, device=qpos.device)
        targets[row, order] = torch.tensor(grasp.squeeze_q, dtype=qpos.dtype, device=qpos.device)
    body_data[:, 7:] = 0
    system.cuda_articulation_qvel.torch()[:] = 0
    system.gpu_apply_rigid_dynamic_data()
    system.gpu_apply_articulation_root_pose()
    system.gpu_apply_articulation_root_velocity()
    system.gpu_apply_articulation_qpos()
    system.gpu_apply_articulation_qvel()
    system.gpu_apply_articulation_target_position()
    system.gpu_update_articulation_kinematics()
