"""Whole small runs on analytic shapes: chains find grasps, blocks and workers change nothing, the command works."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.energy.scene import EnergyScene
from pipeline.hand.model import load_hand
from pipeline.records.parameters import load_parameters
from pipeline.records.parameters.synthesize import EnergyParameters, OptimizerParameters
from pipeline.records.tables import CANDIDATES, write_table
from pipeline.synthesize.__main__ import sections
from pipeline.synthesize.candidates import Request, first_states, split_chains, synthesize, touching
from tests.synthesize import shapes
from tests.synthesize.styles import some_style

HAND = load_hand("allegro")
SETS = some_style(
    finger_sets=[["thumb", "index"], ["thumb", "index", "middle"]],
    contacts={"thumb+index": 2, "thumb+index+middle": 3},
    links={"thumb+index+middle": ["link_15.0_tip", "link_3.0_tip", "link_7.0_tip"]},
    chains=40,
    starts=2,
    iterations=600,
    table_clearance=0.005,
)


def request(batch: int = 32, **changes) -> Request:
    settings = SETS.model_copy(update=changes)
    return Request(shapes.box(), "pinch", 3, EnergyParameters(), OptimizerParameters(batch=batch), settings, HAND)


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
        fingers = {HAND.contact_finger[c] for c in row.contact_candidates}
        assert fingers == set(row.fingers.split("+"))
        assert len(set(row.contact_candidates)) == len(row.contact_candidates)
    q = np.stack(rows["q"].tolist())
    assert (q >= HAND.lower).all() and (q <= HAND.upper).all()


def test_rows_do_not_depend_on_blocks_and_fit_the_table(rows, tmp_path):
    again = synthesize(request(batch=7), workers=2)
    first, second = tmp_path / "a.parquet", tmp_path / "b.parquet"
    write_table(first, rows, CANDIDATES)
    write_table(second, again, CANDIDATES)
    assert first.read_bytes() == second.read_bytes()


def test_more_chains_leave_the_earlier_ones_as_they_are(rows):
    longer = synthesize(request(chains=44), workers=1)
    np.testing.assert_array_equal(np.stack(longer["q"].tolist())[:40], np.stack(rows["q"].tolist()))


def test_the_first_of_several_starts_is_that_of_a_chain_with_one():
    """And the others are first hands of their own, with seeds of their own."""
    several, one = request(chains=10, starts=3), request(chains=10, starts=1)
    scene = EnergyScene(one.prepared, one.energy, one.settings, HAND)
    for many_block, block in zip(split_chains(several), split_chains(one), strict=True):
        first, _, _, seeds = first_states(one, block, scene)
        firsts, _, _, all_seeds = first_states(several, many_block, scene)
        np.testing.assert_array_equal(firsts.q[::3], first.q)
        np.testing.assert_array_equal(all_seeds[::3], seeds)
        assert len(set(all_seeds.tolist())) == len(np.unique(firsts.q, axis=0)) == 3 * len(block.chains)


def test_every_chain_is_in_one_block():
    blocks = split_chains(request(chains=101))
    assert sorted(chain for block in blocks for chain in block.chains) == list(range(101))


def test_fingers_are_those_that_touch():
    """With free contacts a finger of the set may stay idle."""
    hand = HAND
    of = {finger: np.flatnonzero(np.array(hand.contact_finger) == finger) for finger in ("thumb", "index", "middle")}
    rows = [[of["middle"][0], of["thumb"][1], of["thumb"][2]], [of["index"][0], of["middle"][0], of["thumb"][5]]]
    named = touching(hand, ("thumb", "index", "middle"), np.array(rows))
    assert named == ["thumb+middle", "thumb+index+middle"]


def test_the_official_preset_finds_grasps_too():
    """Some of its chains pass its own filter on a box, and repeated runs and any number of workers agree."""
    official = OptimizerParameters(
        step=0.005, switch_probability=0.5, noise=0.0, momentum=0.02, batch=12, shared_preconditioner=True,
        duplicate_contacts=True, keep_best=False, polish_iterations=0,
    )  # fmt: skip
    energy = EnergyParameters(scale_torque=False, balance_forces=False)
    energy = energy.model_copy(update={"limit_self_penetration": None, "limit_joints": None})
    settings = SETS.model_copy(
        update={
            "chains": 24, "iterations": 2000, "free_contacts": True, "released_seeds": True,
            "starts": 1, "weight_offset": 0.0,
            "finger_sets": [["thumb", "index"]], "contacts": {"thumb+index": 2}, "links": {},
        }
    )  # fmt: skip
    asked = Request(shapes.box(), "pinch", 3, energy, official, settings, HAND)
    rows = synthesize(asked, workers=1)
    assert (rows["rejected_by"] == "").sum() >= 1
    again = synthesize(asked, workers=2)
    np.testing.assert_array_equal(np.stack(rows["q"].tolist()), np.stack(again["q"].tolist()))


def test_sections_are_those_of_the_style():
    assert "synthesize.side" not in sections("pinch")
    assert set(load_parameters(sections("side"))) == set(sections("side"))
