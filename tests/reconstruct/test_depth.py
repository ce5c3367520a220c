"""Objects out of one depth picture that was computed: rays of a lens met with a ball, a block and a table."""

import json

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image

from pipeline.records.tag_layouts import TagLayout
from tests.reconstruct.drawn import camera_around, photo_of, sheet_picture
from tools.captures import main

SIZE, FOCAL, NOISE = (480, 360), 450.0, 0.001
RADIUS, BALL = 0.035, np.array([0.04, 0.05, 0.035])  # m
BLOCK, HALF, YAW = np.array([-0.06, -0.03, 0.03]), np.array([0.03, 0.02, 0.03]), 25.0
DISTORTION = (0.08, -0.03, 0.001, -0.002)  # k1, k2, p1, p2
CAMERA = camera_around(-90, 50, 0.5)  # looks along +y, as without tags the frame is defined


def turned():
    c, s = np.cos(np.radians(YAW)), np.sin(np.radians(YAW))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def depth_picture(distortion=(0, 0, 0, 0)):
    """Return depths (h, w) along the optical axis, m."""
    pixels = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).reshape(-1, 1, 2).astype(float)
    K = np.array([[FOCAL, 0, SIZE[0] / 2 - 0.5], [0, FOCAL, SIZE[1] / 2 - 0.5], [0, 0, 1]])
    rays = cv2.undistortPoints(pixels, K, np.array(distortion, float)).reshape(-1, 2)
    local = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)  # depth 1
    R, centre = CAMERA[:3, :3], -CAMERA[:3, :3].T @ CAMERA[:3, 3]
    ways = local @ R
    with np.errstate(divide="ignore", invalid="ignore"):
        table = np.where(ways[:, 2] < 0, -centre[2] / ways[:, 2], np.inf)
        a, b = (ways**2).sum(axis=1), ways @ (centre - BALL)
        root = b**2 - a * (((centre - BALL) ** 2).sum() - RADIUS**2)
        ball = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
        start, way = (centre - BLOCK) @ turned(), ways @ turned()
        enter, leave = np.sort(np.stack([(-HALF - start) / way, (HALF - start) / way]), axis=0)
        block = np.where(enter.max(axis=1) < leave.min(axis=1), enter.max(axis=1), np.inf)
    return np.minimum(np.minimum(table, ball), block).reshape(SIZE[::-1])


@pytest.fixture
def folder(tmp_path):
    objects = {
        "ball": {"position": [0.042, 0.047], "box": [0.075, 0.075, 0.075]},
        "block": {"position": BLOCK[:2].tolist(), "yaw_degrees": YAW, "box": [0.06, 0.04, 0.06]},
    }
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump({"objects": objects}))
    parameters = [FOCAL, FOCAL, SIZE[0] / 2, SIZE[1] / 2, *DISTORTION]
    camera = {"model": "OPENCV", "width": SIZE[0], "height": SIZE[1], "parameters": parameters}
    (tmp_path / "intrinsics.yaml").write_text(yaml.safe_dump(camera))
    return tmp_path


def run(folder, depth, *more, out="out"):
    np.save(folder / "depth.npy", depth) if isinstance(depth, np.ndarray) else None
    source = folder / "depth.npy" if isinstance(depth, np.ndarray) else depth
    given = {"--depth": source, "--intrinsics": folder / "intrinsics.yaml", "--scene": folder / "scene.yaml"}
    flat = [str(part) for pair in given.items() for part in pair]
    return main(["from-depth", *flat, "--out", str(folder / out), *map(str, more)])


def cloud(folder, name, out="out"):
    """Return points and normals in the scene frame."""
    stored = np.load(folder / out / name / "points.npy").astype(float)
    T = np.array(json.loads((folder / out / name / "object.json").read_text())["T_scene_object"])
    return stored[:, :3] @ T[:3, :3].T + T[:3, 3], stored[:, 3:] @ T[:3, :3].T, stored


def check(folder, out="out", tolerance=0.0006):
    """Compare with the bodies: distances within the noise, normals outwards, nothing of the table."""
    points, normals, _ = cloud(folder, "ball", out)
    off = np.linalg.norm(points - BALL, axis=1) - RADIUS
    assert abs(np.median(off)) < tolerance and np.std(off) < 2 * NOISE and np.abs(off).max() < 0.008
    outward = (points - BALL) / np.linalg.norm(points - BALL, axis=1, keepdims=True)
    assert np.median((outward * normals).sum(axis=1)) > 0.95
    points, _, stored = cloud(folder, "block", out)
    local = np.abs((points - BLOCK) @ turned()) - HALF
    off = np.where((local > 0).any(axis=1), np.linalg.norm(np.maximum(local, 0), axis=1), local.max(axis=1))
    assert abs(np.median(off)) < tolerance and np.std(off) < 2 * NOISE
    assert np.percentile(stored[:, 2], 99) == pytest.approx(0.06, abs=0.003)  # z up, from the base of the box
    assert len(stored) >= 1000 and points[:, 2].min() > 0.0015


