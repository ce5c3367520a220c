"""Limits of the FR3: figures from its maker's description, and motions that keep or break them."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.plan.fr3 import LOWER, UPPER, VELOCITY, check_fr3, fastest
from pipeline.plan.limits import Waypoints


def moving(joint: int, begin: float, end: float, seconds: float) -> Waypoints:
    """One joint from rest to rest by the polynomial of fifth order: fastest 1.875 way / time, 5.77 way / time^2."""
    share = np.linspace(0, 1, 201)
    q = np.tile(np.concatenate([(LOWER + UPPER) / 2, np.zeros(16)]), (201, 1))
    q[:, joint] = begin + (end - begin) * share**3 * (10 - 15 * share + 6 * share**2)
    velocity = np.zeros((201, 7))
    return Waypoints(seconds * share, ("home", *["test"] * 200), q, velocity)


def used(waypoints: Waypoints) -> dict[str, float]:
    return {check.name: check.used for check in check_fr3(waypoints)}


def test_a_joint_can_always_stop_before_its_limit():
    """At the highest speed that is allowed anywhere, braking as hard as assumed ends at the limit or before."""
    q = np.linspace(LOWER, UPPER, 400)
    low, high = fastest(q)
    from pipeline.plan.fr3 import DECELERATION

    assert (q + high**2 / (2 * DECELERATION) <= UPPER + 1e-9).all()
    assert (q - low**2 / (2 * DECELERATION) >= LOWER - 1e-9).all()
    np.testing.assert_allclose(high[200], VELOCITY, rtol=0.4)  # in the middle nearly the joint's own limit
    assert high[-1].max() < 1e-5 and low[0].min() > -1e-5


def test_speed_and_acceleration_of_a_known_motion():
    found = used(moving(0, -0.5, 0.5, 1.5))
    assert found["FR3 velocity"] == pytest.approx(1.875 / 1.5 / 2.62, rel=1e-3)
    assert found["FR3 acceleration"] == pytest.approx(10 / np.sqrt(3) / 1.5**2 / 10.0, rel=1e-2)
    assert max(found.values()) < 1


def test_what_the_panda_may_the_fr3_may_not():
    """The Panda's sixth joint may go to -0.0175 rad, the FR3's to 0.4398; and near a limit it must be slow."""
    assert used(moving(5, 0.2, 1.0, 3.0))["FR3 position"] > 1
    near = {check.name: check for check in check_fr3(moving(0, 2.0, 2.85, 0.8))}
    assert near["FR3 position"].passed and not near["FR3 velocity"].passed
    assert near["FR3 velocity"].upper < 2.62 and "franka_description" in near["FR3 velocity"].source
