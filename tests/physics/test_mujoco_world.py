"""What MuJoCo is told, and what it must not do."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from pipeline.hand.model import Hand, load_hand
from pipeline.physics.engine import GRAVITY, steps_in, torsional_friction
from pipeline.physics.holding import hold_in_gravities
from pipeline.physics.mujoco_contacts import TIME_CONSTANT
from pipeline.physics.mujoco_world import CALM_SECONDS, MujocoWorld
from pipeline.physics.sapien_world import cpu_world
from pipeline.records.hands import known_hands
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import pose_matrix
from tests.physics.engines import at, settings
from tests.physics.shapes import prepared_box
from tests.physics.test_holding import HAND, clamped_block

SETTINGS = settings("mujoco")
STILL = np.zeros(3)


def both_robots(hand: Hand, arm: bool) -> tuple[MujocoWorld, dict[str, object]]:
    """A robot in MuJoCo, and the links of the same in SAPIEN."""
    q = (hand.lower + hand.upper) / 2
    first, second = MujocoWorld(SETTINGS, STILL), cpu_world(SETTINGS, STILL)
    if arm:
        q = np.concatenate([np.zeros(7), q])
        first.add_arm(hand, q)
        return first, second.add_arm(hand, q).links
    first.add_hand(hand, np.eye(4), q)
    return first, second.add_hand(hand, np.eye(4), q).links


ROBOTS = [*((name, False) for name in known_hands()), ("allegro", True)]


@pytest.mark.parametrize(("name", "arm"), ROBOTS)
def test_links_have_the_shapes_and_the_inertias_that_sapien_gives_them(name: str, arm: bool) -> None:
    world, links = both_robots(load_hand(name), arm)
    model = world.simulation.model
    for link, other in links.items():
        body = model.body(f"robot0/{link}")
        shapes = [index for index in range(model.ngeom) if model.geom_bodyid[index] == body.id]
        assert len(shapes) == len(other.collision_shapes), link
        # PhysX's hulls have fewer corners.
        np.testing.assert_allclose(
            sorted(volume(model, index) for index in shapes),
            sorted(
                float(np.prod(2 * shape.half_size))
                if hasattr(shape, "half_size")
                else ConvexHull(shape.vertices).volume
                for shape in other.collision_shapes
            ),
            rtol=0.06,
        )
        if body.mass[0] == 0:
            continue  # the description gives it none, and it is fixed to others
        assert body.mass[0] == pytest.approx(other.mass, rel=1e-6)
        np.testing.assert_allclose(np.sort(body.inertia), np.sort(other.inertia), rtol=1e-4)
        np.testing.assert_allclose(body.ipos, other.cmass_local_pose.p, atol=1e-6)


def volume(model: object, index: int) -> float:
    import mujoco

    if model.geom_type[index] == mujoco.mjtGeom.mjGEOM_BOX:
        return float(np.prod(2 * model.geom_size[index]))
    mesh = model.geom_dataid[index]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    return float(ConvexHull(model.mesh_vert[first : first + count]).volume)


def test_what_touches_has_the_average_friction_and_tips_a_hertz_contact(cube: PreparedObject) -> None:
    import mujoco

    world = MujocoWorld(SETTINGS, STILL)
    world.add_hand(HAND, np.eye(4), (HAND.lower + HAND.upper) / 2)
    world.add_object(cube, at(x=1), "cube")
    world.add_box([0.1, 0.1, 0.1], at(x=2), "table")
    model = world.simulation.model
    pairs = {}
    for index in range(model.npair):
        bodies = (model.geom_bodyid[model.pair_geom1[index]], model.geom_bodyid[model.pair_geom2[index]])
        names = frozenset(model.body(body).name.removeprefix("robot0/") for body in bodies)
        pairs[names] = (model.pair_dim[index], model.pair_friction[index])
    tip, link, thing, table = 1.0, 0.3, 0.9, 0.5
    for names, dimensions, friction, torsion in (
        ({"link_3.0_tip", "cube"}, 4, (tip + thing) / 2, 3 * np.pi / 16 * (tip + thing) / 2 * 0.005),
        ({"link_2.0", "cube"}, 3, (link + thing) / 2, 0.0),
        ({"table", "cube"}, 3, (table + thing) / 2, 0.0),
        ({"link_3.0_tip", "link_15.0_tip"}, 4, tip, 3 * np.pi / 16 * tip * 0.005),
    ):
        assert pairs[frozenset(names)][0] == dimensions
        np.testing.assert_allclose(pairs[frozenset(names)][1][:3], [friction, friction, torsion])
    never = [{"base_link", "table"}, *({a, b} for group in HAND.never_meeting for a, b in pairwise(group))]
    never += [{"link_1.0", "link_2.0"}, {"link_3.0", "link_3.0_tip"}]
    assert not [names for names in never if frozenset(names) in pairs]
    assert frozenset({"link_3.0_tip", "base_link"}) in pairs
    assert mujoco.mj_versionString() and model.ngeom == 23 + 2


def test_torsional_friction_is_that_of_a_hertz_contact() -> None:
    """By quadrature over rings of a disc: friction x pressure x radius."""
    radius, friction = 0.005, 0.7
    edges = np.linspace(0, radius, 20001)
    r, width = (edges[1:] + edges[:-1]) / 2, edges[1] - edges[0]
    pressure = 1.5 / (np.pi * radius**2) * np.sqrt(1 - (r / radius) ** 2)  # of one newton
    assert (pressure * 2 * np.pi * r * width).sum() == pytest.approx(1, rel=1e-4)
    torque = (friction * pressure * r * 2 * np.pi * r * width).sum()
    assert torsional_friction(friction, radius) == pytest.approx(torque, rel=1e-4)


@pytest.mark.parametrize("overlap", [0.0002, 0.0005, 0.001])
def test_an_overlap_throws_no_faster_than_a_critically_damped_spring(cube: PreparedObject, overlap: float) -> None:
    """Which reaches overlap / (e T); the impedance makes it a little stiffer than that."""
    world = MujocoWorld(SETTINGS, STILL)
    world.add_box([0.1, 0.1, 0.01], at(z=-0.01), "table")
    body = world.add_object(cube, at(z=0.021 - overlap), "cube")
    heights = []
    for _ in range(20):
        heights.append(body.pose[2, 3])
        world.step()
    fastest = np.diff(heights).max() * world.frequency
    assert 0.5 * overlap / (np.e * TIME_CONSTANT) < fastest < 1.15 * overlap / (np.e * TIME_CONSTANT)


def test_a_squeeze_begins_without_gravity_and_calms_what_moves(cube: PreparedObject) -> None:
    """An overlap of 1 mm throws the cube as far as overlap tau / (e T), 0.9 mm; without tau it flies 40 mm in 0.5 s."""
    world = MujocoWorld(SETTINGS, np.array([0.0, 0.0, -GRAVITY]))
    middle = (HAND.lower + HAND.upper) / 2
    robot = world.add_hand(HAND, at(x=1), middle)
    world.add_box([0.1, 0.1, 0.01], at(z=-0.01), "table")
    body = world.add_object(cube, at(z=0.021 - 0.001), "cube")
    world.squeeze(robot, middle + 0.1)
    thrown = body.pose[2, 3] - 0.021
    assert 0 < thrown < 1.2 * 0.001 * CALM_SECONDS / (np.e * TIME_CONSTANT)
    np.testing.assert_allclose(robot.q, middle + 0.1, atol=0.01)
    begin = body.pose[2, 3]
    other = MujocoWorld(SETTINGS, np.array([0.0, 0.0, -GRAVITY]))
    falling = other.add_object(cube, at(z=begin), "cube")
    world.step()
    other.step()
    assert body.pose[2, 3] == pytest.approx(falling.pose[2, 3], abs=1e-6)  # gravity is back, and nothing slows it


def test_reading_changes_nothing(cube: PreparedObject) -> None:
    def run(look: bool) -> bytes:
        world = MujocoWorld(SETTINGS, np.array([0.0, 0.0, -GRAVITY]))
        robot = world.add_hand(HAND, np.eye(4), (HAND.lower + HAND.upper) / 2)
        body = world.add_object(cube, at(x=0.06, z=0.06), "cube")
        robot.set_targets(HAND.upper)
        for _ in range(80):
            world.step()
            if look:
                robot.link_pose("link_3.0_tip"), body.link_impulses(), robot.q, body.pose
        return robot.q.tobytes() + body.pose.tobytes()

    assert run(look=True) == run(look=False)


def test_what_diverges_is_not_a_number_and_says_nothing(
    cube: PreparedObject, monkeypatch, tmp_path: Path, capfd
) -> None:
    monkeypatch.chdir(tmp_path)
    world = MujocoWorld(SETTINGS, np.array([0.0, 0.0, -1e14]))
    robot = world.add_hand(HAND, np.eye(4), (HAND.lower + HAND.upper) / 2)
    body = world.add_object(cube, at(z=1), "cube")
    world.step(5)
    world.step(5)
    assert np.isnan(body.pose).all() and np.isnan(robot.q).all() and np.isnan(robot.link_pose("base_link")).all()
    assert capfd.readouterr() == ("", "") and list(tmp_path.iterdir()) == []


def test_a_world_takes_nothing_more_once_it_was_read(cube: PreparedObject) -> None:
    world = MujocoWorld(SETTINGS, STILL)
    assert world.add_object(cube, np.eye(4), "cube").pose[0, 3] == 0
    with pytest.raises(RuntimeError, match="make another"):
        world.add_object(cube, at(x=1), "other")


def test_mass_and_inertia_are_the_prepared_ones() -> None:
    box = prepared_box((0.02, 0.05, 0.11))
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]])
    tilted = turn @ box.inertia @ turn.T
    world = MujocoWorld(SETTINGS, STILL)
    world.add_object(replace(box, inertia=tilted), np.eye(4), "box")
    body = world.simulation.model.body("box")
    axes = pose_matrix(np.zeros(3), body.iquat)[:3, :3]
    np.testing.assert_allclose(axes @ np.diag(body.inertia) @ axes.T, tilted, atol=1e-12)
    assert body.mass[0] == pytest.approx(box.mass) and np.all(body.ipos == 0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tip_static_friction": 2.0}, "set both to the same value"),
        ({"tip_patch_radius": 0.1}, "lower it"),
    ],
)
@pytest.mark.parametrize("engine", ["mujoco", "both"])
def test_what_mujoco_cannot_take_is_refused(engine: str, changes: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        settings(engine, **changes)
    settings("sapien", **changes)


def test_halving_the_step_moves_a_held_block_little(cube: PreparedObject) -> None:
    """It is carried 10 mm by the squeeze; that may change by 1 mm, a twentieth of the limit."""
    q, squeeze_q, held = clamped_block()
    limits = ValidateParameters(gravity_directions=["-x", "-z"])
    drifts = [
        hold_in_gravities(settings("mujoco", mujoco={"substeps": count}), limits, [held], q, squeeze_q, HAND).drift
        for count in (5, 10)
    ]
    np.testing.assert_allclose(drifts[0], drifts[1], atol=1e-3)


def test_steps_last_as_long_as_in_the_other_engine(cube: PreparedObject) -> None:
    physics = PhysicsParameters.model_validate({**SETTINGS.model_dump(), "frequency": 500})
    world = MujocoWorld(physics, np.array([0.0, 0.0, -GRAVITY]))
    body = world.add_object(cube, np.eye(4), "cube")
    world.step(steps_in(0.3, world.frequency))
    assert body.pose[2, 3] == pytest.approx(-GRAVITY * 0.3**2 / 2, rel=0.01)
