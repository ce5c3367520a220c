"""Chains: Metropolis' rule, what depends on the seed, what is kept."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.energy.contacts import contact_slots
from pipeline.energy.scene import EnergyScene, Grasps, chosen, read_grasps
from pipeline.hand.model import load_hand
from pipeline.records.parameters.synthesize import EnergyParameters, OptimizerParameters
from pipeline.synthesize.chains import launch_chains, run_chains
from pipeline.synthesize.seeds import draw_seeds, free_joints
from tests.synthesize import shapes
from tests.synthesize.test_energy import PINCH, SIDE

HAND = load_hand("allegro")
STYLES = {"pinch": (shapes.box(), PINCH, ("thumb", "index"), 2), "side": (shapes.cylinder(), SIDE, ("ring", "palm"), 3)}


def problem(style: str, count: int):
    prepared, settings, fingers, contacts = STYLES[style]
    scene = EnergyScene(prepared, EnergyParameters(), settings, HAND)
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
    launch_chains(scene, optimizer, 40, current, best, only, free_joints(HAND, "pinch", PINCH), np.arange(chains))
    share = (read_grasps(current).contacts[:, 0] == a).mean()
    weight = np.exp(-(energy - energy.min()) / gap)
    expected = weight[0] / weight.sum()
    assert share == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / chains))
    # The best of both was seen by every chain, whatever it holds now.
    assert (read_grasps(best).contacts[:, 0] == (a, b)[int(energy.argmin())]).all()


@pytest.mark.parametrize("style", ["pinch", "side"])
def test_a_chain_depends_on_its_seed_and_start_only(style):
    scene, slots, first = problem(style, 6)
    free, seeds, optimizer = (
        free_joints(HAND, style, STYLES[style][1]),
        np.arange(6) + 11,
        OptimizerParameters(polish_iterations=20),
    )
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
    free, seeds = free_joints(HAND, style, STYLES[style][1]), np.arange(12)
    plain, terms = run_chains(scene, OptimizerParameters(polish_iterations=0), 300, first, slots, free, seeds)
    np.testing.assert_allclose(terms.energy, scene.evaluate(plain)[0].energy, rtol=1e-5)
    assert (terms.energy <= start).all() and np.median(terms.energy) < 0.5 * np.median(start)
    polished, better = run_chains(scene, OptimizerParameters(), 300, first, slots, free, seeds)
    assert (better.energy <= terms.energy).all() and (better.energy < terms.energy).sum() >= 3
    np.testing.assert_array_equal(polished.contacts, plain.contacts)
    assert all(len(set(contacts)) == len(contacts) for contacts in plain.contacts.tolist())
    for slot, chances in enumerate(slots):
        assert (chances[plain.contacts[:, slot]] > 0).all()
    np.testing.assert_array_equal(polished.q[:, ~free], first.q[:, ~free].astype(np.float32))
    np.testing.assert_allclose(np.linalg.norm(polished.rotation, axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("style", ["pinch", "side"])
@pytest.mark.parametrize("keep_best", [True, False])
def test_of_several_starts_the_lowest_in_energy_is_kept(style, keep_best):
    """As if every start had been a chain of its own, with the same first state and seed."""
    scene, slots, first = problem(style, 12)
    free, seeds = free_joints(HAND, style, STYLES[style][1]), np.arange(12) + 5
    plain = OptimizerParameters(polish_iterations=0, keep_best=keep_best)
    alone, terms = run_chains(scene, plain, 150, first, slots, free, seeds)
    lowest = [min(range(chain, chain + 3), key=lambda start: terms.energy[start]) for chain in (0, 3, 6, 9)]
    assert lowest != [0, 3, 6, 9]
    kept, kept_terms = run_chains(scene, plain, 150, first, slots, free, seeds, starts=3)
    assert same(kept, chosen(alone, lowest))
    np.testing.assert_allclose(kept_terms.energy, terms.energy.reshape(4, 3).min(1), rtol=1e-5)
    # Only the kept one is polished.
    polish = plain.model_copy(update={"polish_iterations": 30})
    polished, better = run_chains(scene, polish, 150, first, slots, free, seeds, starts=3)
    all_polished, all_terms = run_chains(scene, polish, 150, first, slots, free, seeds)
    assert same(polished, chosen(all_polished, lowest))
    np.testing.assert_array_equal(better.energy, all_terms.energy[lowest])


# The released code's switches.


def one_step(optimizer: OptimizerParameters, count: int):
    """States before and after the first proposal of a batch that accepts everything."""
    scene, slots, first = problem("pinch", count)
    free, seeds = free_joints(HAND, "pinch", PINCH), np.arange(count)
    return scene, first, run_chains(scene, optimizer, 1, first, slots, free, seeds)[0]


PLAIN = OptimizerParameters(
    noise=0.0, switch_probability=0.0, temperature=1e30, polish_iterations=0, keep_best=False, step=0.002
)


def test_a_shared_preconditioner_divides_by_the_root_mean_square_of_the_batch():
    """The released rule: v = 0.98 mean(g^2) + 0.02 v, v = 0 at the beginning, q' = q - s g / sqrt(v + 1e-6)."""
    optimizer = PLAIN.model_copy(update={"shared_preconditioner": True, "momentum": 0.02})
    scene, first, moved = one_step(optimizer, 5)
    slope = scene.evaluate(first)[1]
    step = 0.002 * slope / np.sqrt(0.98 * (slope**2).mean(0) + 1e-6)
    np.testing.assert_allclose(moved.position, first.position - step[:, :3], atol=2e-6)
    free = free_joints(HAND, "pinch", PINCH)
    np.testing.assert_allclose(moved.q[:, free], (first.q - step[:, 6:])[:, free], atol=2e-6)
    # Alone, the same chain goes by its own slope: sign(g) times the step.
    _, _, alone = one_step(PLAIN, 5)
    own = 0.002 * slope / np.sqrt(slope**2 + 1e-6)
    np.testing.assert_allclose(alone.position, first.position - own[:, :3], atol=2e-6)


