"""Microseconds per grasp and iteration of the energy kernel, forward and gradient, on one core.

    python benchmarks/energy_kernel.py [--grasps 256]

2000 object points, 1000 hand points. "evaluate" is the kernel alone on the states named, "chain" a whole iteration of
the annealed chains (proposal, energy, gradient, acceptance) averaged over the run. CPU seconds of one process, the
least of several repeats. Needs the prepared objects of params.yaml below data/.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from pipeline.hand.allegro import load_hand
from pipeline.records.objects import load_prepared_object
from pipeline.records.parameters import read_parameters
from pipeline.records.seeds import item_generator, item_seed
from pipeline.synthesize.chains import run_chains
from pipeline.synthesize.energy import EnergyScene, contact_slots
from pipeline.synthesize.seeds import draw_seeds, free_joints


def least_seconds(work: Callable[[], None], repeats: int) -> float:
    spans = []
    for _ in range(repeats):
        begin = time.process_time()
        work()
        spans.append(time.process_time() - begin)
    return min(spans)


def main(count: int) -> None:
    parameters = read_parameters()
    hand, synthesis = load_hand(), parameters.synthesize
    print(f"{count} grasps, {synthesis.energy.object_points} object points, {synthesis.energy.hand_points} hand points")
    print(f"{'object':18} {'fingers':20} {'evaluate first':>15} {'evaluate final':>15} {'chain':>8}   us per grasp")
    for style in ("pinch", "side"):
        settings = getattr(synthesis, style)
        for name in getattr(parameters.styles, style):
            scene = EnergyScene(load_prepared_object(name), synthesis.energy, settings)
            scene.compile()
            for fingers in settings.finger_sets:
                key = "+".join(fingers)
                slots = contact_slots(hand, fingers, settings.contacts[key], settings.distal_links.get(key, 4))
                generators = [item_generator(0, "benchmark", name, chain) for chain in range(count)]
                seeds = np.array([item_seed(0, "benchmark", name, chain) & 0x7FFFFFFF for chain in range(count)])
                first = draw_seeds(scene, hand, style, settings, slots, generators)
                begin = time.process_time()
                best, _ = run_chains(
                    scene, synthesis.optimizer, settings.iterations, first, slots, free_joints(style), seeds
                )
                chain = (time.process_time() - begin) / (settings.iterations + synthesis.optimizer.polish_iterations)
                figures = []
                for grasps in (first, best):
                    states, scratch = scene.states(grasps), scene.scratch(grasps)

                    def repeat(scene=scene, states=states, scratch=scratch) -> None:
                        for _ in range(100):
                            scene.launch_evaluation(states, scratch)

                    figures.append(least_seconds(repeat, 5) / 100)
                cells = [1e6 * value / count for value in (*figures, chain)]
                print(f"{name:18} {key:20} {cells[0]:15.1f} {cells[1]:15.1f} {cells[2]:8.1f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grasps", type=int, default=256)
    main(parser.parse_args().grasps)
