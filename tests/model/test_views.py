"""One camera's view and what is completed from it, against geometry."""

import numpy as np
import pytest
import trimesh

from pipeline.model.completion import completed
from pipeline.model.views import BASELINE, FOCAL, SUBPIXEL, depth_noise, view_of
from pipeline.records.poses import inverse_pose, transform_points
from tests.objects import prepared


def seen(mesh, seed=0):
    return view_of(prepared("item", mesh), np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(3))
def test_of_a_ball_the_cap_that_faces_the_camera_is_seen(seed):
    radius = 0.04
    view = seen(trimesh.creation.icosphere(4, radius), seed)
    points = transform_points(inverse_pose(view.T_table_object), view.points)
    camera = transform_points(inverse_pose(view.T_table_object), view.T_table_camera[:3, 3][None])[0]
    distance = np.linalg.norm(camera)
    along = points @ camera / distance
    # Tangents from the camera touch the ball at radius^2 / distance; flying pixels may lie a little beyond.
    assert np.quantile(along, 0.02) > radius**2 / distance
    assert along.max() == pytest.approx(radius, abs=0.002)
    off = np.linalg.norm(points, axis=1) - radius
    assert abs(np.median(off)) < 0.001
    assert np.quantile(np.abs(off), 0.95) < 0.004


def test_noise_is_that_of_a_stereo_camera():
    depth = np.array([0.4, 0.8, 1.6])
    disparity = FOCAL * BASELINE / depth
    expected = np.abs(FOCAL * BASELINE / (disparity - SUBPIXEL) - depth)  # one subpixel error farther
    np.testing.assert_allclose(depth_noise(depth), expected, rtol=0.01)


def test_a_cylinder_is_completed_to_its_back_and_to_the_table():
    radius, height = 0.035, 0.1
    cylinder = trimesh.creation.cylinder(radius, height)
    for seed in range(3):
        solid = completed(seen(cylinder, seed))
        assert solid.is_watertight
        assert solid.bounds[0][2] == 0
        np.testing.assert_allclose(solid.bounds[1] - solid.bounds[0], [2 * radius, 2 * radius, height], atol=0.006)
        assert solid.volume == pytest.approx(cylinder.volume, rel=0.12)


def test_what_the_camera_does_not_see_changes_nothing():
    # The cavity inside a box is never seen, however large.
    box, cavity = trimesh.creation.box((0.05, 0.06, 0.07)), trimesh.creation.box((0.04, 0.05, 0.06))
    cavity.invert()
    solids = [completed(seen(mesh)) for mesh in (box, trimesh.util.concatenate([box, cavity]))]
    assert np.asarray(solids[0].vertices).tobytes() == np.asarray(solids[1].vertices).tobytes()
    other = completed(seen(box, seed=1))
    assert np.asarray(other.vertices).tobytes() != np.asarray(solids[0].vertices).tobytes()
