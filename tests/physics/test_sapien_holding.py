"""The parts of the GPU test that need no GPU."""

import numpy as np
import pytest

from pipeline.physics.engine import GRAVITY, pressing_links, steps_in
from pipeline.physics.holding import HeldGrasp, gravity_vector, hold_in_gravities, judge, place_rig
from pipeline.physics.sapien_holding import hold_all_in_gravities, upright_hand
from pipeline.physics.world import make_world
from pipeline.records.errors import UserError
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose
from tests.physics.test_holding import HAND, clamped_block

SETTINGS = PhysicsParameters()


@pytest.mark.parametrize("direction", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_rigs_are_turned_until_gravity_points_down(direction: str) -> None:
    _, _, held = clamped_block()
    T = upright_hand(direction, held.T_hand_object)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(T[:3, :3] @ gravity_vector(direction, held.T_hand_object), [0, 0, -GRAVITY], atol=1e-9)


@pytest.mark.parametrize("squeezed", [True, False])
def test_a_turned_rig_ends_as_the_upright_one_under_turned_gravity(squeezed: bool) -> None:
    q, squeeze, held = clamped_block()
    grasp = HeldGrasp((held,), q, squeeze if squeezed else q, HAND)
    limits = ValidateParameters(gravity_directions=["+y"])
    settings = limits.for_floating_hand(SETTINGS)
    world = make_world(settings)
    T_world_hand = upright_hand("+y", held.T_hand_object)
    bodies = place_rig(world, grasp, T_world_hand)
    world.step(steps_in(limits.gravity_seconds, world.frequency))
    pressing = pressing_links(bodies[0], limits.contact_impulse)
    turned = judge(grasp.objects, [inverse_pose(T_world_hand) @ bodies[0].pose], [pressing])
    expected = hold_in_gravities(SETTINGS, limits, grasp.objects, q, grasp.squeeze_q, HAND)
    assert turned.held(limits) == squeezed == (expected.failed_direction == "")
    assert turned.in_contact == tuple(expected.in_contact[0])
    if squeezed:
        np.testing.assert_allclose(turned.drift, expected.drift[0], atol=5e-4)


def test_without_a_gpu_one_sentence_says_so() -> None:
    torch = pytest.importorskip("torch")
    if torch.cuda.is_available():
        pytest.skip("there is a GPU")
    q, squeeze, held = clamped_block()
    with pytest.raises(UserError, match="no usable CUDA device"):
        hold_all_in_gravities(SETTINGS, ValidateParameters(), [HeldGrasp((held,), q, squeeze, HAND)])
