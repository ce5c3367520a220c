"""cuRobo 2 as a planner of the arm's moves, where a user has it: https://curobo.org.

It sees the robot as balls and the scene as boxes and convex meshes. Whatever it returns is tested against the exact
shapes of :class:`CollisionWorld` before it is used, so that its approximations cost successes and never a collision.
Written for the interface of cuRobo 0.8; tried on a CPU with another implementation of it, not with cuRobo on a GPU.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.robot import ARM_JOINT_NAMES, ARM_LINKS, compose_robot
from pipeline.hand.standard import generated_folder
from pipeline.motion.paths import is_line_free, without_near_duplicates
from pipeline.records.errors import UserError
from pipeline.records.poses import position_quaternion

if TYPE_CHECKING:
    from pipeline.hand.model import Hand
    from pipeline.motion.arm_model import ArmModel
    from pipeline.motion.collisions import CollisionWorld, Obstacle

NEIGHBOURS = 2  # links that are so many joints apart, or fewer, are not tested against each other
MOST_JERK = 500.0  # rad/s3; the path is timed anew, so that this only shapes it
BASE = ARM_LINKS[0]  # stands on the table by design


def _modules() -> tuple[Any, Any]:
    """Return ``curobo.motion_planner`` and ``curobo.types``.

    Raises:
        UserError: cuRobo 2 is not installed.
    """
    try:
        from curobo import motion_planner, types
    except ImportError as error:
        raise UserError(
            "evaluate.planner is curobo, but cuRobo 2 is not installed here; install it as https://curobo.org says "
            "(`curobo` on PyPI is another package), or set evaluate.planner to own."
        ) from error
    return motion_planner, types


@lru_cache(maxsize=2)
def _arm_file(hand: Hand) -> Path:
    """Write the URDF of the arm alone once per process and return its path; any more joint would be planned for."""
    root = ElementTree.fromstring(compose_robot(True, visuals=False, hand=hand))
    for element in list(root):
        if element.get("name") not in (*ARM_LINKS, *ARM_JOINT_NAMES):
            root.remove(element)
    target = generated_folder() / "panda_alone.urdf"
    target.write_text(ElementTree.tostring(root, encoding="unicode"))
    return target


def robot_description(arm: ArmModel, held: Sequence[Obstacle], margin: float, urdf: str) -> dict[str, Any]:
    """Return cuRobo's description of the arm, with the hand in its posture and what it holds as balls of the last link.

    Args:
        held: with ``pose`` = ``T_hand_object``.
        margin: least distance to obstacles, m.
        urdf: path of the arm's description.
    """
    from pipeline.motion.balls import covering_balls, placed_balls

    found: dict[str, list[NDArray[np.float64]]] = {link: [] for link in ARM_LINKS}
    for item in arm.geometry.geometryObjects:
        found[ARM_LINKS[item.parentJoint]].append(
            placed_balls(covering_balls(item.geometry), item.placement.homogeneous)
        )
    for thing in held:
        T = arm.T_link7_hand @ thing.pose
        found[ARM_LINKS[-1]] += [placed_balls(covering_balls(shape), T) for shape in thing.shapes]
    links = [link for link in ARM_LINKS if link != BASE and found[link]]
    balls = {link: np.concatenate(found[link]) for link in links}
    ones = [1.0] * len(ARM_JOINT_NAMES)
    kinematics = {
        "format_version": 2.0,
        "urdf_path": urdf,
        "base_link": BASE,
        "tool_frames": [ARM_LINKS[-1]],
        "collision_link_names": links,
        "collision_spheres": {
            link: [{"center": ball[:3].tolist(), "radius": float(ball[3])} for ball in own]
            for link, own in balls.items()
        },
        "collision_sphere_buffer": margin,
        "self_collision_buffer": dict.fromkeys(links, 0.0),
        "self_collision_ignore": {link: links[index + 1 : index + 1 + NEIGHBOURS] for index, link in enumerate(links)},
        "cspace": {
            "joint_names": list(ARM_JOINT_NAMES),
            "default_joint_position": ((arm.lower + arm.upper) / 2).tolist(),
            "cspace_distance_weight": ones,
            "null_space_weight": ones,
            "max_acceleration": 15.0,
            "max_jerk": MOST_JERK,
        },
    }
    return {"robot_cfg": {"kinematics": kinematics, "load_dynamics": False}}


def scene_description(obstacles: Sequence[Obstacle]) -> dict[str, Any]:
    """Return cuRobo's description of obstacles: boxes as cuboids, other shapes as the meshes of their convex hulls."""
    from scipy.spatial import ConvexHull

    from pipeline.motion.balls import hull_points

    cuboids: dict[str, Any] = {}
    meshes: dict[str, Any] = {}
    for thing in obstacles:
        pose = [float(value) for value in np.concatenate(position_quaternion(thing.pose))]
        for index, shape in enumerate(thing.shapes):
            name = f"{thing.name}_{index}"
            if hasattr(shape, "halfSide"):
                cuboids[name] = {"dims": [2 * float(half) for half in shape.halfSide], "pose": pose}
                continue
            points = hull_points(shape)
            meshes[name] = {"vertices": points.tolist(), "faces": ConvexHull(points).simplices.tolist(), "pose": pose}
    return {kind: own for kind, own in (("cuboid", cuboids), ("mesh", meshes)) if own}


