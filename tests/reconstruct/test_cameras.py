"""Lenses, poses and places from tags and points whose truth is known: no photo is needed for most of it."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.reconstruct.adjustment import Bundle, Freedom, adjust, focal_spread
from pipeline.reconstruct.camera_checks import check_lenses, check_scale, wrong_photos
from pipeline.reconstruct.joining import Choice, Tracks, adjusted_together, chosen_lens, grown, steadied, triangulated
from pipeline.reconstruct.lens import Lens, focal_of_film
from pipeline.reconstruct.photos import Photo
from pipeline.reconstruct.tag_cameras import NO_POINTS, cameras_from_tags, guessed_lenses, solved_layout, tags_in_plane
from pipeline.reconstruct.turntable import background_rests, on_the_sheet
from pipeline.records.captures import Scene
from pipeline.records.errors import UserError
from pipeline.records.tag_layouts import Board, TagLayout
from tests.reconstruct.drawn import camera_around, photo_of, sheet_picture

SIZE = (640, 480)
PLACES = {3: (0.0, 0.0, 0.0), 5: (0.16, 0.02, 30.0), 8: (0.05, 0.17, -70.0), 11: (-0.12, 0.1, 200.0)}


def lens(**values: float) -> Lens:
    names = ("focal", "k1", "k2", "p1", "p2")
    return Lens(*SIZE, np.array([values.get(name, 600.0 if name == "focal" else 0.0) for name in names]))


def scattered() -> TagLayout:
    tags = {n: {"position": (x, y, 0.0), "yaw_degrees": yaw} for n, (x, y, yaw) in PLACES.items()}
    return TagLayout.model_validate({"family": "tag36h11", "size": 0.05, "convention": "opencv", "tags": tags})


def cameras(count: int, elevations=(35, 50, 65)) -> list[np.ndarray]:
    return [
        camera_around(360 * k / count + 7, elevations[k % len(elevations)], 0.55 + 0.02 * (k % 3)) for k in range(count)
    ]


def sighted(layout: TagLayout, poses, true: Lens, noise: float = 0.05):
    """Photos without pixels, and what they show of a layout."""
    random, photos, sightings = np.random.default_rng(0), [], {}
    for k, T in enumerate(poses):
        name = f"photo_{k:03d}"
        photos.append(Photo(name, np.zeros(SIZE[::-1], np.uint8), None, SIZE))
        sightings[name] = {
            n: true.project(c @ T[:3, :3].T + T[:3, 3])[0] + noise * random.standard_normal((4, 2))
            for n, c in layout.corners().items()
        }
    return photos, sightings


def test_what_a_lens_does_is_what_colmap_does_and_its_slopes_are_right():
    own = lens(k1=-0.12, k2=0.05, p1=0.002, p2=-0.003)
    random = np.random.default_rng(1)
    points = np.concatenate([random.uniform(-0.4, 0.4, (50, 2)), random.uniform(0.8, 1.5, (50, 1))], axis=1)
    pixels, by_point, by_lens = own.project(points)
    theirs = np.asarray(own.camera().img_from_cam(points))
    assert np.allclose(pixels, theirs, atol=1e-9)
    assert np.allclose(own.rays(pixels), points[:, :2] / points[:, 2:], atol=1e-7)
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-6
        numeric = (own.project(points + step)[0] - own.project(points - step)[0]) / 2e-6
        assert np.allclose(by_point[:, :, axis], numeric, atol=1e-4)
    for value in range(5):
        step = np.zeros(5)
        step[value] = 1e-6
        up, down = own.with_values(own.values + step), own.with_values(own.values - step)
        assert np.allclose(by_lens[:, :, value], (up.project(points)[0] - down.project(points)[0]) / 2e-6, atol=1e-4)


def test_a_focal_length_on_film_means_its_diagonal():
    assert focal_of_film(43.27, 3000, 4000) == pytest.approx(5000)


@pytest.mark.parametrize("elevations", [(35, 50, 65), (45,)])
def test_tags_alone_give_lens_and_poses(elevations):
    """Also from one height, as before a turntable, where a camera with two focal lengths would go wrong."""
    layout, true = scattered(), lens(focal=600, k1=0.05)
    poses = cameras(12, elevations)
    photos, sightings = sighted(layout, poses, true)
    found = cameras_from_tags(photos, sightings, layout, guessed_lenses([SIZE], {}))
    assert found.bundle.lenses[0].focal == pytest.approx(600, rel=0.004)
    for T, mine in zip(poses, found.bundle.poses, strict=True):
        assert np.linalg.norm(T[:3, :3].T @ T[:3, 3] - mine[:3, :3].T @ mine[:3, 3]) < 0.002


def test_places_of_tags_come_from_the_photos():
    layout, true = scattered(), lens(focal=600, k1=0.03)
    photos, sightings = sighted(layout, cameras(12), true)
    unknown = layout.model_copy(update={"tags": "anywhere"})
    found = cameras_from_tags(photos, sightings, unknown, guessed_lenses([SIZE], {}))
    told, moved = solved_layout(found, unknown)
    for number, corners in layout.corners().items():  # tag 3, the lowest, is the origin of both
        assert np.abs(told.corners()[number] - corners).max() < 0.001
    level, off = tags_in_plane(told)
    assert len(level) == 4 and off < 0.0005
    assert all((-T[:3, :3].T @ T[:3, 3])[2] > 0.2 for T in moved.bundle.poses), "cameras are above the plane"


def test_photos_whose_tags_fit_no_pose_are_not_posed_by_them():
    layout, true = scattered(), lens()
    photos, sightings = sighted(layout, cameras(10), true)
    sightings["photo_004"] = {n: c[::-1] + 30 * n for n, c in sightings["photo_004"].items()}
    found = cameras_from_tags(photos, sightings, layout, guessed_lenses([SIZE], {}))
    assert "photo_004" not in found.names and len(found.names) == 9


@pytest.fixture(scope="module")
def world():
    """Twelve cameras, tags and 300 points: the true bundle, its tracks, and where the tags' corners are."""
    layout, true, poses = scattered(), lens(k1=-0.1, k2=0.08, p1=0.008), cameras(12)
    random = np.random.default_rng(2)
    points = np.concatenate([random.uniform(-0.17, 0.2, (300, 2)), random.uniform(0, 0.1, (300, 1))], axis=1)
    which, pixels, corners, seen = [], [], [], []
    for photo, T in enumerate(poses):
        sight = true.project(points @ T[:3, :3].T + T[:3, 3])[0] + 0.2 * random.standard_normal((300, 2))
        shown = np.flatnonzero(random.random(300) < 0.5)
        which += [(photo, point) for point in shown]
        pixels.append(sight[shown])
        for tag, places in enumerate(layout.corners().values()):
            corners += [(photo, tag, k) for k in range(4)]
            seen.append(true.project(places @ T[:3, :3].T + T[:3, 3])[0] + 0.05 * random.standard_normal((4, 2)))
    tags = np.array([pose.matrix() for pose in layout.poses().values()])
    bundle = Bundle(
        (true,),
        np.zeros(12, np.int64),
        np.array(poses),
        tags,
        layout.square(),
        (np.array(corners), np.concatenate(seen)),
        np.zeros((0, 3)),
        NO_POINTS,
    )
    placed = np.array(list(layout.corners().values()))
    return bundle, Tracks(np.array(which), np.concatenate(pixels), 300), points, placed


