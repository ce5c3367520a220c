"""Rasterised pictures agree with ray-cast ones, which share no code with them but the camera and the colours."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from pipeline.pictures.camera import look_at
from pipeline.pictures.raster import Raster
from pipeline.pictures.render import Body, render

pytestmark = pytest.mark.render
CAMERA = look_at([0.9, -0.5, 0.6], [0.0, 0.0, 0.1], 30.0)
REACH = ((0.0, 0.0, 0.1), 0.4)
SIZE = (160, 120)


def bodies() -> list[Body]:
    ball, box = trimesh.creation.icosphere(subdivisions=3, radius=0.08), trimesh.creation.box([0.3, 0.3, 0.06])
    return [
        Body(np.asarray(ball.vertices), np.asarray(ball.faces), (0.9, 0.3, 0.1)),
        Body(np.asarray(box.vertices), np.asarray(box.faces), (0.3, 0.5, 0.3)),
    ]


def poses(height: float, turn: float = 0.0) -> list[np.ndarray]:
    T_ball, T_box = np.eye(4), trimesh.transformations.rotation_matrix(turn, [0, 0, 1])
    T_ball[:3, 3], T_box[2, 3] = [0.02, 0.03, height], 0.03
    return [T_ball, T_box]


@pytest.fixture(scope="module")
def raster() -> Raster:
    return Raster(bodies(), CAMERA, *SIZE, 0.0, REACH)


@pytest.mark.parametrize("own", [poses(0.14), poses(0.25, 0.6)])
def test_it_is_the_picture_that_rays_give(raster, own):
    placed = [body.placed(T) for body, T in zip(bodies(), own, strict=True)]
    cast, drawn = (picture.astype(int) for picture in (render(placed, CAMERA, *SIZE, floor=0.0), raster.picture(own)))
    apart = np.abs(cast - drawn).max(axis=2)
    assert np.median(apart) <= 1 and (apart > 12).mean() < 0.04  # the dither of soft shadows differs
    bare = raster.picture([np.diag([1e-6, 1e-6, 1e-6, 1.0])] * 2).astype(int)
    shadow = ((bare - drawn).min(axis=2) > 20) & (np.ptp(drawn, axis=2) < 10)  # grey: of the floor
    shadow_cast = ((bare - cast).min(axis=2) > 20) & (np.ptp(cast, axis=2) < 10)
    assert shadow_cast.sum() > 50 and shadow.sum() == pytest.approx(shadow_cast.sum(), rel=0.2)


def test_a_picture_depends_on_nothing_that_was_drawn_before(raster):
    one = raster.picture(poses(0.14))
    raster.picture(poses(0.25, 0.6))
    np.testing.assert_array_equal(raster.picture(poses(0.14)), one)


def test_what_is_behind_the_camera_is_not_seen(raster):
    behind = poses(0.14)
    behind[0][:3, 3] = CAMERA.position + 0.5 * (CAMERA.position - CAMERA.target)
    hidden = raster.picture(behind).astype(int)
    assert not ((hidden[..., 0] - hidden[..., 2]) > 60).any()
