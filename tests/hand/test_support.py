"""What an object stands on."""

import numpy as np

from pipeline.hand.support import PLANE, Support


def test_a_plane_is_everywhere_and_a_post_only_under_its_object() -> None:
    post = Support(half_width=0.01, height=0.1)
    points = np.array([[0.0, 0.0, 1.0], [0.009, -0.009, 0.0], [0.011, 0.0, 0.0], [0.0, -0.011, 5.0]])
    np.testing.assert_array_equal(PLANE.level(-0.02, points), -0.02)
    np.testing.assert_allclose(post.level(-0.02, points), [-0.02, -0.02, -0.12, -0.12])


def test_what_moves_across_a_post_is_over_it() -> None:
    post = Support(half_width=0.01, height=0.1)
    lowest, highest = np.array([[-0.05, 0.0, 0.0], [0.02, 0.0, 0.0]]), np.array([[0.05, 0.0, 0.0], [0.05, 0.0, 0.0]])
    np.testing.assert_allclose(post.level(0.0, lowest, highest), [0.0, -0.1])
