"""Cost of the synthesis kernel on one core: energy with gradient, and whole chain iterations, at the default settings.

    python benchmarks/synthesis_kernel.py [--grasps 256] [--runs 5]

Target: at most 25 us per grasp and iteration at 256 grasps (column `near contact`; `iteration` adds the moves of the
chain). Needs no data, takes some minutes. Process CPU time, minimum of several runs.

The objects are the analytic ones of the tests (box, cylinder; 48-cell grids), with 2000 object points and 1000 hand
points. States: `random` hands lie anywhere about the object and overlap it deeply; `near contact` hands are what a
short chain of the style ends with.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from pipeline.energy.scene import EnergyScene, Grasps  # noqa: E402
from pipeline.hand.model import load_hand  # noqa: E402
from pipeline.records.objects import PreparedObject  # noqa: E402
from pipeline.records.parameters.synthesize import EnergyParameters, OptimizerParameters, StyleParameters  # noqa: E402
from pipeline.synthesize.candidates import Block, Request, first_states  # noqa: E402
from pipeline.synthesize.chains import run_chains  # noqa: E402
from tests.synthesize import shapes  # noqa: E402
from tests.synthesize.styles import some_style  # noqa: E402

HAND = load_hand("allegro")
TARGET = 25  # us per grasp and iteration
SHORT_CHAIN = 600  # iterations until states are near contact

PINCH = some_style(finger_sets=[["thumb", "index"]], contacts={"thumb+index": 2}, table_clearance=0.005)
SIDE = some_style(
    finger_sets=[["ring", "palm"]], contacts={"ring+palm": 3}, table_clearance=0.01, mount_clearance=0.005
)


def cheapest(work: Callable[[], object], runs: int) -> float:
    """CPU seconds of the cheapest run."""
    times = []
    for _ in range(runs):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def random_states(count: int, contacts: int) -> Grasps:
    rng = np.random.default_rng(0)
    rotation = Rotation.random(count, rng=rng)
    position = -rotation.as_matrix()[:, :, 0] * rng.uniform(0.02, 0.14, (count, 1)) + rng.normal(0, 0.02, (count, 3))
    return Grasps(
        position=position,
        rotation=rotation.as_quat(scalar_first=True),
        q=rng.uniform(HAND.lower, HAND.upper, (count, HAND.joint_count)),
        contacts=np.stack([rng.choice(len(HAND.contact_link), contacts, replace=False) for _ in range(count)]),
    )


def evaluation_cost(scene: EnergyScene, grasps: Grasps, runs: int, repeats: int = 20) -> float:
    """Microseconds per grasp of energy with gradient."""
    states, scratch, weights = scene.states(grasps), scene.scratch(grasps), scene.weights()
    scene.launch_evaluation(states, scratch, weights)

    def work() -> None:
        for _ in range(repeats):
            scene.launch_evaluation(states, scratch, weights)

    return 1e6 * cheapest(work, runs) / (repeats * len(grasps))


def row(style: str, prepared: PreparedObject, settings: StyleParameters, grasps: int, runs: int) -> str:
    energy, optimizer = EnergyParameters(), OptimizerParameters(polish_iterations=0)
    scene = EnergyScene(prepared, energy, settings, HAND)
    fingers = tuple(settings.finger_sets[0])
    request = Request(prepared, style, 1, energy, optimizer, settings, HAND)
    first, slots, free, seeds = first_states(request, Block(fingers, tuple(range(grasps))), scene)

    def chain(start: Grasps, length: int) -> Grasps:
        return run_chains(scene, optimizer, length, start, slots, free, seeds)[0]

    near = chain(first, SHORT_CHAIN)
    length = settings.iterations
    whole = 1e6 * cheapest(lambda: chain(first, length), max(1, runs // 2)) / (grasps * length)
    contacts = first.contacts.shape[1]
    figures = [evaluation_cost(scene, states, runs) for states in (random_states(grasps, contacts), first, near)]
    return f"{style:6} {prepared.name:9} {contacts:8d} " + " ".join(f"{value:13.1f}" for value in [*figures, whole])


def main(grasps: int, runs: int) -> None:
    print(f"us per grasp, one core, {grasps} grasps, minimum of {runs} runs; target: {TARGET} or less")
    names = ("random", "seeds", "near contact", "iteration")
    print(f"{'style':6} {'object':9} {'contacts':>8} " + " ".join(f"{name:>13}" for name in names))
    print(row("pinch", shapes.box(), PINCH, grasps, runs))
    print(row("side", shapes.cylinder(), SIDE, grasps, runs))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grasps", type=int, default=256, help="evaluated at once (default: 256)")
    parser.add_argument("--runs", type=int, default=5, help="of which the cheapest counts (default: 5)")
    options = parser.parse_args()
    main(options.grasps, options.runs)
