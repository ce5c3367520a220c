import numpy as np
import pytest
import trimesh

from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.shapes.convex_parts import convex_parts


@pytest.fixture(scope="module")
def dented_box() -> trimesh.Trimesh:
    """A 40 mm cube with a square recess of 20 x 20 x 20 mm: its hull is 64 / 56 = 1.143 times the solid."""
    block = trimesh.creation.box((0.04, 0.04, 0.04))
    recess = trimesh.creation.box(
        (0.02, 0.02, 0.02), transform=trimesh.transformations.translation_matrix([0, 0, 0.01])
    )
    return trimesh.boolean.difference([block, recess], engine="manifold")


@pytest.mark.parametrize(("hull_excess", "single"), [(0.15, True), (0.14, False)])
def test_hull_is_the_only_part_up_to_the_excess(dented_box: trimesh.Trimesh, hull_excess: float, single: bool) -> None:
    parameters = PrepareParameters(hull_excess=hull_excess)
    parts, _, _ = convex_parts(np.asarray(dented_box.vertices), np.asarray(dented_box.faces), parameters)
    assert (len(parts) == 1) == single
