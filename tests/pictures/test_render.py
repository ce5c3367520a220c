import numpy as np
import pytest
import trimesh

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import load_hand
from pipeline.hand.surface import hand_surface
from pipeline.pictures.camera import framing, look_at
from pipeline.pictures.picture import GAP, captioned, png_bytes, strip
from pipeline.pictures.render import Body, render
from pipeline.pictures.robot import hand_bodies, robot_bodies

pytestmark = pytest.mark.render
RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)


def ball(radius: float, centre, colour=RED) -> Body:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius).apply_translation(centre)
    return Body(np.asarray(mesh.vertices), np.asarray(mesh.faces), colour)


def reddish(picture) -> np.ndarray:
    colour = picture.astype(int)
    return colour[..., 0] > colour[..., 2] + 40


def bluish(picture) -> np.ndarray:
    colour = picture.astype(int)
    return colour[..., 2] > colour[..., 0] + 40


def test_a_ball_covers_the_area_that_perspective_says():
    width, height, distance, radius = 320, 240, 1.0, 0.1
    picture = render([ball(radius, [0, 0, 0])], look_at([distance, 0, 0], [0, 0, 0], 30.0), width, height)
    focal = height / 2 / np.tan(np.radians(15))
    half_angle = np.arcsin(radius / distance)
    assert reddish(picture).sum() == pytest.approx(np.pi * (focal * np.tan(half_angle)) ** 2, rel=0.02)


def test_right_is_right_and_up_is_up():
    """Seen from +x towards -x, +y is on the right and +z is up."""
    bodies = [ball(0.05, [0, 0.2, 0]), ball(0.05, [0, 0, 0.2], BLUE)]
    picture = render(bodies, look_at([2, 0, 0], [0, 0, 0], 30.0), 320, 240)
    rows, columns = np.nonzero(reddish(picture))
    assert columns.mean() > 180 and abs(rows.mean() - 120) < 3
    rows, columns = np.nonzero(bluish(picture))
    assert rows.mean() < 80 and abs(columns.mean() - 160) < 3


def test_the_nearer_body_hides_the_farther_one():
    bodies = [ball(0.05, [0.3, 0, 0]), ball(0.05, [0, 0, 0], BLUE)]
    picture = render(bodies, look_at([1, 0, 0], [0, 0, 0], 30.0), 160, 120)
    assert reddish(picture).any() and not bluish(picture).any()


def test_a_body_over_the_floor_casts_a_shadow():
    camera = look_at([0, -1, 1], [0, 0, 0], 40.0)
    bare = render([ball(0.01, [0, 0, 5])], camera, 160, 120, floor=0.0).astype(int)
    shaded = render([ball(0.1, [0, 0, 0.3])], camera, 160, 120, floor=0.0).astype(int)
    darker = (bare - shaded).min(axis=-1) > 40
    assert (darker & ~reddish(shaded)).sum() > 100


def test_the_same_picture_gives_the_same_bytes():
    camera = framing(ball(0.1, [0, 0, 0]).vertices)
    one, two = (png_bytes(captioned(render([ball(0.1, [0, 0, 0])], camera, 80, 60), "ball")) for _ in range(2))
    assert one == two and one.startswith(b"\x89PNG")


def test_a_strip_is_as_wide_as_its_pictures():
    pictures = [np.zeros((40, 50, 3), np.uint8)] * 3
    assert strip(pictures).shape == (40, 3 * 50 + 2 * GAP, 3)


def test_the_drawn_hand_is_the_hand_of_the_grasps():
    """Collision samples of every link lie on or near its visual mesh: both are in one frame at one posture."""
    hand = load_hand("allegro")
    q = np.random.default_rng(0).uniform(hand.lower, hand.upper)
    links, local = hand_surface(400, hand)
    poses = link_poses(hand, q[None])[0]
    points = np.einsum("nij,nj->ni", poses[links][:, :3, :3], local) + poses[links][:, :3, 3]
    import open3d

    scene = open3d.t.geometry.RaycastingScene()
    for body in hand_bodies(np.eye(4), q, hand):
        scene.add_triangles(body.world_vertices().astype(np.float32), body.faces.astype(np.uint32))
    distance = scene.compute_distance(points.astype(np.float32)).numpy()
    assert np.median(distance) < 0.002 and np.quantile(distance, 0.9) < 0.012


def test_the_robot_carries_its_hand():
    q = np.zeros(23)
    q[:7], q[19] = [0.0, 0.0, 0.0, -2.0, 0.0, 2.0, 0.8], 0.3
    robot = np.concatenate([body.world_vertices() for body in robot_bodies(q, load_hand("allegro"))])
    assert robot[:, 2].min() == pytest.approx(0.0, abs=0.02)  # stands on its base
    assert 0.5 < np.linalg.norm(robot, axis=1).max() < 1.4
