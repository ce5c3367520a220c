import numpy as np
import pytest

from pipeline.capture.layout import camera_poses
from pipeline.reconstruct.alignment import align, fit_similarity
from pipeline.reconstruct.cameras import find_cameras
from pipeline.reconstruct.detection import Seen
from pipeline.reconstruct.tags import check_sightings, locate, locate_corners
from pipeline.records.captures import Intrinsics, read_capture, read_truth
from pipeline.records.errors import UserError
from pipeline.records.parameters import read_parameters
from pipeline.stages.seeds import item_generator
from tests.reconstruct.made_up import quick


@pytest.fixture(scope="module")
def settings():
    return read_parameters().reconstruct.alignment


@pytest.fixture(scope="module")
def layout(capture_folder):
    return read_capture(capture_folder).tags


@pytest.fixture(scope="module")
def located(cameras, sightings, settings):
    return locate_corners(cameras.views, sightings, settings)


def test_corners_are_found_to_a_tenth_of_a_pixel(photos, sightings, layout):
    poses = camera_poses(len(photos), 0.62, item_generator(1, "capture", "path", 0))
    errors, outward = [], []
    for photo, T in zip(photos, poses, strict=True):
        width, height = photo.size
        for number, corners in sightings[photo.name].items():
            local = layout.corners()[number] @ T[:3, :3].T + T[:3, 3]
            true = local[:, :2] / local[:, 2:] * 0.99 * width + [width / 2, height / 2]
            errors += list(np.linalg.norm(corners - true, axis=1))
            arm = true - true.mean(axis=0)
            outward += list(((corners - true) * arm).sum(axis=1) / np.linalg.norm(arm, axis=1))
    assert len(errors) > 4 * 3 * len(photos)
    assert np.median(errors) < 0.1
    assert abs(np.median(outward)) < 0.05, "a bias would change the scale of the whole scene"


def camera_errors(cameras, capture_folder):
    centres = read_truth(capture_folder).camera_centres
    poses = {view.photo.name: view.T_camera_scene for view in cameras.views}
    return [np.linalg.norm(-T[:3, :3].T @ T[:3, 3] - centres[name]) for name, T in poses.items()]


def test_all_photos_are_posed_and_the_cameras_are_where_they_were(cameras, capture_folder):
    assert len(cameras.views) == 16 and cameras.dropped == {} and cameras.reprojection < 0.5
    assert cameras.alignment.residual < 0.0006
    assert np.mean(camera_errors(cameras, capture_folder)) < 0.001
    assert cameras.facts["cameras_from"] == "tags" and cameras.facts["lens"] == "SIMPLE_RADIAL"
    assert cameras.facts["focal_px"] == pytest.approx(0.99 * 480, rel=0.003) and not cameras.facts["turntable"]


@pytest.mark.slow
def test_photos_of_which_few_show_two_tags_are_posed_by_features(photos, seen, capture_folder):
    """The same twice: COLMAP's mapping, and what follows, depends on nothing but its input."""
    capture = read_capture(capture_folder)
    few = {
        name: Seen(its.tags if k % 3 == 0 else dict(sorted(its.tags.items())[:1]))
        for k, (name, its) in enumerate(seen.items())
    }
    one, other = (find_cameras(photos, few, capture.tags, capture.scene, None, quick(), seed=1) for _ in range(2))
    assert one.facts["cameras_from"] == "features" and len(one.views) == 16
    assert np.mean(camera_errors(one, capture_folder)) < 0.002
    for mine, again in zip(one.views, other.views, strict=True):
        assert np.array_equal(mine.T_camera_scene, again.T_camera_scene)
    assert np.array_equal(one.points, other.points)


def test_a_similarity_is_recovered():
    random = np.random.default_rng(0)
    points = random.standard_normal((10, 3))
    rotation = np.linalg.qr(random.standard_normal((3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    found = fit_similarity(points, 0.3 * points @ rotation.T + [1, 2, 3])
    assert np.isclose(found.scale, 0.3) and np.allclose(found.rotation, rotation)
    # A camera that looks at a point must look at the same pixel of the moved point.
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.T, [0.1, 0.2, 5.0]
    local = points @ T[:3, :3].T + T[:3, 3]
    moved = found.points(points) @ found.camera(T)[:3, :3].T + found.camera(T)[:3, 3]
    assert np.allclose(moved, found.scale * local)


def test_outliers_do_not_move_a_triangulated_corner():
    random = np.random.default_rng(1)
    projections = camera_poses(12, 0.6, random)[:, :3]
    point = np.array([0.05, -0.02, 0.01])
    local = projections[:, :, :3] @ point + projections[:, :, 3]
    rays = local[:, :2] / local[:, 2:] + 0.1 / 900 * random.standard_normal((12, 2))
    rays[[2, 7, 8]] += 15 / 900
    found = locate(projections, rays, np.full(12, 900.0), tolerance=1.5, least_views=3)
    assert found is not None and np.linalg.norm(found - point) < 1e-4
    rays[:] = random.standard_normal((12, 2))
    assert locate(projections, rays, np.full(12, 900.0), tolerance=1.5, least_views=4) is None


def test_too_few_tags_are_told_before_the_long_work(sightings, layout, settings):
    check_sightings(sightings, layout, settings)
    only_first = {name: {n: corners for n, corners in seen.items() if n == 0} for name, seen in sightings.items()}
    with pytest.raises(UserError, match=r"1 of the 6 tags .* 2 are needed"):
        check_sightings(only_first, layout, settings)
    alone = layout.model_copy(update={"tags": {0: layout.tags[0]}})
    check_sightings(only_first, alone, settings.model_copy(update={"least_tags": 1}))
    with pytest.raises(UserError, match=r"0 of the 6 tags"):
        check_sightings({"photo_000": {}}, layout, settings)


def test_a_calibrated_camera_is_held(photos, seen, capture_folder):
    lens = [475.2, 475.2, 240.0, 180.0]  # as it was rendered: 0.99 widths, in the middle
    camera = Intrinsics.model_validate({"model": "PINHOLE", "width": 480, "height": 360, "parameters": lens})
    capture = read_capture(capture_folder)
    found = find_cameras(photos[::2], seen, capture.tags, capture.scene, camera, quick(), seed=1)
    for view in found.views:
        assert view.lens.values.tolist() == [475.2, 0, 0, 0, 0] and view.lens.principal.tolist() == [240, 180]
    assert found.facts["lens"] == "calibrated"


def test_one_tag_is_refused_with_advice(located, layout, settings):
    one = {0: located[0]}
    with pytest.raises(UserError, match=r"located 1 of the 6 tags .*2 are needed"):
        align(one, layout, settings)
    alone = align(one, layout, settings.model_copy(update={"least_tags": 1}))
    assert alone.tags == (0,)  # possible when wanted, if less accurate


def test_a_wrong_size_is_told_from_wrong_places(located, layout, settings):
    with pytest.raises(UserError, match=r"the tags are (59|60)\.\d mm large, not 50\.0"):
        align(located, layout.model_copy(update={"size": 0.05}), settings)


def test_the_other_convention_is_refused(located, layout, settings):
    with pytest.raises(UserError, match="convention"):
        align(located, layout.model_copy(update={"convention": "apriltag"}), settings)


def test_a_moved_tag_is_named(located, layout, settings):
    moved = layout.tags[3].model_copy(update={"position": (-0.16, 0.13, 0.0)})
    wrong = layout.model_copy(update={"tags": {**layout.tags, 3: moved}})
    with pytest.raises(UserError, match="do not lie as tags.yaml says.*tag 3 most"):
        align(located, wrong, settings)
