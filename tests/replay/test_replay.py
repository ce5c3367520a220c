"""Trials that are run again alone, their recordings, and what is shown of them."""

from __future__ import annotations

import os
import shutil
import socket
import urllib.request
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import yaml

from pipeline.evaluate.__main__ import evaluate
from pipeline.evaluate.conditions import evaluate as evaluate_series
from pipeline.evaluate.film import write_film
from pipeline.evaluate.recorder import Recorder
from pipeline.evaluate.rerun import TrialName, differing_columns, drawn_trials, known_trials, trial_name
from pipeline.evaluate.scene import START_ARM
from pipeline.evaluate.trial import run_trial
from pipeline.hand.model import load_hand
from pipeline.physics.sapien_bodies import SapienBody
from pipeline.pictures import film as video
from pipeline.pictures.appearance import appearance, moving_poses
from pipeline.pictures.camera import look_at
from pipeline.pictures.film import Film, drawn_moments, last_caption, raster, shown_moments, write_video
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.objects import write_prepared_object
from pipeline.records.opening_film import FOLDER, VIDEO, load_film
from pipeline.records.poses import pose_matrix
from pipeline.records.recordings import MOMENTS, About, Recording, read_recording, write_recording
from pipeline.records.sources import SOURCES
from pipeline.records.tables import MERGED, TRIALS, read_table, write_table
from pipeline.replay import __main__ as command
from pipeline.replay.renderers import RENDERERS
from pipeline.replay.sapien_camera import SapienCamera, why_unusable
from pipeline.replay.viewer import Viewer

HAND = load_hand("allegro")
NAME = "synthesized/cube/slender_cylinder/1"
TABLE = Path("data/evaluate/synthesized/cube.parquet")
DRAWN = "synthesized-drawn-sapien/cube/slender_cylinder/0"
DRAWN_TABLE = Path("data/evaluate/conditions/synthesized-drawn-sapien.parquet")
RECORDING = Path("replays/synthesized-cube-slender_cylinder-1.parquet")


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory, repository: Path, objects, grasp_row) -> Path:
    """A project of one pair, with a table of two trials made by the stage."""
    folder = tmp_path_factory.mktemp("project")
    before = Path.cwd()
    os.chdir(folder)
    try:
        values = yaml.safe_load((repository / "params.yaml").read_text())
        values["styles"] = {"pinch": ["cube"], "side": ["slender_cylinder"]}
        values["evaluate"]["trials"] = 2
        values["conditions"] |= {
            "pairs": [["cube", "slender_cylinder"]],
            "trials": 1,
            "settings": {"drawn": {"drawn": True}},
        }
        values["conditions"]["sources"] = ["synthesized"]
        values["compute"]["workers"] = 1
        values["reconstructed"] = {}
        Path("params.yaml").write_text(yaml.safe_dump(values))
        for prepared in objects:
            write_prepared_object(paths.prepared_folder(prepared.name), prepared)
        write_grasps(grasp_row, merged_id=4)
        evaluate("synthesized", "cube")
        evaluate_series("synthesized-drawn-sapien")
    finally:
        os.chdir(before)
    return folder


@pytest.fixture
def synthesized_alone(monkeypatch) -> None:
    """No other source has tables in this project."""
    monkeypatch.setattr("pipeline.records.sources.SOURCES", {"synthesized": SOURCES["synthesized"]})


def write_grasps(grasp_row: dict, merged_id: int) -> None:
    row = dict.fromkeys(MERGED.names) | grasp_row
    row |= {"merged_id": merged_id, "rejected_by": ""}
    rows = pd.DataFrame([row], columns=MERGED.names)
    write_table(paths.merged_file("cube"), rows, MERGED)


