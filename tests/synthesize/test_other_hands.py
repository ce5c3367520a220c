"""A hand is a description: energy, gradient, seeds, chains and physics of hands that no code names."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.energy.scene import EnergyScene, Grasps
from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand, hand_of_file, load_hand
from pipeline.records.errors import UserError
from pipeline.records.parameters.synthesize import EnergyParameters, OptimizerParameters, StyleParameters
from pipeline.synthesize.candidates import Request, synthesize
from tests.hand.toy import write_coupled, write_toy
from tests.synthesize import shapes
from tests.synthesize.energy_oracle import EnergyOracle
from tests.synthesize.styles import some_style

SETS = {
    "toy": [["left", "right"], ["left", "right", "far"]],
    "coupled": [["left", "right"], ["left", "right", "far"]],
    "dclaw": [["one", "two"], ["one", "two", "three"]],
}


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    return hand_of_file(write_toy(tmp_path_factory.mktemp("hands") / "toy"))


def style_of(name: str, **changes: object) -> StyleParameters:
    counts = {"+".join(fingers): len(fingers) for fingers in SETS[name]}
    reach = {"toy": (0.08, 0.14), "coupled": (0.08, 0.14), "dclaw": (0.16, 0.23)}[name]
    return some_style(
        finger_sets=SETS[name], contacts=counts, table_clearance=0.005, distance_from_palm=reach, **changes
    )


@pytest.fixture(scope="module")
def coupled(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    return hand_of_file(write_coupled(tmp_path_factory.mktemp("hands") / "coupled"))


@pytest.mark.parametrize("name", ["toy", "coupled", "dclaw"])
def test_terms_and_gradient_equal_autograd(name: str, toy: Hand, coupled: Hand) -> None:
    hand = {"toy": toy, "coupled": coupled}.get(name) or load_hand(name)
    prepared, energy, rng = shapes.cylinder(), EnergyParameters(), np.random.default_rng(4)
    count, contacts = 16, 3
    rotation = Rotation.random(count, random_state=4)
    distance = rng.uniform(0.12 if name == "dclaw" else 0.04, 0.22 if name == "dclaw" else 0.15, (count, 1))
    position = -rotation.as_matrix() @ hand.palm_normal * distance + rng.normal(0, 0.02, (count, 3))
    share = rng.uniform(-0.1, 1.1, (count, hand.joint_count))
    grasps = Grasps(
        position=position.astype(np.float32).astype(float),
        rotation=rotation.as_quat(canonical=True, scalar_first=True).astype(np.float32).astype(float),
        q=(hand.lower + share * (hand.upper - hand.lower)).astype(np.float32).astype(float),
        contacts=np.stack([rng.choice(len(hand.contact_link), contacts, replace=False) for _ in range(count)]),
    )
    style = style_of(name)
    terms, gradients = EnergyScene(prepared, energy, style, hand).evaluate(grasps)
    assert gradients.shape == (count, 6 + hand.joint_count)
    oracle = EnergyOracle(prepared, energy, style, hand)
    rotations = Rotation.from_quat(grasps.rotation, scalar_first=True).as_matrix()
    smooth = 0
    for index in range(count):
        truth = oracle(grasps.position[index], rotations[index], grasps.q[index], grasps.contacts[index])
        assert terms.energy[index] == pytest.approx(truth.energy, rel=2e-5)
        names = ("penetration", "table", "self_penetration", "joints")
        np.testing.assert_allclose(
            [getattr(terms, name)[index] for name in names],
            [truth.terms[name] for name in names],
            rtol=2e-5,
            atol=5e-6,
        )
        if truth.kink_distance > 2e-7:
            error = np.linalg.norm(gradients[index] - truth.gradient) / np.linalg.norm(truth.gradient)
            assert error <= 1e-4
            smooth += 1
    assert smooth >= 5
    assert (terms.penetration > 0).sum() >= 2 and (terms.table > 0).sum() >= 2
    assert (terms.joints > 0).sum() >= 4 and (terms.self_penetration > 0).sum() >= 1


def test_a_made_up_hand_grasps(toy: Hand) -> None:
    """A cylinder: rows of the table, joints within limits, contacts where the hand's kinematics puts them."""
    prepared, energy = shapes.cylinder(), EnergyParameters()
    optimizer = OptimizerParameters(batch=16, polish_iterations=100)
    request = Request(prepared, "pinch", 1, energy, optimizer, style_of("toy", chains=16, iterations=300), hand=toy)
    rows = synthesize(request, workers=1)
    q = np.stack(rows["q"].tolist())
    assert q.shape == (16, 6) and (q >= toy.lower).all() and (q <= toy.upper).all()
    assert set(rows["fingers"]) <= {"left+right", "left+right+far"}
    passed = rows[rows["rejected_by"] == ""]
    assert len(passed) >= 2
    row = passed.iloc[0]
    chosen = np.asarray(row["contact_candidates"])
    local = points_on_links(
        link_poses(toy, np.asarray(row["q"])[None]), toy.contact_link[chosen], toy.contact_points[chosen]
    )[0]
    R = Rotation.from_quat(row["quaternion_object_hand"], scalar_first=True).as_matrix()
    np.testing.assert_allclose(local @ R.T + row["position_object_hand"], np.stack(row["contact_points"]), atol=1e-9)


def test_a_hand_with_coupled_and_sliding_joints_grasps(coupled: Hand) -> None:
    request = Request(
        shapes.cylinder(),
        "pinch",
        1,
        EnergyParameters(),
        OptimizerParameters(batch=16, polish_iterations=100),
        style_of("coupled", chains=16, iterations=300),
        hand=coupled,
    )
    rows = synthesize(request, workers=1)
    q = np.stack(rows["q"].tolist())
    assert q.shape == (16, 4) and (q >= coupled.lower).all() and (q <= coupled.upper).all()
    assert np.ptp(q[:, 3]) > 0.002  # m, the joint that slides is used
    assert (rows["rejected_by"] == "").sum() >= 1


def test_released_seeds_need_a_released_posture(toy: Hand) -> None:
    style = style_of("toy", chains=2, iterations=10, released_seeds=True)
    request = Request(shapes.cylinder(), "pinch", 1, EnergyParameters(), OptimizerParameters(), style, hand=toy)
    with pytest.raises(UserError, match="needs a released_posture, which the hand toy does not have"):
        synthesize(request, workers=1)
