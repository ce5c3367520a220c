"""Scale and frame without tags: cameras, points and marks whose truth is known, in a frame and a scale of their own."""

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from pipeline.capture.layout import camera_poses
from pipeline.reconstruct.alignment import Similarity
from pipeline.reconstruct.cameras import PosedPhoto, find_cameras_by_length
from pipeline.reconstruct.known_length import (
    located_mark,
    marks_as_worked_with,
    scale_spread,
    support_plane,
    told_by_length,
)
from pipeline.reconstruct.lens import Lens
from pipeline.reconstruct.photos import Photo
from pipeline.records.captures import KnownLength, read_capture, read_truth
from pipeline.records.errors import UserError
from pipeline.stages.seeds import item_generator
from tests.reconstruct.drawn import camera_around, pixels_of
from tests.reconstruct.made_up import quick
from tests.reconstruct.made_up import settings as rendering

SIZE, FOCAL, TIMES = (640, 480), 600.0, 3
FIRST, SECOND = np.array([-0.10, 0.05, 0.02]), np.array([0.12, 0.03, 0.02])  # m, on top of something 2 cm high
LENGTH = float(np.linalg.norm(SECOND - FIRST))
# From the scene to the frame that features find: any place, turn and scale.
LOOSE = Similarity(7.3, Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix(), np.array([3.0, -2.0, 9.0]))


def scene_poses(count=8):
    return [camera_around(360 * k / count, (35, 55)[k % 2], 0.55) for k in range(count)]


def posed(poses, similarity=LOOSE):
    lens = Lens.guessed(*SIZE, FOCAL)
    blank = np.zeros(SIZE[::-1], np.uint8)
    return [
        PosedPhoto(Photo(f"p{k}", blank, None, (SIZE[0] * TIMES, SIZE[1] * TIMES), TIMES), lens, similarity.camera(T))
        for k, T in enumerate(poses)
    ]


def marked(point, poses, photos=(0, 2, 5), shift=0.0):
    """Marks in the photos as a camera stores them, moved by ``shift`` pixels in turn."""
    return {
        f"p{k}": tuple(TIMES * pixels_of(point[None], poses[k], FOCAL, SIZE)[0] + shift * (-1.0) ** k) for k in photos
    }


def scattered(table=400, above=200):
    """Points on the table and above it, in the frame that features find, with half a millimetre of noise."""
    random = np.random.default_rng(3)
    flat = np.concatenate([random.uniform(-0.25, 0.25, (table, 2)), 0.0005 * random.standard_normal((table, 1))], 1)
    high = random.uniform((-0.08, -0.08, 0.01), (0.08, 0.08, 0.12), (above, 3))
    return LOOSE.points(np.concatenate([flat, high]))


def length(first, second, metres=LENGTH):
    return KnownLength.model_validate({"between": [first, second], "metres": metres})


def test_a_frame_of_any_place_turn_and_scale_becomes_the_scene_s():
    poses = scene_poses()
    views, scale = posed(poses), length(marked(FIRST, poses), marked(SECOND, poses))
    marks = marks_as_worked_with(scale, [view.photo for view in views])
    told = told_by_length(scale, marks, views, scattered(), seed=1)
    # By definition: z = 0 is the table, the origin lies beneath the first point, x points to the second.
    ends = told.similarity.points(LOOSE.points(np.array([FIRST, SECOND])))
    assert np.allclose(ends, [[0, 0, 0.02], [LENGTH, 0, 0.02]], atol=2e-4)
    assert told.similarity.scale * LOOSE.scale == pytest.approx(1, abs=1e-6)
    centre = -poses[3][:3, :3].T @ poses[3][:3, 3]
    T = told.similarity.camera(views[3].T_camera_scene)
    assert (-T[:3, :3].T @ T[:3, 3])[2] == pytest.approx(centre[2], abs=5e-4)
    assert told.facts["plane_share"] == pytest.approx(400 / 600, abs=0.02) and 0.3 < told.facts["plane_off_mm"] < 0.7
    assert told.facts["marks_px_largest"] < 1e-6


def test_how_well_the_scale_is_known_is_how_much_it_varies():
    """Against the spread over many drawn sets of marks that are off by a pixel each."""
    poses = scene_poses()
    views, random = posed(poses), np.random.default_rng(0)
    true = {name: np.array(pixel) / TIMES for name, pixel in marked(FIRST, poses).items()}
    other = {name: np.array(pixel) / TIMES for name, pixel in marked(SECOND, poses).items()}
    lengths = []
    for _ in range(200):
        drawn = [
            located_mark(views, {n: p + random.standard_normal(2) for n, p in marks.items()}, "first").position
            for marks in (true, other)
        ]
        lengths.append(np.linalg.norm(drawn[1] - drawn[0]))
    expected = np.std(lengths) / np.mean(lengths)
    exact = [located_mark(views, marks, "first") for marks in (true, other)]
    assert scale_spread(exact) == pytest.approx(expected, rel=0.2)


