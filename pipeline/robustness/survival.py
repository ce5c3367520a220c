"""Which of the drawn conditions a grasp survives: closing on displaced objects, then gravity and a shove.

The hand floats and begins open. It closes while the weight is balanced, as if the objects still lay on something; then
gravity pulls from the direction that was drawn, and each object is shoved. All of it is one world, hand frame = world.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.hand.moves import squeeze_joints
from pipeline.hand.surface import hand_surface
from pipeline.physics.engine import GRAVITY, Body, Robot, World, pressing_links, steps_in
from pipeline.physics.holding import LOST_DISTANCE, WATCH_STEPS, judge
from pipeline.physics.world import make_world
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.robustness import RobustnessParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose, transform_points
from pipeline.robustness.conditions import Condition
from pipeline.robustness.contacts import GraspInHand, grip_contacts
from pipeline.shapes.distance_field import DistanceField
from pipeline.shapes.mass import weighted

CLOSE_SECONDS = 0.3
DWELL_SECONDS = 0.1
HAND_POINTS = 2000  # about 5 mm apart
GIVING_WAY = 20  # most moves of an object out of the opened hand


def survived(
    grasp: GraspInHand,
    conditions: Sequence[Condition],
    physics: PhysicsParameters,
    limits: ValidateParameters,
    settings: RobustnessParameters,
) -> list[bool]:
    """Return, for each condition, whether the grasp survives it.

    It does when every object is pressed by its own links at the end, and has moved and turned no more than ``limits``
    allow. Motion counts from when the hand has closed: an object that was displaced is not expected to come back.
    """
    open_q = opened(grasp, settings.opening)
    return [
        all(
            _survives(grasp, open_q, condition, physics.in_engine(engine), limits, settings)
            for engine in physics.engines
        )
        for condition in conditions
    ]


def _survives(
    grasp: GraspInHand,
    open_q: NDArray[np.float64],
    condition: Condition,
    physics: PhysicsParameters,
    limits: ValidateParameters,
    settings: RobustnessParameters,
) -> bool:
    physics = limits.at_friction(condition.friction).for_floating_hand(physics)
    physics = physics.model_copy(update={"hand_torque_limit": condition.torque_limit})
    gravity = GRAVITY * grasp.grips[0].held.T_hand_object[:3, :3] @ condition.gravity
    world = make_world(physics, gravity)
    robot = world.add_hand(grasp.hand, np.eye(4), open_q)
    bodies, weights = [], []
    for index, (grip, T) in enumerate(zip(grasp.grips, displaced(grasp, open_q, condition), strict=True)):
        centre = condition.centre_offsets[index]
        item = weighted(grip.held.prepared, condition.mass_factors[index], centre)
        T_hand_centre = T.copy()
        T_hand_centre[:3, 3] += T[:3, :3] @ centre
        bodies.append(world.add_object(item, T_hand_centre, f"object_{index}"))
        weights.append(item.mass * gravity)
    _close(world, robot, bodies, weights, open_q, grasp.squeeze_q)
    closed = [replace(grip.held, T_hand_object=body.pose) for grip, body in zip(grasp.grips, bodies, strict=True)]
    if not _endure(world, bodies, condition.shoves, settings):
        return False
    pressing = [pressing_links(body, limits.contact_impulse) for body in bodies]
    return judge(closed, [body.pose for body in bodies], pressing).held(limits)


def opened(grasp: GraspInHand, opening: float) -> NDArray[np.float64]:
    """Return joints (J,), rad, with the contact points of every grip ``opening``, m, outwards from its object."""
    q = grasp.q
    for grip in grasp.grips:
        inward = grip_contacts(grip, grasp.q, grasp.hand).inward @ grip.held.T_hand_object[:3, :3].T
        q = squeeze_joints(grasp.hand, q, grip.contact_candidates, inward, -opening, grip.fingers)
    return q


def displaced(grasp: GraspInHand, open_q: NDArray[np.float64], condition: Condition) -> list[NDArray[np.float64]]:
    """Return ``T_hand_object`` (4, 4) of every object as the hand begins to close.

    Its pose in the grasp with the errors that were drawn. Where it would then be in the opened hand, or in an object
    before it, it gives way, as it does when a hand comes to it.
    """
    on_hand = _surface(grasp.hand, open_q)
    poses: list[NDArray[np.float64]] = []
    for index, grip in enumerate(grasp.grips):
        T = grip.held.T_hand_object.copy()
        T[:3, 3] += T[:3, :3] @ condition.position_errors[index]
        T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(condition.rotation_errors[index]).as_matrix()
        before = [
            transform_points(pose, other.held.prepared.surface_points)
            for other, pose in zip(grasp.grips, poses, strict=False)
        ]
        poses.append(_out_of(np.concatenate([on_hand, *before]), DistanceField(grip.held.prepared), T))
    return poses


def _surface(hand: Hand, q: NDArray[np.float64]) -> NDArray[np.float64]:
    links, points = hand_surface(HAND_POINTS, hand)
    return points_on_links(link_poses(hand, q[None]), links, points)[0]


def _out_of(
    obstacle: NDArray[np.float64], field: DistanceField, T_hand_object: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Shift an object until none of the points (n, 3), hand frame, lies in it, each time along its normal there."""
    T = T_hand_object.copy()
    for _ in range(GIVING_WAY):
        distance, outward = field.look_up(transform_points(inverse_pose(T), obstacle))
        deepest = distance.argmin()
        if distance[deepest] >= 0:
            break
        T[:3, 3] += T[:3, :3] @ (distance[deepest] * outward[deepest])
    return T


def _close(
    world: World,
    robot: Robot,
    bodies: Sequence[Body],
    weights: Sequence[NDArray[np.float64]],
    open_q: NDArray[np.float64],
    squeeze_q: NDArray[np.float64],
) -> None:
    """Close the hand and wait, the objects' weights (3,), N, balanced."""
    ramp = steps_in(CLOSE_SECONDS, world.frequency)
    for step in range(1, ramp + steps_in(DWELL_SECONDS, world.frequency) + 1):
        if step <= ramp:
            robot.set_targets(open_q + (squeeze_q - open_q) * step / ramp)
        for body, weight in zip(bodies, weights, strict=True):
            body.push(-weight)
        world.step()


def _endure(world: World, bodies: Sequence[Body], shoves: NDArray[np.float64], settings: RobustnessParameters) -> bool:
    """Hold for ``settings.hold_seconds`` with a shove of each object in the middle; return whether all stayed near."""
    half = steps_in(settings.hold_seconds / 2, world.frequency)
    starts = [body.pose[:3, 3] for body in bodies]

    def near() -> bool:
        return all(
            np.linalg.norm(body.pose[:3, 3] - start) <= LOST_DISTANCE
            for body, start in zip(bodies, starts, strict=True)
        )

    def hold(steps: int) -> bool:
        for _ in range(0, steps, WATCH_STEPS):
            if world.asleep:
                break
            world.step(WATCH_STEPS)
            if not near():
                return False
        return True

    if not hold(half):
        return False
    for _ in range(steps_in(settings.distribution.shove_seconds, world.frequency)):
        for body, shove in zip(bodies, shoves, strict=True):
            body.push(shove)
        world.step()
    return hold(half)
