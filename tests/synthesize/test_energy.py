"""The fused kernel against dense torch autograd, and its terms against theory."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.energy.scene import EnergyScene, Grasps
from pipeline.hand.model import load_hand
from pipeline.records.parameters.synthesize import EnergyParameters
from tests.synthesize import shapes
from tests.synthesize.energy_oracle import EnergyOracle
from tests.synthesize.styles import some_style

PINCH = some_style(
    finger_sets=[["thumb", "index"]], contacts={"thumb+index": 2}, table_clearance=0.005, keep_out_margin=0.002
)
SIDE = some_style(
    finger_sets=[["ring", "palm"]],
    contacts={"ring+palm": 3},
    table_clearance=0.01,
    mount_clearance=0.005,
    keep_out_margin=0.003,
)


def random_grasps(count: int, contacts: int, reach: float, seed: int) -> Grasps:
    """Hands about the object in any posture, also beyond the limits; ``reach`` is how far the palm is, m."""
    hand, rng = load_hand("allegro"), np.random.default_rng(seed)
    rotation = Rotation.random(count, random_state=seed)
    position = -rotation.as_matrix()[:, :, 0] * rng.uniform(0.02, reach, (count, 1)) + rng.normal(0, 0.02, (count, 3))
    share = rng.uniform(-0.1, 1.1, (count, 16))
    return Grasps(
        position=position,
        rotation=rotation.as_quat(canonical=True, scalar_first=True),
        q=hand.lower + share * (hand.upper - hand.lower),
        contacts=np.stack([rng.choice(len(hand.contact_link), contacts, replace=False) for _ in range(count)]),
    )


@pytest.mark.parametrize(
    ("prepared", "style", "contacts", "energy"),
    [
        (shapes.box(), PINCH, 2, EnergyParameters()),
        (shapes.cylinder(), SIDE, 3, EnergyParameters()),
        (
            shapes.cylinder(),
            PINCH.model_copy(update={"keep_out_margin": None}),
            4,
            EnergyParameters(scale_torque=False, balance_forces=False, object_points=500),
        ),
    ],
)
def test_terms_and_gradient_equal_autograd(prepared, style, contacts, energy):
    grasps = random_grasps(24, contacts, 0.14, seed=contacts)
    hand = load_hand("allegro")
    if energy.balance_forces:  # both opposing groups need a contact
        grasps.contacts[:, 0] = np.flatnonzero(np.array(hand.contact_finger) == "thumb")[5]
        grasps.contacts[:, 1] = np.flatnonzero(np.array(hand.contact_finger) == "ring")[7]
    # The kernel computes in single precision: the oracle gets the same rounded states.
    grasps = Grasps(
        grasps.position.astype(np.float32).astype(float),
        grasps.rotation.astype(np.float32).astype(float),
        grasps.q.astype(np.float32).astype(float),
        grasps.contacts,
    )
    terms, gradients = EnergyScene(prepared, energy, style, hand).evaluate(grasps)
    oracle = EnergyOracle(prepared, energy, style, hand)
    rotations = Rotation.from_quat(grasps.rotation, scalar_first=True).as_matrix()
    errors, smooth = [], []
    for index in range(len(grasps)):
        truth = oracle(grasps.position[index], rotations[index], grasps.q[index], grasps.contacts[index])
        for name, value in truth.terms.items():
            assert getattr(terms, name)[index] == pytest.approx(value, rel=2e-5, abs=5e-6), name
        assert terms.energy[index] == pytest.approx(truth.energy, rel=2e-5)
        error = np.linalg.norm(gradients[index] - truth.gradient) / np.linalg.norm(truth.gradient)
        errors.append(error)
        smooth.append(truth.kink_distance > 2e-7)
    errors, smooth = np.array(errors), np.array(smooth)
    assert smooth.sum() >= 8
    assert errors[smooth].max() <= 1e-4
    assert (terms.penetration > 0).sum() >= 6 and (terms.table > 0).sum() >= 6
    assert (terms.keep_out > 0).sum() >= (12 if style.keep_out_margin is not None else 0)
    assert (terms.self_penetration > 0).sum() >= 3 and (terms.joints > 0).sum() >= 8