def test_a_richer_lens_is_taken_only_where_photos_kept_out_say_so(world):
    bundle, tracks, _, placed = world
    posed = np.ones(12, bool)
    plain = replace(bundle, lenses=(lens(),))
    rich = chosen_lens(plain, tracks, posed, placed, "OPENCV")
    assert rich.model == "OPENCV" and rich.errors["OPENCV"] < 0.9 * rich.errors["SIMPLE_RADIAL"]
    # The same scene through a plain lens: nothing is gained, so nothing is added.
    flat = lens(k1=-0.05)
    which, _ = bundle.corners
    straight = replace(bundle, lenses=(flat,))
    corners = straight.seen(which[:, 0], straight.corner_places()[which[:, 1], which[:, 2]])
    points = world[2]
    random = np.random.default_rng(3)
    pixels = straight.seen(tracks.which[:, 0], points[tracks.which[:, 1]]) + 0.2 * random.standard_normal(
        (len(tracks.which), 2)
    )
    same = replace(straight, corners=(which, corners))
    assert chosen_lens(same, replace(tracks, pixels=pixels), posed, placed, "OPENCV").model == "SIMPLE_RADIAL"


def test_everything_is_adjusted_together(world):
    bundle, tracks, points, placed = world
    posed = np.ones(12, bool)
    random = np.random.default_rng(4)
    poses = bundle.poses.copy()
    poses[:, :3, 3] += 0.004 * random.standard_normal((12, 3))
    start = replace(bundle, lenses=(lens(focal=585),), poses=poses)
    start = steadied(start, tracks, posed, placed)
    found = adjusted_together(start, tracks, posed, placed, Choice("OPENCV", {}))
    assert found.lenses[0].focal == pytest.approx(600, rel=0.002)
    assert np.median(found.feature_errors()) < 0.3 and np.median(found.corner_errors()) < 0.15
    spread = focal_spread(found, Freedom(placed=placed))[0]
    assert abs(found.lenses[0].focal - 600) < 5 * spread < 5
    off = np.linalg.norm(found.poses[:, :3, :3].transpose(0, 2, 1) @ found.poses[:, :3, 3:], axis=1)
    true = np.linalg.norm(bundle.poses[:, :3, :3].transpose(0, 2, 1) @ bundle.poses[:, :3, 3:], axis=1)
    assert np.abs(off - true).max() < 0.001


