"""Exported sequences: their form, the limits that they must keep, and that they do in simulation what they promise."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.evaluate.scene import START_ARM, placed
from pipeline.evaluate.sequence import Phase
from pipeline.hand.robot import robot_joint_names
from pipeline.motion.arm_model import ARM_ACCELERATION, ArmModel
from pipeline.plan import __main__ as command
from pipeline.plan.limits import ARM_LOWER, ARM_UPPER, ARM_VELOCITY, Waypoints, check_limits, weight_torques
from pipeline.plan.playback import phases_of, play
from pipeline.plan.proposal import StandingObject, Table, propose, squeeze_torque, waypoints_of
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.objects import write_prepared_object
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.poses import pose_matrix
from pipeline.records.reconstructions import ReconstructedObject, write_reconstruction
from pipeline.records.tables import MERGED, write_table
from tests.evaluate.conftest import HAND
from tests.pairs import PAIR

SETTINGS, PHYSICS = EvaluateParameters(), PhysicsParameters()
ORDER = [f"{verb} {which}" for which in ("first", "second") for verb in ("open", "approach", "enter", "close", "lift")]
PASSING = np.zeros(16)


@pytest.fixture(scope="module")
def standing(objects) -> Table:
    poses = placed(PAIR, objects, SETTINGS, np.zeros((2, 3)))
    return Table((StandingObject(objects[0], poses[0]), StandingObject(objects[1], poses[1])))


@pytest.fixture(scope="module")
def phases(standing: Table, grasp) -> list[Phase]:
    return propose(standing, grasp, HAND, SETTINGS, np.random.default_rng(0))


@pytest.fixture(scope="module")
def waypoints(phases) -> Waypoints:
    return waypoints_of(phases, HAND, SETTINGS.control_frequency)


def resting(count: int = 5) -> Waypoints:
    """A robot that stays at its start posture, 0.1 s between way-points."""
    q = np.tile(np.concatenate([START_ARM, HAND.start]), (count, 1))
    return Waypoints(0.1 * np.arange(count), ("home", *["test"] * (count - 1)), q, np.zeros((count, 7)))


def failed(waypoints: Waypoints, torque: np.ndarray = PASSING) -> dict[str, str]:
    return {check.name: check.sentence() for check in check_limits(HAND, waypoints, torque) if not check.passed}


def test_phases_come_in_order_and_join(phases: list[Phase], waypoints: Waypoints) -> None:
    assert [phase.name for phase in phases] == [*ORDER, "hold"]
    assert waypoints.phases[0] == "home" and len(waypoints.times) == 1 + sum(len(phase.arm) for phase in phases)
    np.testing.assert_array_equal(waypoints.q[0], np.concatenate([START_ARM, HAND.start]))
    np.testing.assert_allclose(np.diff(waypoints.times), 1 / SETTINGS.control_frequency)
    # nothing jumps: no joint moves farther between way-points than at its largest speed
    assert (np.abs(np.diff(waypoints.q[:, :7], axis=0)) * SETTINGS.control_frequency <= ARM_VELOCITY).all()


def test_told_velocities_are_those_of_the_positions(waypoints: Waypoints) -> None:
    """The trapezoid rule on velocities gives back the positions, up to the change of acceleration within a step."""
    step = 1 / SETTINGS.control_frequency
    travelled = (waypoints.arm_velocity[1:] + waypoints.arm_velocity[:-1]) / 2 * step
    worst = np.abs(travelled - np.diff(waypoints.q[:, :7], axis=0)).max()
    assert worst < ARM_ACCELERATION.max() * step**2


def test_hand_goes_where_the_grasps_are(standing: Table, grasp, phases: list[Phase]) -> None:
    by_name = {phase.name: phase for phase in phases}
    for index, (name, T_hand_object) in enumerate(
        zip(("close first", "close second"), (pick.T_hand_object for pick in grasp.picks), strict=True)
    ):
        last = by_name[name].last
        hand = ArmModel(last.hand, HAND).hand_pose(last.arm)
        np.testing.assert_allclose(hand @ T_hand_object, standing.objects[index].T_world_object, atol=3e-3)
    lifted = ArmModel(grasp.q, HAND).hand_pose(by_name["hold"].last.arm)[2, 3]
    closed = ArmModel(grasp.q, HAND).hand_pose(by_name["close second"].last.arm)[2, 3]
    assert lifted - closed == pytest.approx(SETTINGS.lift_height, abs=1e-3)


def test_recorded_grasp_keeps_all_limits(waypoints: Waypoints, grasp) -> None:
    checks = check_limits(HAND, waypoints, squeeze_torque(grasp, PHYSICS))
    assert [check.sentence() for check in checks if not check.passed] == []
    assert {check.name.split()[0] for check in checks} == {"arm", "hand"}


def test_limits_of_the_arm_are_those_of_its_description() -> None:
    arm = ArmModel(HAND.start, HAND)
    np.testing.assert_allclose(arm.lower, ARM_LOWER)
    np.testing.assert_allclose(arm.upper, ARM_UPPER)
    np.testing.assert_allclose(arm.velocity, ARM_VELOCITY)


def test_rest_breaks_nothing() -> None:
    assert failed(resting()) == {}


def test_position_beyond_a_limit_is_told() -> None:
    waypoints = resting()
    waypoints.q[:, 3] = -0.05
    waypoints.q[:, 7 + 12] = 0.2
    found = failed(waypoints)
    assert set(found) == {"arm position", "hand position"}
    assert (
        "arm position of panda_joint4 is -0.05 rad at 0.00 s (home), beyond the hardware's -0.0698"
        in found["arm position"]
    )
    assert "joint_12.0 is 0.2 rad" in found["hand position"] and "0.263" in found["hand position"]


def smooth_move(distance: float, seconds: float, step: float) -> Waypoints:
    """Joint 2 moves by a cubic of time, at rest at both ends, which a cubic spline repeats exactly.

    Largest velocity 1.5 distance / seconds, largest acceleration 6 distance / seconds^2, jerk 12 distance / seconds^3.
    """
    waypoints = resting(round(seconds / step) + 1)
    share = np.linspace(0.0, 1.0, len(waypoints.times))
    waypoints.q[:, 1] += distance * share**2 * (3 - 2 * share)
    waypoints.arm_velocity[:, 1] = 6 * distance / seconds * share * (1 - share)
    return replace(waypoints, times=seconds * share)


@pytest.mark.parametrize(
    ("distance", "seconds", "step", "name", "value"),
    [
        (2.3, 1.5, 0.02, "arm velocity", 2.3),  # limit 2.175; the fastest moment lies between way-points
        (1 / 3, 0.5, 0.02, "arm acceleration", 8.0),  # limit 7.5
        (9e-6, 0.003, 0.001, "arm jerk", 4000.0),  # limit 3750
    ],
)
def test_fast_moves_are_told(distance: float, seconds: float, step: float, name: str, value: float) -> None:
    checks = check_limits(HAND, smooth_move(distance, seconds, step), PASSING)
    assert [check.name for check in checks if not check.passed] == [name]
    found = next(check for check in checks if check.name == name)
    assert abs(found.value) == pytest.approx(value, rel=1e-5) and found.joint == "panda_joint2"
    assert failed(smooth_move(0.9 * distance, seconds, step)) == {}


def test_jump_that_no_told_velocity_shows_is_told() -> None:
    """2 rad/s on the mean, but from rest to rest in 20 ms: at least 4 * 0.04 / 0.02^2 = 400 rad/s2."""
    rest = resting(9)
    waypoints = replace(rest, times=0.02 * np.arange(9))
    waypoints.q[4:, 1] += 0.04
    assert "arm acceleration" in failed(waypoints)


def test_told_velocity_that_no_arm_follows_is_told() -> None:
    told = resting()
    told.arm_velocity[2, 1] = 0.8
    assert set(failed(told)) == {"arm acceleration"}
    assert "panda_joint2 is 8 rad/s2 at 0.20 s (test)" in failed(told)["arm acceleration"]


def test_fast_finger_is_told() -> None:
    waypoints = resting()
    waypoints.q[2:, 7 + 1] += 0.35
    found = failed(waypoints)
    assert set(found) == {"hand velocity"}
    assert "joint_1.0 is 3.5 rad/s at 0.20 s (test)" in found["hand velocity"]
    assert "evaluate.open_seconds" in found["hand velocity"]


def test_weight_alone_can_break_the_limit_of_a_finger(monkeypatch) -> None:
    monkeypatch.setattr("pipeline.plan.limits.HAND_TORQUE", 0.01)
    assert set(failed(resting())) == {"hand torque of the fingers' weight"}


def test_hard_squeeze_is_told(grasp) -> None:
    strong = PhysicsParameters(hand_torque_limit=50.0)
    demand = np.abs(strong.hand_stiffness * (grasp.squeeze_q - grasp.q)).max()
    assert np.abs(squeeze_torque(grasp, PHYSICS)).max() == pytest.approx(0.7)
    assert np.abs(squeeze_torque(grasp, strong)).max() == pytest.approx(min(demand, 50.0))
    found = failed(resting(), squeeze_torque(grasp, strong))
    assert set(found) == {"hand torque of squeezing"} and "0.7 N m" in found["hand torque of squeezing"]


def test_weight_of_fingers_against_the_change_of_potential_energy() -> None:
    """Torques of gravity are the slopes of the potential energy of all links (central differences)."""
    import pinocchio as pin

    from pipeline.hand.robot import robot_file

    model = pin.buildModelFromUrdf(str(robot_file(True, HAND)))
    data = model.createData()

    def energy(q: np.ndarray) -> float:
        configuration = np.zeros(model.nq)
        for name, angle in zip(robot_joint_names(HAND), q, strict=True):
            configuration[model.joints[model.getJointId(name)].idx_q] = angle
        return float(pin.computePotentialEnergy(model, data, configuration))

    q = np.concatenate([START_ARM, HAND.start + 0.1])
    slopes = [(energy(q + 1e-4 * e) - energy(q - 1e-4 * e)) / 2e-4 for e in np.eye(23)[7:]]
    np.testing.assert_allclose(weight_torques(HAND, q[None])[0], slopes, atol=1e-6)
    assert 0.01 < np.abs(slopes).max() < 0.7


def test_playback_runs_the_exported_way_points(phases, waypoints: Waypoints) -> None:
    again = phases_of(waypoints)
    assert [phase.name for phase in again] == [phase.name for phase in phases]
    for one, other in zip(again, phases, strict=True):
        for part in ("arm", "arm_velocity", "hand"):
            np.testing.assert_array_equal(getattr(one, part), getattr(other, part))


def test_dry_run_lifts_both_objects(standing: Table, waypoints: Waypoints) -> None:
    outcome = play(HAND, standing, waypoints, SETTINGS, PHYSICS)
    assert outcome["reason"] == "" and outcome["success"]
    steps = (len(waypoints.times) - 1) / SETTINGS.control_frequency + SETTINGS.settle_seconds
    assert outcome["steps"] == round(steps * PHYSICS.frequency)


def test_dry_run_tells_when_the_objects_stand_elsewhere(standing: Table, waypoints: Waypoints) -> None:
    """The plan is blind: an object 8 cm from where it was planned for is not picked."""
    away = standing.objects[0].T_world_object.copy()
    away[0, 3] += 0.08
    moved = Table((StandingObject(standing.objects[0].prepared, away), standing.objects[1]))
    outcome = play(HAND, moved, waypoints, SETTINGS, PHYSICS)
    assert not outcome["success"] and outcome["reason"] in ("first slip", "collision on approach")


def test_other_objects_are_kept_away_from(standing: Table, grasp, objects) -> None:
    """A cylinder where the hand must go leaves no motion; far away it changes nothing."""
    on_it, far = np.eye(4), np.eye(4)
    on_it[:3, 3] = standing.objects[0].T_world_object[:3, 3] + [0.0, 0.0, 0.12]
    far[:3, 3] = (0.67, -0.17, 0.1525)
    blocked = replace(standing, others=(StandingObject(objects[1], on_it),))
    with pytest.raises(UserError, match=r"no motion was found that picks cube with grasp \d+"):
        propose(blocked, grasp, HAND, SETTINGS, np.random.default_rng(0))
    free = replace(standing, others=(StandingObject(objects[1], far),))
    assert propose(free, grasp, HAND, SETTINGS, np.random.default_rng(0))[-1].name == "hold"


@pytest.fixture
def workplace(tmp_path: Path, repository: Path, objects, grasp_row, monkeypatch) -> Path:
    """Prepared objects and a table whose second row is accepted."""
    (tmp_path / "params.yaml").write_text((repository / "params.yaml").read_text())
    for prepared in objects:
        write_prepared_object(tmp_path / paths.prepared_folder(prepared.name), prepared)
    row = dict.fromkeys(MERGED.names) | grasp_row
    rows = [row | {"merged_id": 0, "rejected_by": "gravity"}, row | {"merged_id": 1, "rejected_by": ""}]
    write_table(tmp_path / "grasps.parquet", pd.DataFrame(rows, columns=MERGED.names), MERGED)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_command_writes_plan_and_dry_run(workplace: Path, capsys) -> None:
    assert command.main(["--table", "grasps.parquet", "--play", "--output", "out"]) == 0
    content = json.loads((workplace / "out/plan.json").read_text())
    assert content["joint_names"] == list(robot_joint_names(HAND))
    assert content["grasp"] == {"merged_id": 1, "table": "grasps.parquet"} and content["within_limits"]
    assert [phase["name"] for phase in content["phases"]] == [*ORDER, "hold"]
    ends = [phase["end"] for phase in content["phases"]]
    assert [0.0, *ends[:-1]] == [phase["begin"] for phase in content["phases"]]
    assert content["waypoints"][-1]["time"] == pytest.approx(ends[-1])
    assert all(check["passed"] and check["source"] for check in content["checks"])
    with open(workplace / "out/plan.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header[:2] == ["time", "phase"] and tuple(header[2:25]) == robot_joint_names(HAND) and len(header) == 32
    for row, waypoint in zip(rows, content["waypoints"], strict=True):
        numbers = [waypoint["time"], *waypoint["position"], *waypoint["arm_velocity"]]
        assert [row[1], *map(float, [row[0], *row[2:]])] == [waypoint["phase"], *numbers]
    assert json.loads((workplace / "out/playback.json").read_text())["success"]
    assert (workplace / "out/playback.png").stat().st_size > 10_000
    assert "both objects were lifted and held" in capsys.readouterr().out


def test_the_pair_of_a_table_of_several_is_named_by_its_second_object(workplace: Path, capsys) -> None:
    rows = pd.read_parquet("grasps.parquet")
    others = rows.assign(objects=[["cube", "plum"]] * len(rows), merged_id=range(len(rows)), rejected_by="")
    write_table(Path("many.parquet"), pd.concat([others, rows]), MERGED)
    assert command.main(["--table", "many.parquet"]) == 2
    assert "holds several pairs; choose one of plum, slender_cylinder with --second" in capsys.readouterr().err
    assert command.main(["--table", "many.parquet", "--second", "slender_cylinder", "--merged-id", "0"]) == 2
    assert "was refused (gravity)" in capsys.readouterr().err  # that pair's, not the plum's
    assert command.main(["--table", "many.parquet", "--second", "slender_cylinder"]) == 0
    content = json.loads(Path("plan/plan.json").read_text())
    assert [item["name"] for item in content["objects"]] == ["cube", "slender_cylinder"]
    write_table(Path("none.parquet"), rows[:0], MERGED)
    assert command.main(["--table", "none.parquet"]) == 2
    assert "holds no grasp at all" in capsys.readouterr().err


def test_command_refuses_to_export_what_the_hardware_cannot(workplace: Path, capsys) -> None:
    values = yaml.safe_load((workplace / "params.yaml").read_text())
    values["evaluate"]["open_seconds"] = 0.1
    (workplace / "params.yaml").write_text(yaml.safe_dump(values))
    (workplace / "plan").mkdir()
    (workplace / "plan/plan.csv").write_text("of an earlier plan")
    assert command.main(["--table", "grasps.parquet", "--play"]) == 2
    error = capsys.readouterr().err
    assert len(error.strip().splitlines()) == 1
    assert error.startswith("plan: hand velocity of joint_") and "hardware's 3.14 rad/s" in error.replace(
        "-3.14", "3.14"
    )
    content = json.loads((workplace / "plan/plan.json").read_text())
    assert not content["within_limits"]
    assert [check["name"] for check in content["checks"] if not check["passed"]] == ["hand velocity"]
    assert sorted(path.name for path in (workplace / "plan").iterdir()) == ["plan.json"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--table", "absent.parquet"], "absent.parquet is missing or no table of two-object grasps; name one of data"),
        (["--table", "params.yaml"], "params.yaml is missing or no table of two-object grasps"),
        (["--place0", "nan", "0", "0"], "cube would stand at x nan m, y 0 m, not wholly on the sponge"),
        (["--output", "params.yaml"], "params.yaml is a file; name a folder with --output"),
        (["--output", "params.yaml/plan"], "cannot write params.yaml/plan"),
        (["--merged-id", "0"], "grasp 0 of grasps.parquet was refused (gravity)"),
        (["--merged-id", "7"], "grasps.parquet has no grasp 7"),
        (
            ["--second", "soup_can"],
            "has no grasps that pick soup_can second; choose one of slender_cylinder with --second",
        ),
        (["--place0", "0.9", "0", "0"], "cube would stand at x 0.9 m, y 0 m, not wholly on the sponge"),
        # its middle is on the sponge (up to 0.7), its edge, 21 mm farther, is not; then turned, by its corner
        (["--place0", "0.69", "0", "0"], "cube would stand at x 0.69 m, y 0 m, not wholly on the sponge"),
        (["--place0", "0.675", "0", "45"], "cube would stand at x 0.675 m, y 0 m, not wholly on the sponge"),
        (["--place0", "0.5", "0.08", "0"], "cube and slender_cylinder would stand in each other"),
    ],
)
def test_bad_input_is_one_sentence(workplace: Path, capsys, arguments: list[str], sentence: str) -> None:
    assert command.main(["--table", "grasps.parquet", *arguments]) == 2
    error = capsys.readouterr().err
    assert sentence in error and len(error.strip().splitlines()) == 1
    assert not (workplace / "plan").exists()


@pytest.fixture
def captured(workplace: Path, objects) -> Path:
    """A reconstruction of three objects: the pair as it stands in trials, 2 mm too high, and a second cube."""
    middle = pose_matrix([0.5, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])
    shown = {}
    for prepared, T in zip(objects, placed(PAIR, objects, SETTINGS, np.zeros((2, 3))), strict=True):
        T_scene = np.linalg.inv(middle) @ T
        T_scene[2, 3] = 0.002 - prepared.bottom
        shown[prepared.name] = as_photos_show(prepared, T_scene)
    shown["other"] = replace(shown["cube"], T_scene_object=pose_matrix([0.17, -0.17, 0.023], [1.0, 0.0, 0.0, 0.0]))
    metrics = {"objects": {name: {} for name in shown}}
    write_reconstruction(paths.reconstruction_folder("demo"), shown, {}, metrics, {})
    return workplace


def as_photos_show(prepared, T_scene: np.ndarray) -> ReconstructedObject:
    points = np.repeat(prepared.vertices, 10, axis=0)
    seen = np.ones(len(points), bool)
    return ReconstructedObject(prepared.name, prepared.vertices, prepared.faces, points, points, seen, T_scene, 1e-4)


def test_objects_of_a_capture_stand_where_photos_show_them(captured: Path, capsys) -> None:
    assert command.main(["--table", "grasps.parquet", "--capture", "demo", "--output", "out"]) == 0, capsys.readouterr()
    content = json.loads((captured / "out/plan.json").read_text())
    assert [item["name"] for item in content["objects"]] == ["cube", "slender_cylinder"]
    assert [item["name"] for item in content["others"]] == ["other"]
    places = [np.array(item["T_world_object"])[:3, 3] for item in [*content["objects"], *content["others"]]]
    # upon the sponge, whose height the robot knows better than the photos
    np.testing.assert_allclose(places, [[0.5, -0.1, 0.121], [0.5, 0.1, 0.1525], [0.67, -0.17, 0.121]], atol=1e-6)
    table = command._captured(
        ("cube", "slender_cylinder"), command.Places((None, None), "demo", [0.5, 0.0, 90]), SETTINGS
    )
    np.testing.assert_allclose(table.objects[0].T_world_object[:3, 3], [0.6, 0.0, 0.121], atol=1e-6)
    np.testing.assert_allclose(table.objects[0].T_world_object[:3, 0], [0.0, 1.0, 0.0], atol=1e-6)
    far = ["--scene", "0.9", "0", "0", "--output", "far"]
    assert command.main(["--table", "grasps.parquet", "--capture", "demo", *far]) == 2
    assert "cube would stand at x 0.9 m" in capsys.readouterr().err


def test_capture_without_the_pair_is_one_sentence(captured: Path, capsys) -> None:
    folder = paths.reconstruction_folder("demo")
    (folder / "metrics.json").write_text('{"objects": {"other": {}}}')
    assert command.main(["--table", "grasps.parquet", "--capture", "demo"]) == 2
    assert "the capture demo does not show cube, but other" in capsys.readouterr().err
    assert command.main(["--table", "grasps.parquet", "--capture", "absent"]) == 2
    assert "run `dvc repro reconstruct`" in capsys.readouterr().err


def test_tables_of_other_frames_are_refused(captured: Path, capsys) -> None:
    """The frames of reconstructed and of prepared objects have different origins; the pipeline's tables are known."""
    for table, options, sentence in (
        ("data/sample/reconstructed/cube.parquet", [], "as photos show them; name their capture with --capture"),
        ("data/merge/cube.parquet", ["--capture", "demo"], "grasps of prepared objects, whose frames are not"),
        ("data/sample/learned/cube.parquet", ["--capture", "demo"], "grasps of prepared objects, whose frames are not"),
    ):
        Path(table).parent.mkdir(parents=True)
        Path(table).write_bytes(Path("grasps.parquet").read_bytes())
        assert command.main(["--table", table, *options]) == 2
        assert sentence in capsys.readouterr().err
        # the other way about the table is read, and its refused row is what stops the command
        right = [] if options else ["--capture", "demo"]
        assert command.main(["--table", table, *right, "--merged-id", "0"]) == 2
        assert "was refused (gravity)" in capsys.readouterr().err


def test_dry_run_that_fails_is_told_by_the_exit_code(workplace: Path, capsys) -> None:
    values = yaml.safe_load((workplace / "params.yaml").read_text())
    values["physics"] |= {"object_friction": 0.0, "tip_static_friction": 0.0, "tip_dynamic_friction": 0.0}
    (workplace / "params.yaml").write_text(yaml.safe_dump(values))
    assert command.main(["--table", "grasps.parquet", "--play", "--output", "out"]) == 1
    assert "dry run in simulation: ended early: first " in capsys.readouterr().out
    assert not json.loads((workplace / "out/playback.json").read_text())["success"]
