import numpy as np

from pipeline.shapes.distance_field import DistanceField, signed_distance
from tests.synthesize import shapes


def test_values_are_those_of_the_shared_look_up_and_slopes_those_of_differences():
    prepared = shapes.cylinder()
    field = DistanceField(prepared)
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.08, 0.08, (40, 5, 3))  # inside the object, around it, and beyond the grid
    value, gradient = field.look_up(points)
    np.testing.assert_allclose(value, signed_distance(prepared, points), atol=1e-7)
    step = 1e-7
    for axis in range(3):
        moved = points + step * np.eye(3)[axis]
        slope = (field.look_up(moved)[0] - value) / step
        same = np.abs(slope - gradient[..., axis]) < 1e-3
        assert same.mean() > 0.99  # a step may cross into the next cell
