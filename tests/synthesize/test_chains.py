"""Chains: Metropolis' rule, what depends on the seed, what is kept."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.hand.allegro import load_hand
from pipeline.records.parameters.synthesize import EnergyParameters, OptimizerParameters
from pipeline.synthesize.chains import launch_chains, run_chains
from pipeline.synthesize.energy import EnergyScene, Grasps, contact_slots, read_grasps
from pipeline.synthesize.seeds import draw_seeds, free_joints
from tests.synthesize import shapes
from tests.synthesize.test_energy import PINCH, SIDE

HAND = load_hand()
STYLES = {"pinch": (shapes.box(), PINCH, ("thumb", "index"), 2), "side": (shapes.cylinder(), SIDE, ("ring", "palm"), 3)}


def chosen(grasps: Grasps, rows) -> Grasps:
    """Some grasps of a batch."""
    return Grasps(grasps.position[rows], grasps.rotation[rows], grasps.q[rows], grasps.contacts[rows])


def problem(style: str, count: int):
    prepared, settings, fingers, contacts = STYLES[style]
    scene = EnergyScene(prepared, EnergyParameters(), settings)
    slots = contact_slots(HAND, fingers, contacts)
    generators = [np.random.default_rng([3, index]) for index in range(count)]
    return scene, slots, draw_seeds(scene, HAND, style, settings, slots, generators)


def same(a: Grasps, b: Grasps) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ("position", "rotation", "q", "contacts"))


def test_two_states_are_visited_as_boltzmann_says():
    """The hand stands still and one contact has two candidates: shares at temperature T are exp(-E / T), normalised."""
    scene, slots, first = problem("pinch", 1)
    chains = 4000
    first = chosen(first, np.zeros(chains, dtype=np.int64))
    a, b = np.flatnonzero(slots[0])[[0, 20]]
    only = [np.zeros_like(slots[0]), np.zeros_like(slots[1])]
    only[0][[a, b]] = 0.5
    only[1][first.contacts[0, 1]] = 1.0
    pair = chosen(first, np.arange(2))
    pair.contacts[:, 0] = [a, b]
    energy = scene.evaluate(pair)[0].energy
    gap = abs(energy[1] - energy[0])
    assert gap > 0.05
    first.contacts[:, 0] = a
    optimizer = OptimizerParameters(
        step=1e-9, noise=0.0, switch_probability=1.0, temperature=gap, temperature_decay=1.0, polish_iterations=0
    )
    current, best = scene.states(first), scene.states(first)
    launch_chains(scene, optimizer, 40, current, best, only, free_joints("pinch", PINCH), np.arange(chains))
    share = (read_grasps(current).contacts[:, 0] == a).mean()
    weight = np.exp(-(energy - energy.min()) / gap)
    expected = weight[0] / weight.sum()
    assert share == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / chains))
    # The best of both was seen by every chain, whatever it holds now.
    assert (read_grasps(best).contacts[:, 0] == (a, b)[int(energy.argmin())]).all()


@pytest.mark.parametrize("style", ["pinch", "side"])
def test_a_chain_depends_on_its_seed_and_start_only(style):
    scene, slots, first = problem(style, 6)
    free, seeds, optimizer = free_joints(style, STYLES[style][1]), np.arange(6) + 11, OptimizerParameters(polish_iterations=20)
    all_best, _ = run_chains(scene, optimizer, 120, first, slots, free, seeds)
    again, _ = run_chains(scene, optimizer, 120, first, slots, free, seeds)
    assert same(all_best, again)
    some = [4, 1]
    alone, _ = run_chains(scene, optimizer, 120, chosen(first, some), slots, free, seeds[some])
    assert same(alone, chosen(all_best, some))
    other, _ = run_chains(scene, optimizer, 120, first, slots, free, seeds + 1)
    assert (np.abs(other.position - all_best.position).max(1) > 0).all()


@pytest.mark.parametrize("style", ["pinch", "side"])
def test_the_best_state_is_kept_with_its_energy(style):
    scene, slots, first = problem(style, 12)
    start = scene.evaluate(first)[0].energy
    free, seeds = free_joints(style, STYLES[style][1]), np.arange(12)
    plain, terms = run_chains(scene, OptimizerParameters(polish_iterations=0), 300, first, slots, free, seeds)
    np.testing.assert_allclose(terms.energy, scene.evaluate(plain)[0].energy, rtol=1e-5)
    assert (terms.energy <= start).all() and np.median(terms.energy) < 0.5 * np.median(start)
    polished, better = run_chains(scene, OptimizerParameters(), 300, first, slots, free, seeds)
    assert (better.energy <= terms.energy).all() and (better.energy < terms.energy).mean() > 0.5
    np.testing.assert_array_equal(polished.contacts, plain.contacts)
    assert all(len(set(contacts)) == len(contacts) for contacts in plain.contacts.tolist())
    for slot, chances in enumerate(slots):
        assert (chances[plain.contacts[:, slot]] > 0).all()
    np.testing.assert_array_equal(polished.q[:, ~free], first.q[:, ~free].astype(np.float32))
    np.testing.assert_allclose(np.linalg.norm(polished.rotation, axis=1), 1, atol=1e-5)
