"""What frames, shades and stores a picture."""

import numpy as np
import pytest
import trimesh

from pipeline.pictures.camera import framing, look_at
from pipeline.pictures.picture import png_bytes
from pipeline.pictures.render import Body, corner_normals, render

WIDTH, HEIGHT = 160, 120


def ball(radius: float = 0.03, centre=(0.0, 0.0, 0.0), colour=(0.8, 0.3, 0.2)) -> Body:
    mesh = trimesh.creation.icosphere(4, radius)
    return Body(np.asarray(mesh.vertices) + np.array(centre), np.asarray(mesh.faces), colour)


def test_floor_carries_a_shadow_on_the_side_away_from_the_light() -> None:
    camera = look_at([0, -0.5, 0.4], [0, 0, 0], 30.0)
    lone = render([], camera, WIDTH, HEIGHT, floor=-0.03).astype(int)
    picture = render([ball()], camera, WIDTH, HEIGHT, floor=-0.03).astype(int)
    body = picture[..., 0] - picture[..., 2] > 40
    darker = (lone - picture).min(axis=2) > 40
    shadow = darker & ~body
    assert shadow.sum() > 100
    # The light comes from the left, so the shadow falls to the right.
    assert np.nonzero(shadow)[1].mean() > WIDTH / 2 + 5
    # Floor far from the body is unchanged.
    assert np.array_equal(lone[:, :10], picture[:, :10])


def test_pose_moves_a_body_as_its_vertices_would() -> None:
    camera = look_at([0.3, -0.5, 0.3], [0, 0, 0], 30.0)
    T = np.eye(4)
    T[:3, :3] = trimesh.transformations.euler_matrix(0.3, 0.4, 0.5)[:3, :3]
    T[:3, 3] = [0.02, 0.01, 0.03]
    mesh = trimesh.creation.box((0.04, 0.05, 0.06))
    posed = Body(np.asarray(mesh.vertices), np.asarray(mesh.faces), (0.5, 0.5, 0.5), T)
    moved = Body(posed.world_vertices(), posed.faces, posed.colour)
    difference = render([posed], camera, WIDTH, HEIGHT).astype(int) - render([moved], camera, WIDTH, HEIGHT)
    assert np.abs(difference).max() <= 1


def test_corner_normals_are_smooth_on_a_sphere_and_sharp_on_a_box() -> None:
    sphere = trimesh.creation.icosphere(4, 0.03)
    normals = corner_normals(np.asarray(sphere.vertices), np.asarray(sphere.faces))
    radial = np.asarray(sphere.vertices)[sphere.faces] / 0.03
    assert (normals * radial).sum(axis=2).min() > np.cos(np.radians(1.0))
    cube = trimesh.creation.box((1, 1, 1))
    normals = corner_normals(np.asarray(cube.vertices), np.asarray(cube.faces))
    np.testing.assert_allclose(normals, np.repeat(cube.face_normals[:, None], 3, axis=1), atol=1e-12)


@pytest.mark.parametrize("aspect", [4 / 3, 0.7])
def test_framing_shows_everything_and_fills_the_picture(aspect: float) -> None:
    points = np.random.default_rng(0).uniform([-0.3, -0.1, 0], [0.3, 0.1, 0.9], (200, 3))
    camera = framing(points, aspect=aspect, margin=1.0)
    width, height = int(600 * aspect), 600
    pixels = camera.pixels(points, width, height)
    assert pixels.min() >= -1e-6
    assert np.all(pixels <= np.array([width, height]) + 1e-6)
    share = np.ptp(pixels, axis=0) / [width, height]
    assert share.max() > 0.8


def test_png_keeps_every_pixel() -> None:
    import io

    from PIL import Image

    camera = look_at([0, -0.3, 0.1], [0, 0, 0])
    picture = render([ball()], camera, 64, 48, floor=-0.03)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(png_bytes(picture)))), picture)
