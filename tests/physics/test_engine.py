"""Another engine can take SAPIEN's place: tests of grasps need nothing but the interface, and nobody goes round it."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from pipeline.hand.approach import Approach
from pipeline.hand.model import Hand
from pipeline.physics import engine
from pipeline.physics.engine import GRAVITY
from pipeline.physics.holding import LOST_DISTANCE, HeldGrasp, hold_in_gravities
from pipeline.physics.settling import settle_grasp
from pipeline.physics.table_pick import DROP_DISTANCE, pick_from_support
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.validate.checks import table_failure
from tests.physics.test_holding import HAND, clamped_block

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = PhysicsParameters()


class Thing:
    """A point that falls or that a link holds; or a box, which moves when it is carried."""

    def __init__(self, T: ArrayLike, holder: str = "") -> None:
        self.T = np.array(T, np.float64)
        self.velocity, self.shift = np.zeros(3), np.zeros(3)
        self.holder = holder

    @property
    def pose(self) -> NDArray[np.float64]:
        return self.T.copy()

    def link_impulses(self) -> dict[str, NDArray[np.float64]]:
        return {self.holder: np.array([0.0, 0.0, 1.0])} if self.holder else {}

    def carry_to(self, position: ArrayLike) -> None:
        self.shift = np.asarray(position, np.float64) - self.T[:3, 3]


class Puppet:
    """A hand whose joints are where they are told to be."""

    def __init__(self, q: ArrayLike) -> None:
        self.q = np.asarray(q, np.float64)

    def set_targets(self, q: ArrayLike, velocity: ArrayLike | None = None) -> None:
        self.q = np.asarray(q, np.float64)

    def link_pose(self, name: str) -> NDArray[np.float64]:
        return np.eye(4)


class PointWorld:
    """Points without contacts. A link holds all of them for ever, from when they are at the origin; others fall.

    Where there is a carrier, points that are not held ride on it.
    """

    frequency, asleep = 100, False

    def __init__(self, gravity: ArrayLike, holder: str) -> None:
        self.gravity, self.holder = np.asarray(gravity, np.float64), holder
        self.objects: list[Thing] = []
        self.carrier: Thing | None = None

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            for thing in self.objects:
                if self.carrier is None and not thing.holder:
                    thing.velocity += self.gravity / self.frequency
                    thing.T[:3, 3] += thing.velocity / self.frequency
                elif self.carrier is not None and not (thing.holder and np.linalg.norm(thing.T[:3, 3]) < 1e-6):
                    thing.T[:3, 3] += self.carrier.shift
            if self.carrier is not None:
                self.carrier.T[:3, 3] += self.carrier.shift
                self.carrier.shift = np.zeros(3)

    def add_hand(self, hand: Hand, T_world_hand: ArrayLike, q: ArrayLike) -> engine.Robot:
        return Puppet(q)

    def add_arm(self, hand: Hand, q: ArrayLike) -> engine.Robot:
        raise NotImplementedError

    def add_object(self, prepared: PreparedObject, T_world_object: ArrayLike, name: str) -> engine.Body:
        self.objects.append(Thing(T_world_object, self.holder))
        return self.objects[-1]

    def add_box(self, half_size: ArrayLike, T_world_box: ArrayLike, name: str) -> engine.Body:
        return Thing(T_world_box)

    def add_carrier(self, half_size: ArrayLike, T_world_box: ArrayLike, name: str) -> engine.Carrier:
        self.carrier = Thing(T_world_box)
        return self.carrier


@pytest.fixture
def in_point_world(monkeypatch) -> Callable[[str], None]:
    """Let tests of grasps run in a :class:`PointWorld` whose objects a link holds ('' none)."""

    def use(holder: str) -> None:
        def make(settings: PhysicsParameters, gravity: ArrayLike = (0.0, 0.0, -GRAVITY)) -> engine.World:
            return PointWorld(gravity, holder)

        for module in ("holding", "settling", "table_pick"):
            monkeypatch.setattr(f"pipeline.physics.{module}.make_world", make)

    return use


def test_holding_and_falling_in_another_engine(in_point_world) -> None:
    q, squeeze_q, held = clamped_block()
    limits = ValidateParameters(early_rejection=False)
    in_point_world(held.assigned_links[0])
    good = hold_in_gravities(SETTINGS, limits, [held], q, squeeze_q, HAND)
    assert good.failed_direction == "" and good.in_contact.all() and good.drift.max() == 0
    in_point_world("")
    fallen = hold_in_gravities(SETTINGS, limits, [held], q, squeeze_q, HAND)
    # Looked at every 10 steps of 1/100 s: n semi-implicit Euler steps fall by g n (n + 1) / 2 h^2.
    falls = [GRAVITY * n * (n + 1) / 2 / 100**2 for n in range(10, 260, 10)]
    lost = next(fall for fall in falls if fall > LOST_DISTANCE)
    np.testing.assert_allclose(fallen.drift, lost)
    assert not fallen.any_contact.any()


def test_settling_in_another_engine(in_point_world) -> None:
    q, squeeze_q, held = clamped_block()
    in_point_world("")
    held_q, T_hand_held = settle_grasp(held.prepared, held.T_hand_object, q, squeeze_q, SETTINGS, (), HAND)
    np.testing.assert_allclose(held_q, squeeze_q)
    np.testing.assert_array_equal(T_hand_held, held.T_hand_object)  # there is no gravity


def test_the_tabletop_test_in_another_engine(in_point_world) -> None:
    q, squeeze_q, held = clamped_block()
    approach = Approach(q, np.array([0.0, 0.0, 1.0]), 0.05, penetrations=0, clearance=0.0)
    grasp, limits = HeldGrasp((held,), q, squeeze_q, HAND), ValidateParameters()
    for holder, drift, failure in ((held.assigned_links[0], 0.0, ""), ("", DROP_DISTANCE, "table:drop")):
        in_point_world(holder)
        pick = pick_from_support(SETTINGS, limits, grasp, np.eye(4), approach)
        assert pick.push == pytest.approx(0, abs=1e-6) and not pick.touched_support
        assert pick.drift == pytest.approx(drift) and table_failure(pick, limits) == failure


def imports(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def test_sapien_stays_behind_the_interface() -> None:
    own = {"world", "sapien_world", "sapien_bodies", "sapien_robots", "sapien_holding"}
    for path in sorted((ROOT / "pipeline").rglob("*.py")):
        room, name = path.parent.name, path.stem
        used = imports(path)
        sapien = {module for module in used if module.split(".")[0] == "sapien"}
        behind = {module for module in used if module.startswith("pipeline.physics.sapien_")}
        if (room, name) == ("validate", "table"):  # the gravities of all candidates at once on a GPU
            behind = {module for module in behind if not module.startswith("pipeline.physics.sapien_holding")}
        if room != "physics" or name not in own:
            assert not behind, path
            assert not sapien or (room, name) == ("replay", "sapien_camera"), path  # pictures by its renderer