def test_photos_without_tags_are_posed_by_points(world):
    bundle, tracks, _, _ = world
    posed = np.arange(12) < 8
    lost = bundle.poses.copy()
    lost[8:] = np.eye(4)
    found, now = grown(replace(bundle, poses=lost), tracks, posed)
    assert now.all()
    assert np.abs(found.poses[8:, :3, 3] - bundle.poses[8:, :3, 3]).max() < 0.005


def test_wrong_matches_leave_a_point_where_it_is(world):
    bundle, tracks, points, _ = world
    pixels = tracks.pixels.copy()
    wrong = np.random.default_rng(5).random(len(pixels)) < 0.1
    pixels[wrong] += 60
    found, good, use = triangulated(replace(tracks, pixels=pixels), np.ones(12, bool), bundle)
    assert good.mean() > 0.8 and use[wrong].mean() < 0.05 and use[~wrong].mean() > 0.8
    assert np.median(np.linalg.norm(found - points, axis=1)[good]) < 0.001


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        (
            lambda T: np.array([*T[:3], T[3]]) + np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 39.0], [0, 0, 0, 0]]),
            "39.",
        ),
        (lambda T: T @ np.diag([1.0, -1.0, -1.0, 1.0]), "from behind"),
        (lambda T: camera_around(200, 30, 0.55), "pixels off"),
    ],
)
def test_a_camera_that_cannot_be_is_named(world, plant, words):
    bundle, tracks, _, _ = world
    poses = bundle.poses.copy()
    poses[5] = plant(poses[5])
    found = wrong_photos(replace(bundle, poses=poses), tracks, np.ones(12, bool))
    assert set(found) == {5} and words in found[5]
    assert wrong_photos(bundle, tracks, np.ones(12, bool)) == {}


def test_a_photo_that_fits_the_tags_but_not_the_rest_is_named(world):
    bundle, tracks, _, _ = world
    pixels = tracks.pixels.copy()
    pixels[tracks.which[:, 0] == 7] += [12.0, -9.0]  # what is around the tags was moved before this photo
    found = wrong_photos(bundle, replace(tracks, pixels=pixels), np.ones(12, bool))
    assert set(found) == {7} and "fits the others in only" in found[7]


@pytest.mark.parametrize(("values", "exif"), [({"focal": 100}, None), ({"k1": -0.9}, None), ({}, 800.0)])
def test_impossible_lenses_are_refused(values, exif):
    told = {} if exif is None else {"a": exif}
    with pytest.raises(UserError, match="impossible camera|EXIF data say 800"):
        check_lenses([lens(**values)], [SIZE], told, {"a": SIZE})
    check_lenses([lens(k1=-0.1)], [SIZE], {"a": 590.0}, {"a": SIZE})


def test_a_tag_of_another_size_is_named():
    layout = scattered()
    located = {n: dict(enumerate(corners)) for n, corners in layout.corners().items()}
    assert check_scale(located, layout)["tag_scale_largest"] == pytest.approx(1)
    middle = layout.corners()[8].mean(axis=0)
    located[8] = {k: middle + 1.08 * (corner - middle) for k, corner in located[8].items()}
    with pytest.raises(UserError, match="tag 8 is 8 % larger"):
        check_scale(located, layout)


@pytest.mark.parametrize("turned", [True, False])
def test_a_turned_sheet_is_told_from_a_camera_that_moves(turned):
    board = Board(kind="grid", columns=5, rows=4, gap=0.008)
    layout = TagLayout(family="aruco_6x6_250", size=0.03, board=board)
    sheet = sheet_picture(layout, 0.21, 0.17)
    random, photos, sightings, poses = np.random.default_rng(0), [], {}, {}
    import cv2

    from pipeline.reconstruct.detection import seen_tags

    wall = cv2.GaussianBlur(random.integers(0, 255, (480, 1400), dtype=np.uint8), (0, 0), 4)
    wall = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX)
    for k in range(8):
        start = 0 if turned else 60 * k
        T = camera_around(20 * k, 45, 0.4)
        grey = photo_of(sheet, T, 600.0, SIZE, wall[:, start : start + SIZE[0]])
        photos.append(Photo(f"photo_{k}", grey, None, SIZE))
        sightings[f"photo_{k}"] = seen_tags(grey, layout).tags
    scene = Scene.model_validate({"objects": {"a": {"position": [0, 0], "box": [0.05, 0.05, 0.05]}}})
    found = cameras_from_tags(photos, sightings, layout, guessed_lenses([SIZE], {}))
    poses = found.poses()
    sheets = on_the_sheet(photos, poses, dict.fromkeys(poses, found.bundle.lenses[0]), layout, scene)
    assert background_rests(photos, poses, sheets) is turned
    share = np.mean([mask.mean() for mask in sheets.values()])
    assert 0.15 < share < 0.6, "sheet and box, not the wall"
    assert adjust(found.bundle, Freedom(tags=False)).lenses[0].focal == pytest.approx(600, rel=0.01)