def curobo(
    world: CollisionWorld, start: NDArray[np.float64], goal: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64] | None:
    """Return cuRobo's path (n, 7) from ``start`` to ``goal`` (7,), rad, if it is free in the exact world; else None.

    Args:
        world: one in which the hand may touch nothing.
        rng: gives cuRobo's seed.

    Raises:
        UserError: cuRobo is not installed, or cannot start here.
    """
    motion_planner, types = _modules()
    if not world.is_free(start) or not world.is_free(goal):
        return None
    positions = _planned(motion_planner, types, world, start, goal, int(rng.integers(2**31)))
    if positions is None:
        return None
    path = without_near_duplicates(np.concatenate([[start], positions[1:-1], [goal]]))
    return path if all(is_line_free(world.is_free, *ends) for ends in pairwise(path)) else None


def _planned(
    motion_planner: Any,
    types: Any,
    world: CollisionWorld,
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    seed: int,
) -> NDArray[np.float64] | None:
    """Return the positions (n, 7) of cuRobo's trajectory, in the order of ``ARM_JOINT_NAMES``."""
    import torch

    urdf = str(_arm_file(world.arm.hand))
    try:
        settings = motion_planner.MotionPlannerCfg.create(
            robot=robot_description(world.arm, world.held, world.margin, urdf),
            scene_model=scene_description(world.obstacles),
            random_seed=seed,
            use_cuda_graph=False,  # another scene, and another hand posture, every time
        )
        planner = motion_planner.MotionPlanner(settings)
    except (AssertionError, RuntimeError) as error:  # what torch raises without CUDA
        why = str(error).strip().split("\n")[0]
        raise UserError(
            f"evaluate.planner is curobo, but cuRobo cannot start here ({why}); it needs an NVIDIA GPU, or set "
            "evaluate.planner to own."
        ) from error
    names = list(planner.joint_names)
    order = [ARM_JOINT_NAMES.index(name) for name in names]

    def state(q: NDArray[np.float64]) -> Any:
        position = torch.tensor(q[order][None], dtype=torch.float32, device=planner.device_cfg.device)
        return types.JointState.from_position(position, joint_names=names)

    result = planner.plan_cspace(state(goal), state(start))
    if result is None or not bool(result.success.any()):
        return None
    found = result.get_interpolated_plan().position
    positions = found.reshape(-1, found.shape[-1]).cpu().numpy().astype(np.float64)
    return positions[:, [names.index(name) for name in ARM_JOINT_NAMES]]