def test_the_second_step_remembers_two_percent_of_the_first_mean():
    optimizer = PLAIN.model_copy(update={"shared_preconditioner": True, "momentum": 0.02, "step_period": 10**9})
    scene, slots, first = problem("pinch", 3)
    free, seeds = free_joints(HAND, "pinch", PINCH), np.arange(3)
    once = run_chains(scene, optimizer, 1, first, slots, free, seeds)[0]
    twice = run_chains(scene, optimizer, 2, first, slots, free, seeds)[0]
    before, after = (scene.evaluate(states)[1] for states in (first, once))
    square = 0.98 * (after**2).mean(0) + 0.02 * 0.98 * (before**2).mean(0)
    step = 0.002 * after / np.sqrt(square + 1e-6)
    np.testing.assert_allclose(twice.position, once.position - step[:, :3], atol=5e-6)


def test_contacts_may_be_drawn_twice_only_where_that_is_allowed():
    """Three contacts from three candidates: with repeats all 27 combinations, otherwise the 6 orders of all three."""
    scene, slots, first = problem("side", 1)
    first = chosen(first, np.zeros(2000, dtype=np.int64))
    slot = np.zeros_like(slots[0])
    candidates = np.flatnonzero(slots[0])[:3]
    slot[candidates] = 1 / 3
    first.contacts[:] = candidates
    settings = {"switch_probability": 1.0, "temperature": 1e30, "step": 1e-9}
    for allowed, repeated_share in ((True, 21 / 27), (False, 0.0)):
        optimizer = PLAIN.model_copy(update=settings | {"duplicate_contacts": allowed})
        free = free_joints(HAND, "side", SIDE)
        last, _ = run_chains(scene, optimizer, 30, first, [slot] * 3, free, np.arange(2000))
        repeated = np.array([len(set(row)) < 3 for row in last.contacts.tolist()])
        assert repeated.mean() == pytest.approx(repeated_share, abs=4 * np.sqrt(0.25 / 2000))
        if not allowed:
            orders = {tuple(row) for row in last.contacts.tolist()}
            assert len(orders) == 6


def test_the_last_state_is_kept_where_the_best_is_not_asked_for():
    scene, slots, first = problem("pinch", 12)
    free, seeds = free_joints(HAND, "pinch", PINCH), np.arange(12)
    hot = OptimizerParameters(temperature_decay=1.0, polish_iterations=0, keep_best=False)
    last, terms = run_chains(scene, hot, 100, first, slots, free, seeds)
    current, best = scene.states(first), scene.states(first)
    launch_chains(scene, hot, 100, current, best, slots, free, seeds)
    assert same(last, read_grasps(current)) and not same(last, read_grasps(best))
    np.testing.assert_allclose(terms.energy, scene.evaluate(last)[0].energy, rtol=1e-5)


@pytest.mark.parametrize("style", ["pinch", "side"])
def test_a_batch_repeats_itself_to_the_byte(style):
    scene, slots, first = problem(style, 6)
    official = OptimizerParameters(
        step=0.005, switch_probability=0.5, noise=0.0, momentum=0.02, shared_preconditioner=True,
        duplicate_contacts=True, keep_best=False, polish_iterations=0,
    )  # fmt: skip
    free, seeds = free_joints(HAND, style, STYLES[style][1]), np.arange(6)
    once, _ = run_chains(scene, official, 80, first, slots, free, seeds)
    again, _ = run_chains(scene, official, 80, first, slots, free, seeds)
    assert same(once, again)
    alone, _ = run_chains(scene, official, 80, chosen(first, [0]), slots, free, seeds[:1])
    assert not np.array_equal(alone.position[0], once.position[0])  # the others of the batch count
