"""What a trial draws from its seed, and what that does to physics and to what the robot believes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from pipeline.evaluate.disturbance import TrialDisturbance, believed_pose, draw
from pipeline.evaluate.execution import Run
from pipeline.evaluate.scene import START_ARM, build_scene, placed, placement_offsets
from pipeline.evaluate.sequence import Phase, rest_phase
from pipeline.evaluate.trial import TrialInput, run_trial
from pipeline.records.parameters.conditions import DistributionParameters
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.tables import DRAWN, TRIALS, read_table, write_table
from pipeline.shapes.mass import weighted
from tests.evaluate.conftest import HAND
from tests.pairs import PAIR

RANGES = DistributionParameters()
JOINTS = len(START_ARM) + len(HAND.start)


def draws(count: int, ranges: DistributionParameters = RANGES) -> list[TrialDisturbance]:
    return [draw(ranges, seed, 2, JOINTS) for seed in range(count)]


def quiet(**changes: Any) -> TrialDisturbance:
    """A draw that changes nothing but what is named."""
    zeros = np.zeros((2, 3))
    nothing = TrialDisturbance(0.9, 0.7, np.ones(2), zeros, zeros, zeros, zeros, 0.1, 0, np.zeros(JOINTS))
    return replace(nothing, **changes)


def test_draws_fill_their_ranges() -> None:
    found = draws(400)
    masses = np.concatenate([one.mass_factors for one in found])
    assert 0.5 <= masses.min() < 0.52 and 1.93 < masses.max() <= 2.0
    assert np.mean(masses < 1) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(800))  # half of a uniform logarithm
    centres = np.linalg.norm(np.concatenate([one.centre_offsets for one in found]), axis=1)
    assert centres.max() <= 0.01
    assert np.mean(centres < 0.005) == pytest.approx(1 / 8, abs=0.05)  # uniform in a ball: as volumes
    for values, low, high in (
        ([one.friction for one in found], 0.3, 0.9),
        ([one.torque_limit for one in found], 0.35, 0.7),
        ([np.linalg.norm(one.position_errors[0]) for one in found], 0.0, 0.01),
        ([np.linalg.norm(one.rotation_errors[1]) for one in found], 0.0, 0.17453),
        ([np.linalg.norm(one.shoves[0]) for one in found], 0.0, 1.0),
        ([one.joint_errors[3] for one in found], -0.005, 0.005),
    ):
        assert low <= min(values) and max(values) <= high
        assert np.mean(values) == pytest.approx((low + high) / 2, abs=4 * (high - low) / np.sqrt(12 * 400))
    assert {one.latency for one in found} == {0, 1, 2, 3}
    assert all((one.position_errors[:, 2] == 0).all() for one in found)


def test_draws_are_independent_and_another_range_stretches_its_own() -> None:
    found = draws(400)
    columns = [
        [one.friction for one in found],
        [one.torque_limit for one in found],
        [one.mass_factors[0] for one in found],
        [one.mass_factors[1] for one in found],
        [one.position_errors[0, 0] for one in found],
        [one.shoves[0, 0] for one in found],
    ]
    correlations = np.corrcoef(columns) - np.eye(len(columns))
    assert np.abs(correlations).max() < 4 / np.sqrt(400)
    wider = draw(RANGES.model_copy(update={"shove_force": 2.0}), 5, 2, JOINTS)
    np.testing.assert_allclose(wider.shoves, 2 * draws(6)[5].shoves)
    np.testing.assert_array_equal(wider.position_errors, draws(6)[5].position_errors)


def test_physics_has_the_drawn_friction_and_torque() -> None:
    physics = quiet(friction=0.4, torque_limit=0.5).physics(PhysicsParameters())
    assert {value for name, value in dict(physics).items() if "friction" in name} == {0.4}
    assert physics.hand_torque_limit == 0.5


def test_a_believed_object_is_off_but_stands_where_it_stands() -> None:
    box = np.array(np.meshgrid([-0.02, 0.02], [-0.02, 0.02], [-0.05, 0.05])).reshape(3, 8).T
    T = np.eye(4)
    T[:3, 3] = (0.5, 0.1, 0.15)
    turn = np.array([0.1, 0.0, 0.0])
    found = believed_pose(T, np.array([0.01, 0.0, 0.0]), turn, box)
    np.testing.assert_allclose(found[:3, :3], Rotation.from_rotvec(turn).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(found[:2, 3], [0.51, 0.1])
    corners = box @ found[:3, :3].T + found[:3, 3]
    assert corners[:, 2].min() == pytest.approx(0.1, abs=1e-12)
    assert believed_pose(T, np.zeros(3), turn)[2, 3] == 0.15  # in the hand it stands on nothing


def test_an_object_of_another_mass_and_centre_has_the_same_shape(objects) -> None:
    cube = objects[0]
    centre = np.array([0.0, 0.0, 0.01])
    own = weighted(cube, 2.0, centre)
    assert own.mass == 2 * cube.mass
    np.testing.assert_allclose(own.inertia, 2 * cube.inertia)
    np.testing.assert_allclose(own.parts[0][0] + centre, cube.parts[0][0])
    np.testing.assert_allclose(own.vertices + centre, cube.vertices)


def scene_of(objects, drawn: TrialDisturbance | None, above: float = 0.0) -> Run:
    """Objects at their places, or that far above them, m."""
    settings = EvaluateParameters(perturbation=0.0)
    poses = placed(PAIR, objects, settings, placement_offsets(2, settings, np.random.default_rng(0)))
    for T in poses:
        T[2, 3] += above
    scene = build_scene(HAND, objects, settings, PhysicsParameters(), poses, disturbance=drawn)
    return Run(scene, settings, rest=poses, disturbance=drawn)


def test_an_object_whose_centre_is_off_stands_where_it_was_put(objects) -> None:
    centres = np.array([[0.008, 0.0, 0.004], [0.0, -0.009, -0.002]])
    run = scene_of(objects, quiet(centre_offsets=centres, mass_factors=np.array([2.0, 0.5])))
    rest = [T.copy() for T in run.rest]
    run.settle(rest_phase("settle", run.posture, 0.5, run.settings))
    for index, T in enumerate(rest):
        np.testing.assert_allclose(run.pose(index), T, atol=1e-3)


def test_targets_arrive_as_late_as_drawn_and_less_the_joint_errors(objects, monkeypatch) -> None:
    errors = 0.001 * np.arange(JOINTS)
    run = scene_of(objects, quiet(latency=2, joint_errors=errors))
    sent: list[np.ndarray] = []
    monkeypatch.setattr(type(run.scene.robot), "set_targets", lambda robot, q, velocity=None: sent.append(np.array(q)))
    arm = START_ARM + 0.01 * np.arange(1, 6)[:, None]
    run.settle(Phase("settle", arm, np.zeros_like(arm), np.tile(HAND.start, (5, 1))))
    np.testing.assert_allclose(sent, np.concatenate([arm[:3], np.tile(HAND.start, (3, 1))], axis=1) - errors)
    measured = run.measured_posture()
    np.testing.assert_allclose(measured.hand, run.scene.robot.q[7:] + errors[7:])
    np.testing.assert_array_equal(measured.arm, arm[-1])


def test_a_shove_gives_an_object_its_momentum(objects) -> None:
    """Force times time is mass times velocity: an object in free fall, shoved half-way through the hold."""
    shoves = np.array([[0.5, 0.0, 0.0], [0.0, -0.4, 0.0]])
    run = scene_of(objects, quiet(shoves=shoves, mass_factors=np.array([2.0, 1.0])), above=50.0)
    with pytest.raises(Exception, match="dropped in hold"):
        run.execute([rest_phase("hold", run.posture, 0.4, run.settings)])
    for index, mass in enumerate((2.0 * objects[0].mass, objects[1].mass)):
        velocity = np.asarray(run.scene.objects[index].body.component.linear_velocity)
        np.testing.assert_allclose(velocity[:2], shoves[index, :2] * 0.1 / mass, rtol=1e-4)


@pytest.fixture(scope="module")
def disturbed(trial_input: Callable[..., TrialInput]) -> dict[str, Any]:
    return run_trial(trial_input(distribution=RANGES, seed=8))


def test_a_disturbed_trial_says_what_it_drew(disturbed, trial_input, tmp_path) -> None:
    drawn = draw(RANGES, 8, 2, JOINTS)
    assert disturbed["friction"] == drawn.friction and disturbed["latency"] == drawn.latency
    rows = [disturbed, run_trial(trial_input(grasps=()))]
    write_table(tmp_path / "cube.parquet", pd.DataFrame(rows, columns=TRIALS.names), TRIALS)
    back = read_table(tmp_path / "cube.parquet", TRIALS, "evaluate")
    np.testing.assert_array_equal(np.stack(back["shoves"][0]), drawn.shoves)
    assert back.loc[1, DRAWN.names].isna().all()


def test_the_same_draw_gives_the_same_bits(disturbed, trial_input) -> None:
    again = run_trial(trial_input(distribution=RANGES, seed=8))
    for name in TRIALS.names:
        np.testing.assert_array_equal(np.asarray(again[name]), np.asarray(disturbed[name]))


def test_what_the_robot_believes_decides_where_it_goes(trial_input) -> None:
    """An object believed a hand's breadth away is missed."""
    far = RANGES.model_copy(update={"position_error": 0.1})
    seed = next(seed for seed in range(99) if np.linalg.norm(draw(far, seed, 2, JOINTS).position_errors[0]) > 0.06)
    row = run_trial(trial_input(distribution=far, seed=seed))
    assert not row["success"] and row["heights"][0] < 0.05