def test_without_tags_the_largest_plane_is_the_support(folder, capsys):
    random = np.random.default_rng(5)
    depth = depth_picture(DISTORTION) + random.normal(0, NOISE, SIZE[::-1])
    lost = random.random(SIZE[::-1])
    for limit, value in ((0.02, 0.0), (0.04, np.nan), (0.06, np.inf), (0.07, -1.0)):
        depth[(lost < limit) & (lost >= limit - 0.01)] = value
    assert run(folder, depth) == 0, capsys.readouterr().err
    check(folder)


def test_with_tags_the_frame_is_theirs_and_millimetres_do(folder, capsys):
    parameters = [FOCAL, FOCAL, SIZE[0] / 2, SIZE[1] / 2, 0, 0, 0, 0]
    camera = {"model": "OPENCV", "width": SIZE[0], "height": SIZE[1], "parameters": parameters}
    (folder / "intrinsics.yaml").write_text(yaml.safe_dump(camera))
    tags = {"family": "aruco_4x4_50", "size": 0.04, "board": {"kind": "grid", "columns": 4, "rows": 4, "gap": 0.02}}
    (folder / "tags.yaml").write_text(yaml.safe_dump(tags))
    photo = photo_of(sheet_picture(TagLayout.model_validate(tags), 0.26, 0.26), CAMERA, FOCAL, SIZE)
    cv2.imwrite(str(folder / "photo.png"), photo)
    noisy = depth_picture() + np.random.default_rng(6).normal(0, NOISE, SIZE[::-1])
    Image.fromarray((1000 * noisy).round().astype(np.uint16)).save(folder / "depth.png")
    with_tags = ("--photo", folder / "photo.png", "--tags", folder / "tags.yaml")
    assert run(folder, folder / "depth.png", *with_tags) == 0, capsys.readouterr().err
    check(folder, tolerance=0.001)
    assert run(folder, 1.1 * noisy, *with_tags, "--force") == 2
    assert "1.1 times" in capsys.readouterr().err
    check(folder, tolerance=0.001)  # what was there is kept
    assert run(folder, noisy, *with_tags) == 2
    assert "--force" in capsys.readouterr().err
    (folder / "tags.yaml").write_text(yaml.safe_dump({"family": "aruco_4x4_50", "size": 0.04, "tags": "anywhere"}))
    assert run(folder, noisy, *with_tags, "--force") == 2
    assert "give their places" in capsys.readouterr().err


def test_the_cloud_is_one_that_sampling_reads_whole(folder):
    from pipeline.propose.clouds import cleaned, read_cloud

    assert run(folder, depth_picture(DISTORTION)) == 0
    points = read_cloud(folder / "out/ball/points.npy")
    assert points.shape[1] == 3 and len(points) > 1000 and np.ptp(points, axis=0).max() < 0.08
    assert len(cleaned(points, "ball").points) > 0.95 * len(points)


def test_what_cannot_be_used_is_one_sentence(folder, capsys):
    depth = depth_picture(DISTORTION)
    Image.fromarray(np.zeros((360, 480), np.uint8)).save(folder / "eight.png")
    (folder / "text.npy").write_text("no array")
    random = np.random.default_rng(1).uniform(0.2, 2.0, SIZE[::-1])
    cases = [
        (np.zeros_like(depth), "no plane"),
        (random, "no plane"),
        (depth[:100], "480 x 100"),
        (np.zeros((3, 4, 5)), "one number per pixel"),
        (folder / "eight.png", "16 bits"),
        (folder / "text.npy", "no depth picture"),
        (np.where(depth > 0.53, depth, 0), "lie in the box of"),
    ]
    for given, words in cases:
        assert run(folder, given) == 2, words
        said = capsys.readouterr().err.strip().splitlines()
        assert len(said) == 1 and words in said[0], said
        assert not (folder / "out").exists() or not list((folder / "out").iterdir())
    assert run(folder, depth, "--photo", folder / "eight.png") == 2
    assert "belong together" in capsys.readouterr().err