@pytest.fixture
def project(evaluated: Path, tmp_path: Path, monkeypatch) -> Path:
    """A copy of it to change, as working folder."""
    shutil.copytree(evaluated, tmp_path, dirs_exist_ok=True, ignore=shutil.ignore_patterns("replays"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def change_parameters(**values) -> None:
    content = yaml.safe_load(Path("params.yaml").read_text())
    for section, fields in values.items():
        content[section] = content[section] | fields if isinstance(fields, dict) else fields
    Path("params.yaml").write_text(yaml.safe_dump(content))


@pytest.fixture(scope="module")
def replayed(evaluated: Path) -> Recording:
    """The recording that the command writes of trial 1, which the table has after trial 0."""
    before = Path.cwd()
    os.chdir(evaluated)
    try:
        assert command.main([NAME, "--no-view"]) == 0
        return read_recording(RECORDING)
    finally:
        os.chdir(before)


@pytest.fixture
def short(replayed: Recording) -> Recording:
    """Its end, from the last lift on, every tenth moment."""
    chosen = [i for i, phase in enumerate(replayed.phase) if phase in ("lift second", "hold")][::10]
    return replace(
        replayed,
        time=replayed.time[chosen] - replayed.time[chosen[0]],
        phase=[replayed.phase[i] for i in chosen],
        robot_q=replayed.robot_q[chosen],
        poses=replayed.poses[:, chosen],
    )


def test_recording_agrees_with_the_table_of_the_stage(evaluated: Path, replayed: Recording) -> None:
    """What the stage wrote without looking on: the same states to the last bit at the end of every phase."""
    rows = read_table(evaluated / TABLE, TRIALS, "evaluate")
    row = rows[rows["trial"] == 1].iloc[0]
    phases = list(row["snapshot_phases"])
    assert row["success"] and list(dict.fromkeys(replayed.phase)) == phases
    ends = [len(replayed.phase) - 1 - replayed.phase[::-1].index(phase) for phase in phases]
    assert ends[-1] == len(replayed.time) - 1
    np.testing.assert_array_equal(replayed.robot_q[ends], np.stack(row["snapshot_robot_q"]))
    for index in (0, 1):
        np.testing.assert_array_equal(replayed.poses[index][ends], np.stack(row["snapshot_poses"][index]))
    # one moment per control period of 0.02 s = 4 steps of physics
    np.testing.assert_allclose(replayed.time, 0.02 * np.arange(1, row["steps"] // 4 + 1))
    assert replayed.about == About(NAME, ("cube", "slender_cylinder"), "success", 0.1)


def test_command_says_that_the_outcome_is_the_same(evaluated: Path, replayed: Recording, project: Path, capsys) -> None:
    """Looking on changes no column of the row that the stage wrote; recorded again, the file has the same bytes."""
    assert command.main([NAME, "--no-view"]) == 0
    told = capsys.readouterr().out
    assert f"{NAME}: the same outcome, to the last bit, as in {TABLE} (success, " in told
    assert f"{RECORDING}: {pq.read_metadata(RECORDING).num_rows} moments" in told
    assert pq.read_schema(RECORDING).equals(MOMENTS)
    assert RECORDING.read_bytes() == (evaluated / RECORDING).read_bytes()


def test_a_trial_under_a_distribution_is_replayed_to_the_bit(project: Path, capsys) -> None:
    """What it drew is drawn again from its seed; with another range it is another trial."""
    assert command.main([DRAWN, "--no-view"]) == 0
    assert f"{DRAWN}: the same outcome, to the last bit, as in {DRAWN_TABLE}" in capsys.readouterr().out
    change_parameters(conditions={"distribution": {"shove_force": 0.5}})
    assert command.main([DRAWN, "--no-view"]) == 1
    assert "columns that differ: shoves" in capsys.readouterr().out


def test_one_changed_bit_is_another_outcome(project: Path, capsys) -> None:
    DRAWN_TABLE.unlink()
    rows = read_table(TABLE, TRIALS, "evaluate")
    rows.at[1, "heights"] = np.nextafter(rows.at[1, "heights"], 1.0)
    rows.loc[1, "reason"] = "second slip"
    write_table(TABLE, rows, TRIALS)
    assert command.main(["--check", "9"]) == 1
    told = capsys.readouterr().out.splitlines()
    assert sorted(told[:2]) == [f"{NAME[:-1]}0: same", f"{NAME}: differs in reason, heights"]
    assert told[2] == "1 of 2 trials, drawn from 2, have the same outcome to the last bit"
    assert command.main([NAME, "--no-view"]) == 1
    told = capsys.readouterr().out
    assert "ANOTHER outcome than" in told and "columns that differ: reason, heights; `dvc status evaluate@" in told
    assert read_recording(RECORDING).about.outcome == "success (the table holds another outcome)"


def test_every_bit_counts() -> None:
    row = dict.fromkeys(TRIALS.names) | {"heights": [0.0], "offsets": [np.zeros(3)], "snapshot_poses": [[np.zeros(7)]]}
    assert differing_columns(row, row | {"heights": [-0.0]}, HAND) == ["heights"]
    assert differing_columns(row, row | {"offsets": [np.array([0.0, 5e-324, 0.0])]}, HAND) == ["offsets"]
    assert differing_columns(row, row | {"snapshot_poses": [[np.zeros(7)] * 2]}, HAND) == ["snapshot_poses"]
    nan = row | {"heights": [np.nan]}
    assert differing_columns(nan, dict(nan), HAND) == []


def alter(change: str, grasp_row: dict) -> None:
    """Change one thing after the table was made."""
    if change == "seed":
        change_parameters(seed=999)
    elif change == "placement":
        change_parameters(evaluate={"perturbation": 0.004})
    elif change == "trials":
        change_parameters(evaluate={"trials": 1})
    elif change == "pair":
        change_parameters(styles={"side": ["soup_can"]}, conditions={"pairs": [], "settings": {}})
    elif change == "grasps":
        write_grasps(grasp_row, merged_id=5)
    elif change == "no grasps":
        paths.merged_file("cube").unlink()
    elif change == "no table":
        TABLE.unlink()
        DRAWN_TABLE.unlink()


@pytest.mark.parametrize(
    ("change", "arguments", "sentence"),
    [
        ("", ["cube/slender_cylinder/1"], "'cube/slender_cylinder/1' names no trial"),
        ("", ["taken/cube/slender_cylinder/1"], "there is no source 'taken'; use one of learned, reconstructed,"),
        ("", ["synthesized/cube/duck/1"], "has no trials of cube and duck; its second objects are slender_cylinder"),
        ("", ["synthesized/cube/slender_cylinder/2"], "has no trial 2 of this pair; its trials are 0 to 1"),
        ("", ["synthesized/duck/cube/2"], "duck.parquet is missing; run `dvc repro evaluate@synthesized`"),
        ("", ["absent.parquet"], "absent.parquet is missing; record the trial again"),
        ("", ["params.yaml.parquet"], "params.yaml.parquet is damaged or no recording of a trial"),
        ("", [str(TABLE)], "is damaged or no recording of a trial"),
        ("seed", [NAME], "was made with another `seed` in params.yaml"),
        ("placement", [NAME], "was made with another evaluate.perturbation or evaluate.yaw_perturbation"),
        ("trials", [NAME], "has trial 1, but evaluate.trials in params.yaml is 1 now"),
        ("pair", [NAME], "params.yaml does not name the pair cube and slender_cylinder any more"),
        (
            "grasps",
            [NAME],
            "have changed since data/evaluate/synthesized/cube.parquet was made: the trial used grasp 4",
        ),
        ("no grasps", [NAME], "data/merge/cube.parquet is missing; run `dvc repro merge`"),
        ("no table", ["--check", "3"], "there are no tables of trials under data/evaluate"),
    ],
)
def test_what_cannot_be_run_as_it_was_is_one_sentence(
    project: Path, grasp_row, capsys, change: str, arguments: list[str], sentence: str
) -> None:
    shutil.copy("params.yaml", "params.yaml.parquet")
    alter(change, grasp_row)
    assert command.main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("replay: ") and sentence in error and len(error.strip().splitlines()) == 1
    assert not Path("replays").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        [NAME, "--check", "2"],
        ["--check", "0"],
        ["--check", "2", "--video", "a.mp4"],
        [NAME, "--video", "a.avi"],
        [NAME, "--size", "481x360"],
        [NAME, "--size", "big"],
        [NAME, "--fps", "0"],
        [NAME, "--fps", "x"],
        [NAME, "--port", "70000"],
    ],
)
def test_wrong_options_are_refused(empty_folder: Path, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        command.main(arguments)
    assert end.value.code == 2


def test_trials_are_drawn_from_all_tables(project: Path) -> None:
    known = known_trials()
    assert known == [trial_name(name) for name in (f"{NAME[:-1]}0", NAME, DRAWN)]
    many = [TrialName("learned", ("cube", "plum"), number) for number in range(100)]
    drawn = drawn_trials(many, 20, draw=0)
    assert len(set(drawn)) == 20 and set(drawn) <= set(many)
    assert drawn == drawn_trials(many, 20, draw=0) != drawn_trials(many, 20, draw=1)
    assert sorted(drawn_trials(many, 500, draw=0)) == many


def test_object_that_physics_loses_stays_where_it_was_seen(trial_input, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(SapienBody, "pose", property(lambda body: np.full((4, 4), np.nan)))
    recorder = Recorder()
    assert run_trial(trial_input(), recorder)["reason"] == "simulation diverged"
    monkeypatch.undo()
    lost = recorder.recording(About(NAME, ("cube", "slender_cylinder"), "failed: simulation diverged", 0.1))
    assert len(lost.time) == 25 and np.isnan(lost.poses).all()  # 0.5 s of settling
    seen = pose_matrix([0.5, 0.1, 0.2], [1.0, 0.0, 0.0, 0.0])
    lost.poses[1, 3] = [0.5, 0.1, 0.2, 1.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(moving_poses(lost, HAND, 20)[-1], seen)
    write_recording(tmp_path / "lost.parquet", lost)
    np.testing.assert_array_equal(read_recording(tmp_path / "lost.parquet").poses, lost.poses)


def test_pictures_are_evenly_spaced_in_time() -> None:
    time = 0.02 * np.arange(1, 51)
    np.testing.assert_array_equal(shown_moments(time, 12.5), np.arange(0, 50, 4))
    np.testing.assert_array_equal(shown_moments(time, 50.0), np.arange(50))
    shown = shown_moments(time, 30.0)
    assert len(shown) == 30 and np.abs(time[shown] - time[0] - np.arange(30) / 30).max() <= 0.0101
    np.testing.assert_array_equal(shown_moments(time[:1], 10.0), [0])


def test_last_caption_fits_the_picture() -> None:
    long = About("synthesized/small_cylinder/medicine_bottle_2/12", ("a", "b"), "failed: first lost in transit", 0.1)
    assert last_caption(long, 480) == "failed: first lost in transit"
    assert last_caption(long, 1280) == f"{long.name}: failed: first lost in transit"


def test_still_moments_share_a_picture(replayed: Recording) -> None:
    still = replace(replayed, robot_q=np.tile(replayed.robot_q[:1], (6, 1)), poses=replayed.poses[:, :1].repeat(6, 1))
    still.robot_q[3:, 2] += 0.001
    still.poses[1, 5, 0] += 0.0006
    np.testing.assert_array_equal(drawn_moments(still, np.arange(6)), [0, 0, 0, 3, 3, 5])
    # a slow motion is not lost: what serves is never farther away than the limit
    slow = replace(still, robot_q=np.linspace(0, 0.01, 6)[:, None] * np.ones(23), poses=still.poses[:, :1].repeat(6, 1))
    np.testing.assert_array_equal(drawn_moments(slow, np.arange(6)), np.arange(6))


def test_appearance_is_that_of_the_recording(evaluated: Path, short: Recording, monkeypatch, objects) -> None:
    monkeypatch.chdir(evaluated)
    looks = appearance(short, HAND)
    poses = moving_poses(short, HAND, len(short.time) - 1)
    bodies = [*(body.placed(T) for body, T in zip(looks.moving, poses, strict=True)), looks.sponge]
    assert sum(len(body.faces) for body in bodies) < 40_000
    *_, cube, cylinder, sponge = bodies
    pose = short.poses[0, -1]
    corners = objects[0].vertices @ pose_matrix(pose[:3], pose[3:])[:3, :3].T + pose[:3]
    np.testing.assert_allclose(np.sort(cube.world_vertices(), axis=0), np.sort(corners, axis=0), atol=1e-6)
    assert np.ptp(cylinder.world_vertices(), axis=0).max() < 0.15
    np.testing.assert_allclose(sponge.world_vertices().max(axis=0), [0.7, 0.2, 0.1])


def seen_colour(picture: np.ndarray, point: np.ndarray, film: Film) -> np.ndarray:
    """Mean colour of 3 x 3 pixels around a point of the world."""
    camera = look_at(video.CAMERA_POSITION, video.CAMERA_TARGET, video.CAMERA_DEGREES)
    x, y = camera.pixels(point[None], film.width, film.height)[0].astype(int)
    return picture[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3).mean(axis=0)


def resting(replayed: Recording) -> Recording:
    """The beginning, where the robot is above and both objects are in full view; every tenth moment."""
    return replace(
        replayed,
        time=replayed.time[:50:10],
        phase=replayed.phase[:50:10],
        robot_q=replayed.robot_q[:50:10],
        poses=replayed.poses[:, :50:10],
    )


@pytest.mark.render
def test_mp4_has_every_picture_and_shows_the_objects(
    evaluated: Path, replayed: Recording, monkeypatch, tmp_path
) -> None:
    import imageio_ffmpeg

    monkeypatch.chdir(evaluated)
    film, recording = Film(320, 240, 5.0), resting(replayed)
    target = tmp_path / "trial.mp4"
    # 0.8 s, and 1 s for the outcome
    assert write_video(target, recording, HAND, film, raster) == 5 + 5
    reader = imageio_ffmpeg.read_frames(str(target))
    about = next(reader)
    frames = [np.frombuffer(frame, np.uint8).reshape(266, 320, 3) for frame in reader]
    assert about["size"] == (320, 266) and about["fps"] == 5.0 and about["codec"] == "h264" and len(frames) == 10
    for frame, moment in ((frames[0], 0), (frames[-1], -1)):
        for index, (strong, weak) in enumerate([(0, 2), (2, 0)]):  # orange, blue
            colour = seen_colour(frame, recording.poses[index, moment, :3], film)
            assert colour[strong] > 1.5 * colour[weak], (index, colour)
    caption = frames[0][-24:].astype(int)
    assert (caption.min(), caption.max()) < (120, 256) and np.abs(caption - frames[-1][-24:]).max() > 60
    assert [path.name for path in tmp_path.iterdir()] == ["trial.mp4"]


@pytest.mark.render
def test_gif_lasts_as_long_as_the_trial(evaluated: Path, replayed: Recording, monkeypatch, tmp_path) -> None:
    from PIL import Image

    monkeypatch.chdir(evaluated)
    film, recording = Film(160, 120, 5.0), resting(replayed)
    assert write_video(tmp_path / "trial.gif", recording, HAND, film, raster) == 10
    with Image.open(tmp_path / "trial.gif") as gif:
        durations = []
        for index in range(gif.n_frames):  # those that are alike are one
            gif.seek(index)
            durations.append(gif.info["duration"])
        assert sum(durations) == 2000 and gif.size == (160, 146)
        gif.seek(0)
        picture = np.asarray(gif.convert("RGB"))
    orange = seen_colour(picture, recording.poses[0, 0, :3], film)
    assert orange[0] > 1.5 * orange[2]


@pytest.mark.render
def test_the_report_gets_a_film_of_a_successful_trial(project: Path) -> None:
    """Of the first one, as the table says, in no more bytes than fit into a page."""
    import imageio_ffmpeg

    rows = read_table(TABLE, TRIALS, "evaluate")
    first = rows[rows["success"].astype(bool)].sort_values("trial").iloc[0]
    write_film(Film(160, 120, 2.0))
    film = load_film(FOLDER)
    assert film is not None
    assert (film.source, film.objects, film.trial) == ("synthesized", ("cube", "slender_cylinder"), first["trial"])
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(FOLDER / VIDEO))
    assert seconds == pytest.approx(first["steps"] / 200 + 1.0, abs=0.5)  # 1 s for the outcome
    assert frames == pytest.approx(2 * seconds, abs=1) and len(film.video) < 1_000_000


def test_a_run_without_a_success_gets_no_film(project: Path, synthesized_alone) -> None:
    rows = read_table(TABLE, TRIALS, "evaluate")
    rows["success"] = False
    write_table(TABLE, rows, TRIALS)
    write_film(Film())
    assert load_film(FOLDER) is None and not (FOLDER / VIDEO).exists()


def test_a_trial_that_fails_again_is_not_filmed(project: Path, synthesized_alone, monkeypatch, capsys) -> None:
    """As where its table comes from a machine that rounds otherwise."""
    row = read_table(TABLE, TRIALS, "evaluate").iloc[0].to_dict()
    failed = row | {"success": False, "reason": "second slip"}
    monkeypatch.setattr("pipeline.evaluate.rerun.run_trial", lambda inputs, watch: failed)
    write_film(Film())
    assert f"went otherwise than in {TABLE}: success, reason" in capsys.readouterr().out
    assert load_film(FOLDER) is None


@pytest.mark.parametrize("suffix", video.FORMATS)
def test_interrupted_video_leaves_nothing(evaluated: Path, short: Recording, monkeypatch, tmp_path, suffix) -> None:
    monkeypatch.chdir(evaluated)
    drawn = []

    def black(looks, film):
        return lambda poses: np.zeros((64, 64, 3), np.uint8)

    def some(picture: np.ndarray, caption: str) -> np.ndarray:
        drawn.append(caption)
        if len(drawn) > 3:
            raise KeyboardInterrupt
        return np.zeros((64 + 26, 64, 3), np.uint8)

    monkeypatch.setattr(video, "captioned", some)
    with pytest.raises(KeyboardInterrupt):
        write_video(tmp_path / f"trial{suffix}", short, HAND, Film(64, 64, 10.0), black)
    assert list(tmp_path.iterdir()) == []


def test_video_that_cannot_be_written_is_told_before_drawing(evaluated: Path, short: Recording, monkeypatch, tmp_path):
    monkeypatch.chdir(evaluated)
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot write"):
        write_video(tmp_path / "file" / "trial.mp4", short, HAND, Film(), raster)


@pytest.mark.render
def test_sapien_sees_both_objects(evaluated: Path, replayed: Recording, monkeypatch) -> None:
    """Both objects where the camera must see them; needs a Vulkan driver, also one in software."""
    reason = why_unusable()
    if reason:
        pytest.skip(f"SAPIEN cannot draw here: {reason}")
    monkeypatch.chdir(evaluated)
    film, recording = Film(320, 240), resting(replayed)
    view = (video.CAMERA_POSITION, video.CAMERA_TARGET, video.CAMERA_DEGREES)
    picture = SapienCamera(appearance(recording, HAND), 320, 240, view).picture(moving_poses(recording, HAND, 0))
    for index, (strong, weak) in enumerate([(0, 2), (2, 0)]):
        colour = seen_colour(picture, recording.poses[index, 0, :3], film)
        assert colour[strong] > 1.5 * colour[weak], (index, colour)


def test_renderer_that_is_not_there_is_one_sentence(evaluated: Path, short: Recording, monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(evaluated)
    monkeypatch.setattr("pipeline.replay.sapien_camera.why_unusable", lambda: "no rendering device")
    with pytest.raises(UserError, match=r"SAPIEN's renderer cannot be used \(no rendering device\); leave `--renderer"):
        write_video(tmp_path / "trial.mp4", short, HAND, Film(), RENDERERS["sapien"])
    assert list(tmp_path.iterdir()) == []


def test_viewer_serves_the_page_and_moves_what_moves(evaluated: Path, replayed: Recording, monkeypatch) -> None:
    monkeypatch.chdir(evaluated)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        viewer = Viewer(replayed, HAND, "127.0.0.1", taken.getsockname()[1])  # goes on to the next free port
    try:
        with urllib.request.urlopen(viewer.address) as answer:
            assert answer.status == 200 and b"<html" in answer.read()
        np.testing.assert_allclose(viewer.handles[-2].position, replayed.poses[0, 0, :3])
        viewer.show(replayed.time[300] + 0.009)
        assert viewer.phase.value == replayed.phase[300]
        for index in (0, 1):
            np.testing.assert_allclose(viewer.handles[index - 2].position, replayed.poses[index, 300, :3], atol=1e-6)
            np.testing.assert_allclose(viewer.handles[index - 2].wxyz, replayed.poses[index, 300, 3:], atol=1e-6)
        hand = [handle for handle in viewer.handles if handle.name.startswith("/robot")]
        np.testing.assert_allclose(
            [h.position for h in hand], [T[:3, 3] for T in moving_poses(replayed, HAND, 300)[:-2]], atol=1e-6
        )
        viewer.show(replayed.time[-1])
        assert viewer.slider.value == pytest.approx(replayed.time[-1]) and viewer.phase.value == "hold"
        viewer.play(False)
        assert viewer.button.label == "Play"
    finally:
        viewer.close()


def test_address_that_is_not_here_is_one_sentence(evaluated: Path, short: Recording, monkeypatch) -> None:
    monkeypatch.chdir(evaluated)
    with pytest.raises(UserError, match=r"nothing can be served on --host 192\.0\.2\.1"):
        Viewer(short, HAND, "192.0.2.1", 8080)


def test_command_plays_a_recording_until_interrupted(evaluated: Path, replayed: Recording, monkeypatch, capsys) -> None:
    """A recording, no trial: no table is needed."""
    monkeypatch.chdir(evaluated)
    shown = []
    monkeypatch.setattr(Viewer, "show", lambda self, seconds: shown.append(seconds))

    def interrupted() -> float:
        raise KeyboardInterrupt

    clock = SimpleNamespace(sleep=lambda _: None, monotonic=interrupted)
    monkeypatch.setattr("pipeline.replay.viewer.time", clock)
    assert command.main([str(RECORDING), "--port", "8765"]) == 0
    assert "plays it (Ctrl-C ends it)" in capsys.readouterr().out and shown == [replayed.time[0]]


def test_playing_advances_with_the_clock(evaluated: Path, replayed: Recording, monkeypatch) -> None:
    """At twice the speed, for half a second of a clock that is told: 1 s of the trial."""
    monkeypatch.chdir(evaluated)
    viewer = Viewer(replayed, HAND, "127.0.0.1", 8770)
    viewer.speed.value = "2"
    ticks = iter(np.arange(0, 0.51, 0.05).tolist())

    def now() -> float:
        tick = next(ticks, None)
        if tick is None:
            raise KeyboardInterrupt
        return tick

    clock = SimpleNamespace(sleep=lambda _: None, monotonic=now)
    monkeypatch.setattr("pipeline.replay.viewer.time", clock)
    viewer.run()
    assert viewer.slider.value == pytest.approx(replayed.time[0] + 1.0) and viewer.playing
    assert viewer.phase.value == replayed.phase[50]


def test_start_of_the_recording_is_the_start_of_trials(replayed: Recording) -> None:
    np.testing.assert_allclose(replayed.robot_q[0], np.concatenate([START_ARM, HAND.start]), atol=0.05)
