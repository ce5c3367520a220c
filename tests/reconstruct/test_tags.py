import numpy as np
import pytest

from pipeline.capture.layout import camera_poses
from pipeline.reconstruct.alignment import align, fit_similarity
from pipeline.reconstruct.tags import check_sightings, detect_tags, locate, locate_corners
from pipeline.records.captures import Intrinsics, read_capture, read_truth
from pipeline.records.errors import UserError
from pipeline.records.parameters import read_parameters
from pipeline.stages.seeds import item_generator
from tests.reconstruct.made_up import mapping


@pytest.fixture(scope="module")
def settings():
    return read_parameters().reconstruct.alignment


@pytest.fixture(scope="module")
def layout(capture_folder):
    return read_capture(capture_folder).tags


@pytest.fixture(scope="module")
def located(sparse, sightings, settings):
    return locate_corners(sparse.views, sightings, settings)


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


def test_all_photos_are_posed_and_the_cameras_are_where_they_were(sparse, located, layout, settings, capture_folder):
    from pipeline.reconstruct.views import undistorted

    assert len(sparse.views) == 16 and sparse.reprojection < 0.5
    alignment = align(located, layout, settings)
    assert alignment.residual < 0.0006
    centres = read_truth(capture_folder).camera_centres
    views = [undistorted(view, alignment.similarity) for view in sparse.views]
    errors = [np.linalg.norm(view.centre - centres[view.name]) for view in views]
    assert np.mean(errors) < 0.001


def test_mapping_is_the_same_again(photos, sparse):
    from pipeline.reconstruct.sparse import sparse_model

    again = sparse_model(photos, None, mapping(), seed=1)
    for one, other in zip(sparse.views, again.views, strict=True):
        assert np.array_equal(one.T_camera_world, other.T_camera_world)
    assert np.array_equal(sparse.points, again.points)


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


def test_a_tag_seen_twice_in_a_photo_does_not_count(photos, sightings, layout):
    from dataclasses import replace

    photo = photos[0]
    doubled = replace(photo, grey=np.concatenate([photo.grey, photo.grey], axis=1))
    assert sightings[photo.name] and detect_tags(doubled, layout) == {}


def test_a_calibrated_camera_is_held(photos):
    from pipeline.reconstruct.sparse import sparse_model

    lens = [475.2, 475.2, 240.0, 180.0]  # as it was rendered: 0.99 widths, in the middle
    camera = Intrinsics.model_validate({"model": "PINHOLE", "width": 480, "height": 360, "parameters": lens})
    quick = read_parameters().reconstruct.sparse.model_copy(update={"features": 1200})
    found = sparse_model(photos[::2], camera, quick, seed=1)
    for view in found.views:
        assert view.camera.params.tolist() == lens


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
