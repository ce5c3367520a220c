from dataclasses import replace

import numpy as np
import pytest

from pipeline.physics.engine import GRAVITY
from pipeline.physics.sapien_bodies import from_sapien
from pipeline.physics.sapien_world import cpu_world
from pipeline.physics.world import make_world
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from tests.physics.engines import at, in_both, settings
from tests.physics.shapes import prepared_box

SETTINGS = PhysicsParameters()
DOWN = GRAVITY * np.array([0, 0, -1])


@in_both
@pytest.mark.parametrize("direction", [(0, 0, -1), (1, 0, 0), (0, -1, 0)])
def test_free_fall_follows_gravity(cube: PreparedObject, direction: tuple[int, int, int], engine: str) -> None:
    physics = settings(engine)
    world = make_world(physics, GRAVITY * np.array(direction))
    body = world.add_object(cube, np.eye(4), "box")
    world.step(100)
    # n semi-implicit Euler steps: g h^2 n (n + 1) / 2
    step = 1 / (physics.frequency * (physics.mujoco.substeps if engine == "mujoco" else 1))
    expected = GRAVITY * np.array(direction) * 0.5 * 0.5 * (0.5 + step)
    np.testing.assert_allclose(body.pose[:3, 3], expected, atol=1e-4)


def test_resting_force_is_the_weight_of_the_prepared_mass(cube: PreparedObject) -> None:
    world = cpu_world(SETTINGS, DOWN)
    support = world.add_box([0.2, 0.2, 0.01], at(z=-0.01), "support")
    body = world.add_object(cube, at(z=0.021), "box")
    world.step(40)
    weight = 0.042**3 * 500 * GRAVITY
    (contact,) = world.system.get_contacts()
    force = np.sum([point.impulse for point in contact.points], axis=0) * SETTINGS.frequency
    assert {support.component, body.component} == set(contact.bodies)
    assert abs(force[2]) == pytest.approx(weight, rel=0.02)
    assert body.pose[2, 3] == pytest.approx(0.021, abs=2e-4)


def test_spin_about_principal_axes_uses_the_prepared_inertia() -> None:
    box = prepared_box((0.02, 0.05, 0.11))
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    tilted = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]]) @ turn
    world = cpu_world(SETTINGS, np.zeros(3))
    body = world.add_object(replace(box, inertia=tilted @ box.inertia @ tilted.T), np.eye(4), "box")
    axes = from_sapien(body.component.cmass_local_pose)[:3, :3]
    np.testing.assert_allclose(
        axes @ np.diag(body.component.inertia) @ axes.T, tilted @ box.inertia @ tilted.T, atol=1e-9
    )
    assert body.component.mass == pytest.approx(box.mass)


@in_both
def test_a_carrier_carries_what_stands_on_it_and_is_moved_by_nothing(cube: PreparedObject, engine: str) -> None:
    world = make_world(settings(engine), DOWN)
    support = world.add_carrier([0.1, 0.1, 0.01], at(z=-0.01), "support")
    body = world.add_object(cube, at(z=0.021), "box")
    for step in range(200):
        support.carry_to([0.05 * (step + 1) / 200, 0, -0.01])
        world.step()
    assert body.pose[0, 3] == pytest.approx(0.05, abs=1e-3)
    world.step(20)
    np.testing.assert_allclose(support.pose[:3, 3], [0.05, 0, -0.01], atol=1e-6)


@in_both
def test_a_carrier_pushes_what_stands_in_its_way(cube: PreparedObject, engine: str) -> None:
    world = make_world(settings(engine), np.zeros(3))
    pusher = world.add_carrier([0.01, 0.05, 0.05], at(x=-0.031), "pusher")
    body = world.add_object(cube, np.eye(4), "box")
    for step in range(100):
        pusher.carry_to([-0.031 + 0.03 * (step + 1) / 100, 0, 0])
        world.step()
    # It starts with a jerk, from which a spring-like contact throws the cube a little ahead.
    assert 0.029 < body.pose[0, 3] < 0.03 * 1.2


@in_both
def test_a_world_falls_asleep_when_all_rests_and_a_push_wakes_it(cube: PreparedObject, engine: str) -> None:
    world = make_world(settings(engine), DOWN)
    world.add_box([0.2, 0.2, 0.01], at(z=-0.01), "support")
    body = world.add_object(cube, at(z=0.031), "box")
    for _ in range(4):  # 1 cm of free fall takes 9 steps
        world.step()
        assert not world.asleep
    world.step(world.frequency)
    assert world.asleep
    body.push(np.array([2.0, 0.0, 0.0]))  # N; its weight is 0.36
    world.step()
    assert not world.asleep


@in_both
def test_what_slides_does_not_sleep(cube: PreparedObject, engine: str) -> None:
    tilt = np.array([np.sin(0.32), 0.0, -np.cos(0.32)])  # tan(0.32) = 0.33
    world = make_world(settings(engine, friction=0.3), GRAVITY * tilt)
    world.add_box([0.9, 0.2, 0.01], at(z=-0.01), "support")
    world.add_object(cube, at(x=-0.8, z=0.021), "box")
    for _ in range(4):
        world.step(world.frequency // 4)
        assert not world.asleep
