"""The arm of a plan on a simulated Franka Research 3 that speaks the real robot's protocol."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from pipeline.evaluate.scene import START_ARM
from pipeline.plan.fr3 import check_fr3
from pipeline.plan.limits import Waypoints
from tests.evaluate.conftest import HAND

CLIENT = Path(__file__).with_name("franka_client.py")
WITH = ["--with", "franky-sim==1.0.4", "--with", "franky-control==2.0.0"]
PYTHON = ["uv", "run", "--no-project", "--quiet", "--python", "3.11", *WITH, "python"]
STEP = 0.02  # s between way-points, as in plans
CREEP = 0.1  # s, time constant of the simulated drives (their damping over their stiffness)
JOINED = 0.3  # s, after which the arm, which has crept near the start, is on the path
PATH = 0.005  # rad between what was commanded and the planned path
LAG = 0.01  # rad between what was measured and what such drives make of the commands


def waypoints() -> Waypoints:
    """Out, a rest in which the hand would close, and half of the way back, by polynomials of fifth order."""
    share = np.linspace(0, 1, 51)
    move = share**3 * (10 - 15 * share + 6 * share**2)
    speed = 30 * share**2 * (1 - share) ** 2
    way = np.array([0.4, 0.2, -0.3, 0.3, 0.2, -0.2, 0.4])
    progress = np.concatenate([move, np.ones(25), 1 - move[1:] / 2])
    rate = np.concatenate([speed, np.zeros(25), -speed[1:] / 2])
    q = np.concatenate([START_ARM + progress[:, None] * way, np.tile(HAND.start, (len(progress), 1))], axis=1)
    phases = ("home", *["out"] * 50, *["rest"] * 25, *["back"] * 50)
    return Waypoints(STEP * np.arange(len(q)), phases, q, rate[:, None] * way)


@pytest.mark.slow
def test_what_the_robot_executes_is_the_plan(tmp_path):
    plan = waypoints()
    assert [check.sentence() for check in check_fr3(plan) if not check.passed] == []
    ready = subprocess.run([*PYTHON, "-c", "import franky, franky_sim"], capture_output=True, text=True)
    if ready.returncode:
        pytest.skip(f"franky-sim and franky-control cannot be installed: {ready.stderr.strip()[-200:]}")
    points = [
        {"time": time, "phase": phase, "position": q, "arm_velocity": velocity}
        for time, phase, q, velocity in plan.rows()
    ]
    (tmp_path / "plan.json").write_text(json.dumps({"waypoints": points}))
    command = [*PYTHON, str(CLIENT), str(tmp_path / "plan.json"), str(tmp_path / "result.json")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "result.json").read_text())
    time, commanded, measured = (np.array(result[name]) for name in ("time", "commanded", "measured"))
    spline = CubicSpline(plan.times, plan.q[:, :7], bc_type="clamped")
    assert time[-1] == pytest.approx(plan.times[-1], abs=0.1)
    away, _ = cKDTree(spline(np.arange(0, plan.times[-1], 0.0005))).query(commanded)
    assert away[time > JOINED].max() < PATH
    np.testing.assert_allclose(commanded[-1], plan.q[-1, :7], atol=1e-4)
    resting = (time > 1.2) & (time < 1.4)  # out and still there
    np.testing.assert_allclose(commanded[resting], np.broadcast_to(plan.q[60, :7], commanded[resting].shape), atol=1e-4)
    followed = [measured[0]]
    for target, step in zip(commanded[1:], np.diff(time), strict=True):
        followed.append(followed[-1] + (target - followed[-1]) * step / CREEP)
    assert np.abs(np.array(followed) - measured).max() < LAG
