"""The plane sweep on a real pair of photos, and on views of known surfaces."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.reconstruct.fusion import fuse, thinned
from pipeline.reconstruct.plane_sweep import DepthMap, Window, follow, neighbours, sweep
from pipeline.reconstruct.views import View
from pipeline.records.parameters import read_parameters


@pytest.fixture(scope="module")
def settings():
    return read_parameters().reconstruct.sweep


@pytest.fixture(scope="module")
def motorcycle():
    """A real stereo pair with measured disparities (Middlebury 2014, as scikit-image ships it), and its views."""
    from skimage import data

    left, right, disparity = data.stereo_motorcycle()
    focal, baseline, offset = 994.978, 0.193001, 31.086
    views = []
    for picture, centre, shift in ((left, 311.193, 0.0), (right, 311.193 + offset, baseline)):
        grey = (picture[..., :3] @ [0.299, 0.587, 0.114] / 255).astype(np.float32)
        T = np.eye(4)
        T[0, 3] = -shift
        K = np.array([[focal, 0, centre + 0.5], [0, focal, 254.877 + 0.5], [0, 0, 1]])
        views.append(View("left" if not views else "right", grey, None, K, T))
    return views, np.asarray(disparity, np.float64), focal * baseline, offset


def test_a_real_stereo_pair_is_matched(motorcycle, settings):
    views, disparity, product, offset = motorcycle
    known = np.isfinite(disparity) & (disparity > 0)
    window = Window(0, 0, views[0].image.shape[1], views[0].image.shape[0])
    smallest, largest = np.percentile(disparity[known], [0.1, 99.9])
    fine = settings.model_copy(update={"planes": 160})
    found = sweep(views, 0, [1], window, product / (largest + 3 + offset), product / (smallest - 3 + offset), fine)
    measured = found.depth > 0
    error = np.abs(product / np.where(measured, found.depth, 1) - offset - disparity)[measured & known]
    assert len(error) > 0.5 * known.sum(), "most of the picture must be matched"
    assert np.median(error) < 0.35  # pixels; semi-global matching of OpenCV reaches 0.16 on this pair
    assert (error > 2).mean() < 0.12


@pytest.fixture(scope="module")
def slanted():
    """Five exact views of a textured plane that is tilted by 50 degrees: z = 0.6 + 1.2 x."""
    random = np.random.default_rng(0)
    import cv2

    texture = cv2.GaussianBlur(random.random((1200, 1200)).astype(np.float32), (0, 0), 3)
    texture = (texture - texture.min()) / np.ptp(texture)
    views = []
    for x in (0.0, -0.1, -0.05, 0.05, 0.1):
        T = np.eye(4)
        T[0, 3] = -x
        K = np.array([[400.0, 0, 80], [0, 400, 60], [0, 0, 1]])
        columns, rows = np.meshgrid(np.arange(160) + 0.5, np.arange(120) + 0.5)
        ray_x, ray_y = (columns - 80) / 400, (rows - 60) / 400
        depth = (0.6 + 1.2 * x) / (1 - 1.2 * ray_x)
        place_x, place_y = x + depth * ray_x, depth * ray_y
        # The texture is fixed to the plane; one texture pixel is 0.5 mm of x and y.
        image = cv2.remap(
            texture,
            (place_x * 2000 + 600).astype(np.float32),
            (place_y * 2000 + 600).astype(np.float32),
            cv2.INTER_CUBIC,
        )
        views.append(View(str(x), image, None, K, T))
    columns, _ = np.meshgrid(np.arange(160) + 0.5, np.arange(120))
    return views, 0.6 / (1 - 1.2 * (columns - 80) / 400)


def test_following_a_surface_beats_planes_that_face_the_camera(slanted, settings):
    views, true = slanted
    window, others = Window(20, 20, 120, 80), [1, 2, 3, 4]
    true = true[20:100, 20:140]
    first = sweep(views, 0, others, window, 0.4, 0.9, settings)
    base = (true + 0.0015).astype(np.float32)  # a surface that is known to 1.5 mm
    visible = np.ones((len(others), *base.shape), bool)
    second = follow(views, 0, others, window, base, visible, settings)
    assert [other for other, _ in second.likeness] == others and min(value for _, value in second.likeness) > 0.9

    def error(found: DepthMap) -> float:
        known = found.depth > 0
        assert known.mean() > 0.6
        return float(np.abs(found.depth - true)[known].mean())

    assert error(first) < 0.003
    assert error(second) < 0.0004
    assert error(second) < error(first)


def test_what_shows_the_support_gets_no_depth(settings):
    """A textured plane z = 0, seen from above, as the support and as something that stands 3 cm above it."""
    import cv2

    from tests.reconstruct.drawn import camera_around, photo_of

    random = np.random.default_rng(1)
    ground = cv2.GaussianBlur(random.integers(0, 255, (3200, 3200), dtype=np.uint8), (0, 0), 12)
    ground = cv2.normalize(ground, None, 0, 255, cv2.NORM_MINMAX)
    K, size = np.array([[300.0, 0, 80], [0, 300, 60], [0, 0, 1]]), (160, 120)
    views = []
    for azimuth in (0, -15, 15, 8, -8):
        T = camera_around(azimuth, 55, 0.4)
        views.append(View(str(azimuth), photo_of(ground, T, 300.0, size).astype(np.float32) / 255, None, K, T))
    window = Window(20, 20, 120, 80)
    free = sweep(views, 0, [1, 2, 3, 4], window, 0.25, 0.6, settings)
    bound = sweep(views, 0, [1, 2, 3, 4], window, 0.25, 0.6, settings, support=0.0)
    assert (free.depth > 0).mean() > 0.8 and (bound.depth > 0).mean() < 0.02
    assert bound.support is not None and bound.support.mean() > 0.7
    lower = sweep(views, 0, [1, 2, 3, 4], window, 0.25, 0.6, settings, support=-0.03)
    assert (lower.depth > 0).mean() > 0.75 and lower.support.mean() < 0.05, "what stands higher keeps its depth"


def test_points_need_agreement(slanted, settings):
    views, true = slanted
    window = Window(0, 0, 160, 120)
    score = np.ones((120, 160), np.float32)

    def exact(view: int, shift: float) -> DepthMap:
        x = views[view].centre[0]
        columns, _ = np.meshgrid(np.arange(160) + 0.5, np.arange(120))
        depth = (0.6 + 1.2 * x) / (1 - 1.2 * (columns - 80) / 400)
        return DepthMap(view, window, (depth + shift).astype(np.float32), score)

    agreeing = fuse(views, [exact(view, 0.0) for view in range(5)], settings)
    off_plane = np.abs(agreeing.positions[:, 2] - 0.6 - 1.2 * agreeing.positions[:, 0])
    assert len(agreeing.positions) > 20000 and off_plane.max() < 0.01 and np.median(off_plane) < 0.002
    assert agreeing.seen_through < 0.01
    # Two photos that see something 2 cm deeper contradict the other three.
    torn = fuse(views, [exact(view, 0.02 * (view > 2)) for view in range(5)], settings)
    assert torn.seen_through > 0.2
    pairs = {(one, other): share for one, other, share in torn.contradictions}
    assert pairs[0, 4] > 0.9 and pairs[0, 1] == 0
    # Where the other photos plainly show the support behind, there is no point, whatever agrees on it.
    three = [exact(view, 0.0) for view in range(3)]
    plain = [replace(depth, support=np.ones((120, 160), bool)) for depth in three[1:]]
    carved = fuse(views, three, settings, plain, support=0.0)
    assert len(carved.positions) < 0.1 * len(fuse(views, three, settings).positions)
    thin = thinned(agreeing, 0.004)
    assert len(thin.positions) < 0.5 * len(agreeing.positions)
    assert np.allclose(np.linalg.norm(thin.towards, axis=1), 1)


def test_neighbours_are_those_near_the_wanted_angle(settings):
    angles = np.radians([0, 2, 14, 17, 30, 90, -16])
    views = []
    for angle in angles:
        T = np.eye(4)
        T[:3, 3] = -np.array([np.sin(angle), 0, -np.cos(angle)])
        views.append(View("", np.zeros((4, 4), np.float32), None, np.eye(3), T))
    chosen = neighbours(views, 0, np.zeros(3), range(7), settings.model_copy(update={"neighbours": 3}))
    assert set(chosen) == {2, 3, 6}