def test_what_does_not_tell_a_scale_is_refused():
    poses = scene_poses()
    views = posed(poses)
    photos = [view.photo for view in views]

    def told(first, second, points=None):
        scale = length(first, second)
        marks = marks_as_worked_with(scale, photos)
        return told_by_length(scale, marks, views, scattered() if points is None else points, seed=1)

    good = marked(SECOND, poses)
    wrong = {**marked(FIRST, poses), "p2": marked(SECOND, poses)["p2"]}
    with pytest.raises(UserError, match="first point of `scale` are not of one point: that in p"):
        told(wrong, good)
    with pytest.raises(UserError, match="has 1920 x 1440 pixels"):
        told({**marked(FIRST, poses), "p2": (2000.0, 10.0)}, good)
    near = [*poses[:1], camera_around(1.0, 35, 0.55), *poses[2:]]
    views = posed(near)
    with pytest.raises(UserError, match="is known to .* % only"):
        told(marked(FIRST, near, (0, 1)), marked(SECOND, near, (0, 1)))
    views = posed(poses)
    with pytest.raises(UserError, match="one above the other"):
        told(marked(FIRST, poses), marked(FIRST + [0, 0, 0.08], poses))
    views = views[3:]
    with pytest.raises(UserError, match="first point of `scale` is marked in 1 of the photos"):
        told(marked(FIRST, poses), good)


def test_a_plane_that_is_not_there_or_is_one_of_two_is_refused():
    centres = np.array([-T[:3, :3].T @ T[:3, 3] for T in scene_poses()])
    random = np.random.default_rng(5)
    with pytest.raises(UserError, match="no plane is seen"):
        support_plane(random.uniform(-0.2, 0.2, (500, 3)), centres, seed=1)
    flat = np.concatenate([random.uniform(-0.2, 0.2, (300, 2)), np.zeros((300, 1))], axis=1)
    wall = np.concatenate([random.uniform(-0.2, 0.2, (300, 1)), np.full((300, 1), 0.9), flat[:, :1] + 0.25], axis=1)
    with pytest.raises(UserError, match="two planes"):
        support_plane(np.concatenate([flat, wall]), centres, seed=1)
    found = support_plane(np.concatenate([flat, wall[:60]]), centres, seed=1)
    assert np.allclose(found.normal, [0, 0, 1]) and found.offset == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        ({"metres": 0.0}, "metres"),
        ({"metres": -0.2}, "metres"),
        ({"between": [{"photo_000": [1, 2]}, {"photo_000": [5, 2], "photo_001": [7, 3]}]}, "first point in two photos"),
        ({"between": 2 * [{"photo_000": [1, 2], "photo_1": [1, 3]}]}, "photo_1 is no photo"),
        ({"tags": True}, "both tags.yaml and `scale`"),
    ],
)
def test_wrong_descriptions_are_refused(tmp_path, scale, words):
    (tmp_path / "images").mkdir()
    for k in range(3):
        (tmp_path / f"images/photo_{k:03d}.jpg").touch()
    if scale.pop("tags", False):
        (tmp_path / "tags.yaml").touch()
    marks = {"photo_000": [1, 2], "photo_001": [4, 3]}
    content = {"scale": {"between": [marks, marks], "metres": 0.2, **scale}}
    content["objects"] = {"can": {"position": [0, 0], "box": [0.06, 0.06, 0.1]}}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(UserError, match=words) as caught:
        read_capture(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_rendered_photos_without_tags(photos, capture_folder):
    """The length is that between the middles of two tags, marked to whole pixels in every third photo."""
    settings = rendering()
    poses = camera_poses(settings.views, settings.distance, item_generator(1, "capture", "path", 0))
    size, ends = (settings.width, settings.height), np.array([[-0.19, -0.13, 0.0], [0.19, -0.13, 0.0]])
    between = []
    for end in ends:
        shown = [pixels_of(end[None], T, settings.focal * size[0], size)[0].round() for T in poses]
        seen = {photo.name: pixel for photo, pixel in zip(photos, shown, strict=True)}
        inside = {name: tuple(pixel) for name, pixel in seen.items() if (pixel >= 0).all() and (pixel <= size).all()}
        between.append(dict(list(inside.items())[::3]))
    found = find_cameras_by_length(photos, length(*between, metres=0.38), None, quick(), seed=1)
    true = read_truth(capture_folder).camera_centres
    off = [ends[0] - v.T_camera_scene[:3, :3].T @ v.T_camera_scene[:3, 3] - true[v.photo.name] for v in found.views]
    # A mark to whole pixels is 0.4 of them off, 0.5 mm there; the cameras are 0.62 m away.
    assert len(off) == len(photos) and np.linalg.norm(off, axis=1).mean() < 0.003
    assert found.facts["scale_spread"] < 0.01 and found.facts["plane_off_mm"] < 1
