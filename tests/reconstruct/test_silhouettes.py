"""How far an object may reach by what photos see behind it: a ball on a pattern, drawn by its equation."""

import numpy as np
import pytest

from pipeline.reconstruct.silhouettes import bound_of
from pipeline.reconstruct.views import View
from pipeline.records.captures import SceneObject

RADIUS = 0.035
BALL = SceneObject(position=(0.01, -0.02), box=(0.08, 0.08, 0.075))
MIDDLE = np.array([0.01, -0.02, RADIUS])


def pattern(places):
    """Black and white squares of 4 mm (n, 2), at random; grey 20 cm and more away."""
    cells = np.random.default_rng(3).random((100, 100)) < 0.5
    column, row = np.clip(np.floor(places / 0.004).astype(int) + 50, 0, 99).T
    return np.where(cells[row, column], 0.15, 0.85)


def looking_at(azimuth, height, look, exposure=1.0, size=(480, 360), focal=520.0):
    """The view of a camera 0.4 m from the ball, which is plain and shaded from above."""
    a, e = np.radians([azimuth, height])
    forward = -np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.array([right, np.cross(forward, right), forward])
    centre = MIDDLE - 0.4 * forward
    K = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1.0]])
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    rays = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3) @ np.linalg.inv(K).T @ R
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    along = rays @ (MIDDLE - centre)
    inside = RADIUS**2 - (((MIDDLE - centre) ** 2).sum() - along**2)
    hit = inside > 0
    top = centre + rays * (along - np.sqrt(np.maximum(inside, 0)))[:, None]
    ground = centre + rays * (-centre[2] / rays[:, 2])[:, None]
    grey = np.where(hit, 0.35 + 0.3 * (top[:, 2] - MIDDLE[2]) / RADIUS / 2, look(ground[:, :2]))
    noise = np.random.default_rng(int(azimuth) * 100 + int(height)).normal(0, 0.01, len(grey))
    image = np.clip(exposure * grey + noise, 0, 1).reshape(size[1], size[0]).astype(np.float32)
    return View(f"{azimuth}", image, None, K, np.vstack([np.column_stack([R, -R @ centre]), [0, 0, 0, 1]]))


def ring(look):
    """Views from all around in two heights, with exposures that differ."""
    return [looking_at(15 * n, 30 + 20 * (n % 2), look, 0.85 + 0.1 * (n % 3)) for n in range(24)]


@pytest.fixture(scope="module")
def bound():
    found = bound_of(ring(pattern), BALL, 0.0, 0.015)
    assert found is not None
    return found


def on_ball(radius):
    directions = np.random.default_rng(1).normal(size=(4000, 3))
    points = MIDDLE + radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return points[points[:, 2] > 0.004]


def test_nothing_of_the_ball_is_lost(bound):
    assert bound.distance(on_ball(RADIUS - 0.001)).max() < 0.001


def test_what_lies_beside_the_ball_is_left_out(bound):
    """Cameras 30 to 50 degrees high touch the ball from 40 degrees above its equator to 40 below."""
    beside = on_ball(RADIUS + 0.003)
    beside = beside[np.abs(beside[:, 2] - MIDDLE[2]) < (RADIUS + 0.003) * np.sin(np.radians(35))]
    assert (bound.distance(beside) > 0).mean() > 0.95


def test_points_are_drawn_in_the_shortest_way(bound):
    beside = on_ball(RADIUS + 0.006)
    beside = beside[np.abs(beside[:, 2] - MIDDLE[2]) < 0.01]
    moved = np.linalg.norm(bound.drawn_in(beside) - MIDDLE, axis=1)
    assert np.abs(moved - RADIUS).max() < 0.004 and np.median(np.abs(moved - RADIUS)) < 0.0015
    within = on_ball(RADIUS - 0.003)
    assert np.array_equal(bound.drawn_in(within), within)


def test_a_plain_support_tells_nothing():
    assert bound_of(ring(lambda places: np.full(len(places), 0.8)), BALL, 0.0, 0.015) is None


def test_too_few_photos_tell_nothing():
    assert bound_of(ring(pattern)[:2], BALL, 0.0, 0.015) is None
