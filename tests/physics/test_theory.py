"""Both engines against what mechanics says."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.hand.kinematics import link_poses
from pipeline.physics.engine import GRAVITY, Body, World, steps_in
from pipeline.physics.holding import HeldObject, hold_in_gravities
from pipeline.physics.world import make_world
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from tests.physics.engines import at, in_both, settings
from tests.physics.shapes import prepared_box
from tests.physics.test_holding import HAND, clamped_block


def slide_on_a_slope(physics: PhysicsParameters, tangent: float, cube: PreparedObject) -> float:
    """How far a cube slides in a second down a slope, by gravity that is not vertical."""
    angle = np.arctan(tangent)
    world = make_world(physics, GRAVITY * np.array([np.sin(angle), 0, -np.cos(angle)]))
    world.add_box([0.5, 0.5, 0.01], at(z=-0.01), "slope")
    body = world.add_object(cube, at(z=0.021), "cube")
    world.step(steps_in(0.2, world.frequency))
    begin = body.pose
    world.step(steps_in(1.0, world.frequency))
    return float((body.pose - begin)[0, 3])


@in_both
def test_a_push_gives_momentum_for_one_step(engine: str, cube: PreparedObject) -> None:
    world = make_world(settings(engine), np.zeros(3))
    body = world.add_object(replace(cube, mass=0.2), np.eye(4), "cube")
    force = np.array([0.3, 0.0, -0.1])
    for _ in range(20):
        body.push(force)
        world.step()
    body.push(force)
    world.step(30)  # of which the push lasts one
    begin = body.pose
    world.step(world.frequency)
    moved = body.pose @ np.linalg.inv(begin)
    np.testing.assert_allclose(moved[:3, 3], force / 0.2 * 21 / world.frequency, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(moved[:3, :3], np.eye(3), atol=1e-6)


@in_both
def test_a_block_slips_at_the_average_friction(engine: str, cube: PreparedObject) -> None:
    physics = settings(engine)
    friction = (physics.object_friction + physics.support_friction) / 2
    assert abs(slide_on_a_slope(physics, 0.98 * friction, cube)) < 2e-4
    # g (sin - friction cos) t^2 / 2, after 0.2 s on the way
    slope = np.arctan(1.02 * friction)
    acceleration = GRAVITY * (np.sin(slope) - friction * np.cos(slope))
    expected = acceleration * (1.2**2 - 0.2**2) / 2
    assert slide_on_a_slope(physics, 1.02 * friction, cube) == pytest.approx(expected, rel=0.1)


@dataclass
class Pressed:
    """A block between a fixed wall and the tip of the straight index finger, which presses with a limited torque.

    The wall is at +x, the finger points along z. Two carriers hold the block until it is pressed.
    """

    world: World
    body: Body
    force: float  # N, by which the torque limit of the finger's second joint presses


def pressed(physics: PhysicsParameters, block: PreparedObject, gravity: NDArray[np.float64], offset: float) -> Pressed:
    """Press a block of half width 0.01 m, its centre of mass ``offset`` beside the tip along -y, and let it go."""
    q = np.clip(np.zeros(16), HAND.lower, HAND.upper)
    poses = link_poses(HAND, q[None])[0]
    tip = poses[HAND.link("link_3.0_tip")][:3, 3]
    lever = tip[2] - poses[HAND.link("link_1.0")][2, 3]
    centre = tip + [0.0121 + 0.01, -offset, 0]
    world = make_world(physics, gravity)
    robot = world.add_hand(HAND, np.eye(4), q)
    body = world.add_object(block, at(*centre), "block")
    world.add_box([0.02, 0.1, 0.1], at(*centre + [0.03, 0, 0]), "wall")
    down = gravity / np.linalg.norm(gravity)
    half = block.extents[1] / 2
    places = [centre + (half + 0.005) * down + [0, y, 0] for y in ({0.0, 2 * offset})]
    if down[1]:  # beside the finger, above its last link but one
        places = [place + [0, 0, 0.01] for place in places]
    carriers = [world.add_carrier([0.008, 0.005, 0.005], at(*place), f"shelf{i}") for i, place in enumerate(places)]
    target = q.copy()
    target[1] += 0.5
    for share in np.linspace(0, 1, 101)[1:]:
        robot.set_targets(q + share * (target - q))
        world.step()
    world.step(steps_in(0.3, world.frequency))
    for share in np.linspace(0, 1, 41)[1:]:
        for carrier, place in zip(carriers, places, strict=True):
            carrier.carry_to(place + share * 0.05 * down)
        world.step()
    return Pressed(world, body, physics.hand_torque_limit / lever)


def pressing_force(physics: PhysicsParameters) -> float:
    return pressed(physics, prepared_box((0.02, 0.03, 0.03)), np.array([0.0, -1e-3, 0.0]), 0.0).force


@in_both
@pytest.mark.parametrize(("load", "slips"), [(0.9, False), (1.2, True)])
def test_a_pinched_block_slips_at_the_load_of_two_friction_cones(engine: str, load: float, slips: bool) -> None:
    """The load is a share of 2 friction N. PhysX presses with 6.3 to 6.6 N where the torque limit says 5.9."""
    physics = settings(engine, friction=0.6)
    block = prepared_box((0.02, 0.03, 0.03), density=10000)
    gravity = load * 2 * 0.6 * pressing_force(physics) / block.mass
    rig = pressed(physics, block, np.array([0.0, -gravity, 0.0]), 0.0)
    begin = rig.body.pose[1, 3]
    rig.world.step(steps_in(0.5, rig.world.frequency))
    moved = begin - rig.body.pose[1, 3]
    assert moved > 0.005 if slips else abs(moved) < 1e-3


def twist(engine: str, share: float) -> float:
    """Angle, degrees, by which a block turns at a tip in 0.5 s when its weight twists the Hertz contact.

    Block and wall have no friction. The torque is a share of 3 pi / 16 friction N radius.
    """
    friction, radius, offset = 0.6, 0.005, 0.02
    tip = {"tip_static_friction": 2 * friction, "tip_dynamic_friction": 2 * friction, "tip_patch_radius": radius}
    physics = settings(engine, object_friction=0.0, support_friction=0.0, **tip)
    block = prepared_box((0.02, 0.06, 0.06), density=2000)
    block = replace(block, parts=tuple((vertices + [0, offset, 0], faces) for vertices, faces in block.parts))
    torque = share * 3 * np.pi / 16 * friction * pressing_force(physics) * radius
    rig = pressed(physics, block, np.array([0.0, 0.0, -torque / (block.mass * offset)]), offset)
    rig.world.step(steps_in(0.5, rig.world.frequency))
    return float(np.degrees(np.arctan2(rig.body.pose[2, 1], rig.body.pose[1, 1])))


def test_a_tip_bears_the_torque_of_a_hertz_contact() -> None:
    """And that of its flat facets, whose corners are up to 2 mm apart: a third of it."""
    assert abs(twist("mujoco", 0.95)) < 1
    assert abs(twist("mujoco", 1.7)) > 2


def knife_edge_pendulum(length: float) -> tuple[PreparedObject, float, float]:
    """A plate that hangs between two prisms, whose edges point down; its height of the edges over the centre of mass.

    Returns the body, that height and the moment of inertia about the edge, kg m2.
    """
    plate = prepared_box((0.01, 0.04, length))
    height = 0.4 * length
    corners = np.array([[0, 0, 0], [0.008, 0, 0.012], [-0.008, 0, 0.012]]) + [0, 0, height]
    prisms = []
    for side in (-1, 1):
        ends = np.concatenate([corners + [0, side * 0.02, 0], corners + [0, side * 0.05, 0]])
        prisms.append((ends, np.zeros((0, 3), np.int64)))
    body = replace(plate, parts=(*plate.parts, *prisms))  # mass properties stay those of the plate
    return body, height, body.inertia[1, 1] + body.mass * height**2


@in_both
def test_a_bar_swings_with_the_period_of_a_physical_pendulum(engine: str) -> None:
    bar, height, inertia = knife_edge_pendulum(0.2)
    physics = settings(engine, friction=1.0)
    amplitude = 0.08
    T = at()
    T[:3, :3] = Rotation.from_euler("y", amplitude).as_matrix()
    T[:3, 3] = T[:3, :3] @ [0, 0, -height]  # the edges at the origin
    world = make_world(physics)
    for side in (-1, 1):
        world.add_box([0.03, 0.0125, 0.01], at(y=side * 0.0375, z=-0.01), f"rest{side}")
    body = world.add_object(bar, T, "bar")
    angles = []
    for _ in range(steps_in(3.0, world.frequency)):
        world.step()
        pose = body.pose
        angles.append(np.arctan2(pose[0, 2], pose[2, 2]))
    values = np.array(angles)
    crossings = np.flatnonzero((values[:-1] > 0) & (values[1:] <= 0))
    times = crossings + values[crossings] / (values[crossings] - values[crossings + 1])
    period = np.diff(times).mean() / world.frequency
    expected = 2 * np.pi * np.sqrt(inertia / (bar.mass * GRAVITY * height)) * (1 + amplitude**2 / 16)
    assert len(times) >= 3
    assert period == pytest.approx(expected, rel=0.01)


def energies(world: World, body: Body, prepared: PreparedObject, seconds: float) -> NDArray[np.float64]:
    """Energy, J, of a free body under gravity after every step, its velocity that of the last step."""
    found, before = [], body.pose
    for _ in range(steps_in(seconds, world.frequency)):
        world.step()
        pose = body.pose
        velocity = (pose - before)[:3, 3] * world.frequency
        turn = Rotation.from_matrix(before[:3, :3].T @ pose[:3, :3]).as_rotvec() * world.frequency
        kinetic = prepared.mass * velocity @ velocity / 2 + turn @ prepared.inertia @ turn / 2
        found.append(kinetic + prepared.mass * GRAVITY * pose[2, 3])
        before = pose
    return np.array(found)


@in_both
def test_a_tumbling_block_never_gains_energy(engine: str) -> None:
    block = prepared_box((0.03, 0.05, 0.08))
    world = make_world(settings(engine))
    world.add_box([0.5, 0.5, 0.01], at(z=-0.01), "floor")
    T = at(z=0.15)
    T[:3, :3] = Rotation.from_euler("xyz", [0.5, 0.7, 0.2]).as_matrix()
    energy = energies(world, world.add_object(block, T, "block"), block, 2.0)
    begin = block.mass * GRAVITY * 0.15
    lowest = np.minimum.accumulate(energy)
    assert energy[0] == pytest.approx(begin, rel=0.01)
    assert (energy - lowest).max() < 0.02 * begin  # a step's own error while it rises again
    assert energy[-1] == pytest.approx(block.mass * GRAVITY * 0.015, rel=0.7)  # it lies on a side


@in_both
def test_a_resting_block_presses_with_its_weight(engine: str) -> None:
    """On the palm: weight times the time step."""
    block = prepared_box((0.02, 0.02, 0.02))
    world = make_world(settings(engine), np.array([-GRAVITY, 0.0, 0.0]))  # down onto the palm
    q = np.clip(np.zeros(16), HAND.lower, HAND.upper)
    robot = world.add_hand(HAND, np.eye(4), q)
    body = world.add_object(block, at(x=0.0117 + 0.01, y=0.035, z=-0.02), "block")
    robot.set_targets(q)
    world.step(steps_in(1.0, world.frequency))
    (impulse,) = body.link_impulses().values()
    np.testing.assert_allclose(impulse, [block.mass * GRAVITY / world.frequency, 0, 0], atol=2e-5)


def wedged(tangent: float) -> tuple[NDArray[np.float64], NDArray[np.float64], HeldObject]:
    """The clamped block, its two held faces tilted by the angle of this tangent, so that it is thinner at the bottom.

    The fingers press along x; a contact's normal is this angle away from the line to the other one, so that fingers
    hold the wedge if and only if the angle is inside both friction cones.
    """
    q, squeeze, held = clamped_block()
    (vertices, faces), *_ = held.prepared.parts
    leaning = vertices.copy()
    inward = 0.012 * (np.hypot(1, tangent) - 1)  # so that the leaning faces still touch the round tips
    leaning[:, 0] += np.sign(vertices[:, 0]) * (vertices[:, 2] * tangent - inward)
    prepared = replace(held.prepared, vertices=leaning, parts=((leaning, faces),))
    return q, squeeze, replace(held, prepared=prepared)


WEDGES, FRICTIONS = (0.1, 0.27, 0.45), (0.18, 0.36, 0.6)


@in_both
def test_wedges_are_held_where_their_angle_is_inside_the_friction_cone(engine: str) -> None:
    """Three grasps at three frictions, all same as by hand: so both engines put them in the same order.

    The squeeze carries what it holds by 9 to 11 mm; a wedge that slips moves by 19 mm and more.
    """
    limits = ValidateParameters(friction=None, gravity_directions=["+z"], drift_limit=0.015, rotation_limit=1.0)
    held = {}
    for tangent in WEDGES:
        q, squeeze, wedge = wedged(tangent)
        for friction in FRICTIONS:
            physics = settings(engine, friction=friction)
            result = hold_in_gravities(physics, limits, [wedge], q, squeeze, HAND)
            held[tangent, friction] = result.failed_direction == ""
    assert held == {(tangent, friction): tangent < friction for tangent in WEDGES for friction in FRICTIONS}
