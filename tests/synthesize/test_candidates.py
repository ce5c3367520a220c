"""Whole small runs on analytic shapes: chains find grasps, blocks and workers change nothing, the command works."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from pipeline.hand.allegro import load_hand
from pipeline.records.errors import UserError
from pipeline.records.parameters import load_parameters
from pipeline.records.parameters.synthesize import EnergyParameters, OptimizerParameters, StyleParameters
from pipeline.records.tables import CANDIDATES, write_table
from pipeline.synthesize import candidates
from pipeline.synthesize.__main__ import main, sections
from pipeline.synthesize.candidates import Request, split_chains, synthesize
from pipeline.synthesize.energy import EnergyScene, block_order, contact_slots
from pipeline.synthesize.seeds import draw_seed, draw_seeds, free_joints
from tests.synthesize import shapes

SETS = StyleParameters(
    finger_sets=[["thumb", "index"], ["thumb", "index", "middle"]],
    contacts={"thumb+index": 2, "thumb+index+middle": 3},
    distal_links={"thumb+index+middle": 2},
    chains=40,
    iterations=600,
    table_clearance=0.005,
)
SIDE = StyleParameters(
    finger_sets=[["ring", "palm"]], contacts={"ring+palm": 3}, chains=8, table_clearance=0.01, mount_clearance=0.005
)


def request(**changes) -> Request:
    settings = SETS.model_copy(update=changes)
    return Request(shapes.box(), "pinch", 3, EnergyParameters(), OptimizerParameters(), settings)


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return synthesize(request(), workers=1)


def test_chains_find_grasps_that_close_on_a_box(rows):
    assert (rows["rejected_by"] == "").sum() >= 5
    good = rows[rows["rejected_by"] == ""]
    for row in good.itertuples():
        contacts = np.stack(row.contact_points)
        # The box's own distance, not the grid's: contacts lie on its surface.
        assert np.abs(shapes.box_distance(np.full(3, 0.021))(contacts)).sum() <= 0.005
        fingers = {load_hand().contact_finger[c] for c in row.contact_candidates}
        assert fingers == set(row.fingers.split("+"))
        assert len(set(row.contact_candidates)) == len(row.contact_candidates)
    q = np.stack(rows["q"].tolist())
    assert (q >= load_hand().lower).all() and (q <= load_hand().upper).all()


def test_rows_do_not_depend_on_blocks_and_fit_the_table(rows, monkeypatch, tmp_path):
    monkeypatch.setattr(candidates, "CHAINS_PER_BLOCK", 7)
    again = synthesize(request(), workers=2)
    first, second = tmp_path / "a.parquet", tmp_path / "b.parquet"
    write_table(first, rows, CANDIDATES)
    write_table(second, again, CANDIDATES)
    assert first.read_bytes() == second.read_bytes()


def test_more_chains_leave_the_earlier_ones_as_they_are(rows):
    longer = synthesize(request(chains=44), workers=1)
    np.testing.assert_array_equal(np.stack(longer["q"].tolist())[:40], np.stack(rows["q"].tolist()))


def test_every_chain_is_in_one_block():
    blocks = split_chains(request(chains=101))
    assert sorted(chain for block in blocks for chain in block.chains) == list(range(101))


@pytest.mark.parametrize(("style", "settings"), [("pinch", SETS), ("side", SIDE)])
def test_first_states_are_free_and_look_where_they_should(style, settings):
    hand, prepared = load_hand(), shapes.cylinder()
    fingers = settings.finger_sets[0]
    slots = contact_slots(hand, fingers, settings.contacts["+".join(fingers)], 4)
    scene = EnergyScene(prepared, EnergyParameters(), settings)
    generators = [np.random.default_rng(chain) for chain in range(12)]
    seeds = draw_seeds(scene, hand, style, settings, slots, generators)
    terms, _ = scene.evaluate(seeds)
    assert np.all(terms.penetration + terms.table + terms.self_penetration == 0)
    R = Rotation.from_quat(seeds.rotation, scalar_first=True).as_matrix()
    distance = np.linalg.norm(seeds.position, axis=1)
    # The palm looks at the object's origin up to the noise on the rotation.
    np.testing.assert_allclose(-seeds.position / distance[:, None], R[:, :, 0], atol=0.5)
    palm, thumb_side_up = (R[:, 2, 0], R[:, 2, 1])
    if style == "pinch":
        assert palm.max() < -0.3 and R[:, 0, 2].min() > 0  # palm down, fingers away from the robot
    else:
        assert np.abs(palm).max() < 0.9 and thumb_side_up.min() > 0  # palm sideways, index finger up
    assert free_joints(style).sum() == (12 if style == "pinch" else 4)


def test_yaw_covers_the_circle_only_when_asked():
    hand = load_hand()
    slots = contact_slots(hand, ["thumb", "index"], 2, 4)
    for full in (False, True):
        settings = SETS.model_copy(update={"full_yaw": full})
        draws = [draw_seed(hand, "pinch", settings, slots, np.random.default_rng(k)) for k in range(60)]
        fingers = np.array([Rotation.from_quat(d.rotation[0], scalar_first=True).as_matrix()[:, 2] for d in draws])
        backwards = (fingers[:, 0] < -0.2).sum()
        assert backwards > 10 if full else backwards == 0


def test_blocks_hold_every_point_once():
    points = np.random.default_rng(0).normal(size=(1000, 3))
    blocks = block_order(points)
    assert max(len(block) for block in blocks) <= 32
    assert sorted(np.concatenate(blocks)) == list(range(1000))


@pytest.mark.parametrize(
    "changes",
    [
        {"contacts": {"thumb+index": 1, "thumb+index+middle": 3}},
        {"contacts": {"thumb+index": 2}},
        {"distal_links": {"ring+palm": 2}},
        {"distal_links": {"thumb+index": 0}},
        {"finger_sets": [["thumb", "thumb"]]},
        {"distance_from_palm": (0.2, 0.1)},
    ],
)
def test_disagreeing_contact_sets_are_refused(changes):
    with pytest.raises(ValueError):
        StyleParameters.model_validate({**SETS.model_dump(), **changes})


def test_sections_are_those_of_the_style():
    assert "synthesize.side" not in sections("pinch", "cube")
    assert set(load_parameters(sections("side", "cube"))) == set(sections("side", "cube"))


def test_missing_object_is_one_sentence(tmp_path, monkeypatch, capsys):
    parameters = (tmp_path.cwd() / "params.yaml").read_text()
    (tmp_path / "params.yaml").write_text(parameters)
    monkeypatch.chdir(tmp_path)
    assert main(["--style", "pinch", "--object", "cube"]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and "prepare@cube" in message
    assert UserError.__name__ not in message
