"""The scene of a trial: robot at the world's origin, table top at z = 0, a sponge, and objects on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.evaluate.disturbance import TrialDisturbance
from pipeline.hand.model import Hand
from pipeline.physics.world import make_world
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.picks import PickParameters
from pipeline.shapes.mass import weighted
from pipeline.shapes.workplace import SPONGE_SIZE, SPONGE_X, TABLE_SIZE, TABLE_X

if TYPE_CHECKING:
    from pipeline.motion.collisions import Obstacle
    from pipeline.physics.engine import Body, Robot, World

# Palm down 0.45 m over the table, between the objects. Paper's code: the same at 0.30 m, where a finger that opens hits
# an object of 10 cm.
START_ARM = np.array([-0.1477, -0.6262, 0.1268, -2.5457, 0.0791, 1.9223, 1.4988])  # rad


@dataclass(frozen=True)
class OffCentre:
    """An object whose frame has its origin beside its centre of mass, where the engine has that of ``body``."""

    body: Body
    centre: NDArray[np.float64]  # (3,) m, centre of mass in the object's frame

    @property
    def pose(self) -> NDArray[np.float64]:
        """``T_world_object`` (4, 4)."""
        T = self.body.pose
        T[:3, 3] -= T[:3, :3] @ self.centre
        return T

    def link_impulses(self) -> dict[str, NDArray[np.float64]]:
        """Return the impulse (3,), N s, world frame, from each touching link in the last step."""
        return self.body.link_impulses()

    def push(self, force: ArrayLike) -> None:
        """Apply a force (3,), N, world frame, at the centre of mass during the next step."""
        self.body.push(force)


@dataclass(frozen=True)
class Scene:
    """A built scene with its objects where they were put."""

    world: World
    hand: Hand
    robot: Robot
    objects: tuple[Body, ...]  # in the order of picking


@dataclass(frozen=True)
class Post:
    """A fixed upright box on the sponge for an object to stand on."""

    x: float  # m
    y: float  # m
    width: float  # m, square
    height: float  # m

    @property
    def size(self) -> tuple[float, float, float]:
        """Full size, m."""
        return self.width, self.width, self.height

    def pose(self, settings: EvaluateParameters) -> NDArray[np.float64]:
        """``T_world_post`` (4, 4) of its centre."""
        T = _centred(self.x, settings.sponge_height + self.height / 2)
        T[1, 3] = self.y
        return T


def placement_offsets(count: int, settings: EvaluateParameters, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return (count, 3): x, y (m) and yaw (rad) by which the objects stand beside their nominal places."""
    limits = np.array([settings.perturbation, settings.perturbation, settings.yaw_perturbation])
    return rng.uniform(-1.0, 1.0, (count, 3)) * limits


def place_of(number: int, pick: PickParameters, settings: EvaluateParameters) -> tuple[float, float]:
    """Return where an object stands nominally, x and y, m: of those without a place the first is on the right."""
    return pick.place or (SPONGE_X, (-1, 1)[number] * settings.object_distance / 2)


def placed(
    picks: Sequence[PickParameters],
    objects: Sequence[PreparedObject],
    settings: EvaluateParameters,
    offsets: NDArray[np.float64],
) -> list[NDArray[np.float64]]:
    """Return ``T_world_object`` (4, 4) of every object on sponge or post, ``offsets`` (n, 3) beside its place."""
    poses = []
    for number, (pick, prepared, (dx, dy, yaw)) in enumerate(zip(picks, objects, offsets, strict=True)):
        x, y = place_of(number, pick, settings)
        top = settings.sponge_height + (0.0 if pick.post is None else pick.post.height)
        T = np.eye(4)
        T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        T[:3, 3] = (x + dx, y + dy, top - prepared.bottom)
        poses.append(T)
    return poses


def posts_of(picks: Sequence[PickParameters], settings: EvaluateParameters) -> list[Post]:
    """Return the posts of all objects that stand on one."""
    return [
        Post(*place_of(number, pick, settings), pick.post.width, pick.post.height)
        for number, pick in enumerate(picks)
        if pick.post is not None
    ]


