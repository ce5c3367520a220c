import numpy as np
import pytest

from pipeline.model.clouds import neighbourhoods, prepare_cloud, stack


def test_neighbours_are_the_nearest_within_the_radius_and_the_centre_fills_up():
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.05, 0.05, (200, 3))
    found = neighbourhoods(points, 20, 0.02, 6)
    for centre in range(20):
        distance = np.linalg.norm(points - points[centre], axis=1)
        near = set(np.flatnonzero(distance <= 0.02)) & set(np.argsort(distance)[:6])
        assert set(found[centre]) == near  # the centre is its own neighbour, so it may repeat


@pytest.mark.parametrize("count", [1000, 64, 10])
def test_a_cloud_holds_drawn_points_and_its_centres_are_far_apart(settings, count):
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.05, 0.05, (count, 3))
    cloud = prepare_cloud(points, settings.encoder, np.random.default_rng(1))
    assert cloud.points.shape == (1, 64, 3)
    everything = {tuple(point) for point in points.astype(np.float32)}
    assert {tuple(point) for point in cloud.points[0]} <= everything
    if count >= 64:
        assert len({tuple(point) for point in cloud.points[0]}) == 64  # drawn without repetition
        centres = cloud.points[0, :16]
        apart = np.linalg.norm(centres[:, None] - centres[None], axis=-1) + 9 * np.eye(16)
        assert apart.min() > 0.02  # 16 random points of this cube are nearer than that
    before = 64
    for level, (centres, k) in enumerate(zip(settings.encoder.centres, settings.encoder.neighbours, strict=True)):
        assert cloud.neighbours[level].shape == (1, centres, k)
        assert cloud.neighbours[level].max() < before
        before = centres


def test_stacked_clouds_stay_in_order(settings):
    clouds = [prepare_cloud(np.full((70, 3), float(i)), settings.encoder, np.random.default_rng(0)) for i in range(3)]
    together = stack(clouds)
    assert len(together) == 3
    assert together.points[:, 0, 0].tolist() == [0, 1, 2]
