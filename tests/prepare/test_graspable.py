from dataclasses import astuple

import numpy as np
import pytest
import trimesh

from pipeline.prepare.graspable import size_of


def upright(mesh: trimesh.Trimesh, degrees: float) -> np.ndarray:
    turn = trimesh.transformations.rotation_matrix(np.radians(degrees), [0, 0, 1])
    return np.asarray(mesh.apply_transform(turn).vertices)


@pytest.mark.parametrize("degrees", [0.0, 10.0, 33.3, 45.0])
def test_width_of_a_box_and_a_triangle_in_any_direction(degrees):
    assert astuple(size_of(upright(trimesh.creation.box((0.04, 0.07, 0.02)), degrees))) == pytest.approx(
        (0.04, 0.07, 0.02)
    )
    prism = trimesh.creation.cylinder(radius=0.03, height=0.1, sections=3)  # equilateral: the height, 1.5 radii
    assert size_of(upright(prism, degrees)).width == pytest.approx(0.045)