def _centred(x: float, z: float) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, 3] = (x, 0.0, z)
    return T


def build_scene(
    hand: Hand,
    objects: Sequence[PreparedObject],
    settings: EvaluateParameters,
    physics: PhysicsParameters,
    poses: Sequence[NDArray[np.float64]],
    others: Sequence[tuple[PreparedObject, NDArray[np.float64]]] = (),
    posts: Sequence[Post] = (),
    disturbance: TrialDisturbance | None = None,
) -> Scene:
    """Build the physics of one sequence, robot in its start posture; nothing has moved yet.

    Args:
        poses: ``T_world_object`` (4, 4) of the objects.
        others: objects that stand around, with their ``T_world_object``.
        posts: what stands on the sponge and does not move.
        disturbance: what changes ``physics`` and the objects' masses.
    """
    world = make_world(disturbance.physics(physics) if disturbance else physics)
    robot = world.add_arm(hand, np.concatenate([START_ARM, hand.start]))
    sponge = np.array([SPONGE_SIZE, SPONGE_SIZE, settings.sponge_height])
    world.add_box(np.array(TABLE_SIZE) / 2, _centred(TABLE_X, -TABLE_SIZE[2] / 2), "table")
    world.add_box(sponge / 2, _centred(SPONGE_X, sponge[2] / 2), "sponge")
    for post in posts:
        world.add_box(np.array(post.size) / 2, post.pose(settings), "post")
    bodies = [
        world.add_object(prepared, T, f"object{index}")
        if disturbance is None
        else _off_centre(world, prepared, T, index, disturbance)
        for index, (prepared, T) in enumerate(zip(objects, poses, strict=True))
    ]
    for index, (prepared, T) in enumerate(others, start=len(objects)):
        world.add_object(prepared, T, f"object{index}")
    return Scene(world=world, hand=hand, robot=robot, objects=tuple(bodies))


def _off_centre(
    world: World,
    prepared: PreparedObject,
    T_world_object: NDArray[np.float64],
    index: int,
    disturbance: TrialDisturbance,
) -> OffCentre:
    """Add an object with the mass and the centre of mass that were drawn."""
    centre = disturbance.centre_offsets[index]
    T = T_world_object.copy()
    T[:3, 3] += T[:3, :3] @ centre
    own = weighted(prepared, disturbance.mass_factors[index], centre)
    return OffCentre(world.add_object(own, T, f"object{index}"), centre)


def support_obstacles(settings: EvaluateParameters, sponge_drop: float) -> list[Obstacle]:
    """Return table and sponge for the planner, the sponge's top lowered by ``sponge_drop``, m."""
    from pipeline.motion.collisions import Obstacle, box_shape

    height = settings.sponge_height - sponge_drop
    return [
        Obstacle("table", (box_shape(TABLE_SIZE),), _centred(TABLE_X, -TABLE_SIZE[2] / 2)),
        Obstacle("sponge", (box_shape([SPONGE_SIZE, SPONGE_SIZE, height]),), _centred(SPONGE_X, height / 2)),
    ]


def post_obstacle(post: Post, settings: EvaluateParameters, drop: float) -> Obstacle:
    """Return a post for the planner, its top lowered by ``drop``, m, so that what stands on it does not touch it."""
    from pipeline.motion.collisions import Obstacle, box_shape

    lower = replace(post, height=post.height - drop)
    return Obstacle("post", (box_shape(lower.size),), lower.pose(settings))


def object_obstacle(prepared: PreparedObject, name: str) -> Obstacle:
    """Return an object for the planner, with the same convex parts as in physics, at the world's origin."""
    from pipeline.motion.collisions import Obstacle

    return Obstacle(name, _convex_shapes(prepared))


@lru_cache(maxsize=16)
def _convex_shapes(prepared: PreparedObject) -> tuple[Any, ...]:
    from pipeline.motion.collisions import convex_shape

    return tuple(convex_shape(vertices) for vertices, _ in prepared.parts)
