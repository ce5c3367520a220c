"""All candidates of one object in one style: chains in blocks over processes, scores, filter."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.compute.fan_out import fan_out
from pipeline.hand.allegro import load_hand
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.synthesize import EnergyParameters, OptimizerParameters, StyleParameters
from pipeline.records.seeds import item_generator, item_seed
from pipeline.synthesize.chains import run_chains
from pipeline.synthesize.energy import EnergyScene, Grasps, Terms, contact_slots
from pipeline.synthesize.scoring import duplicates, first_failures, score_exactly
from pipeline.synthesize.seeds import draw_seeds, free_joints

CHAINS_PER_BLOCK = 32
ALL_LINKS = 4


@dataclass(frozen=True)
class Request:
    """What to synthesize."""

    prepared: PreparedObject
    style: str
    run_seed: int
    energy: EnergyParameters
    optimizer: OptimizerParameters
    settings: StyleParameters


@dataclass(frozen=True)
class Block:
    """Chains that run in one launch; all of one finger set."""

    request: Request
    fingers: tuple[str, ...]
    chains: tuple[int, ...]


def split_chains(request: Request) -> list[Block]:
    """Return blocks of chains; chain i belongs to finger set i modulo their number."""
    blocks = []
    sets = request.settings.finger_sets
    for index, fingers in enumerate(sets):
        chains = range(index, request.settings.chains, len(sets))
        for start in range(0, len(chains), CHAINS_PER_BLOCK):
            blocks.append(Block(request, tuple(fingers), tuple(chains[start : start + CHAINS_PER_BLOCK])))
    return blocks


def first_states(
    block: Block, scene: EnergyScene
) -> tuple[Grasps, list[NDArray[np.float64]], NDArray[np.bool_], NDArray[np.int64]]:
    """Return what the chains of a block start from: states, contact slots, free joints (16,), seeds of the chains."""
    request, hand = block.request, load_hand()
    settings = request.settings
    key = "+".join(block.fingers)
    slots = contact_slots(hand, block.fingers, settings.contacts[key], settings.distal_links.get(key, ALL_LINKS))
    identity = ("synthesize", request.prepared.name, request.style)
    generators = [item_generator(request.run_seed, *identity, chain) for chain in block.chains]
    seeds = np.array([item_seed(request.run_seed, *identity, chain) & 0x7FFFFFFF for chain in block.chains])
    first = draw_seeds(scene, hand, request.style, settings, slots, generators)
    return first, slots, free_joints(request.style), seeds


def run_block(block: Block) -> tuple[Grasps, Terms]:
    """Return the best states of a block's chains and their terms."""
    request, hand = block.request, load_hand()
    scene = EnergyScene(request.prepared, request.energy, request.settings, request.optimizer.device)
    first, slots, free, seeds = first_states(block, scene)
    best, _ = run_chains(scene, request.optimizer, request.settings.iterations, first, slots, free, seeds)
    # The energy only leans against the limits, so that the best state may lie a little beyond.
    best.q = np.clip(best.q, hand.lower, hand.upper)
    return best, scene.evaluate(best)[0]


def block_rows(block: Block, grasps: Grasps, terms: Terms) -> pd.DataFrame:
    """Return the table rows of a block, scored exactly."""
    request = block.request
    terms, points, normals = score_exactly(load_hand(), request.prepared, request.energy, grasps, terms)
    return pd.DataFrame(
        {
            "grasp_id": list(block.chains),
            "object": request.prepared.name,
            "style": request.style,
            "fingers": "+".join(block.fingers),
            "position_object_hand": list(grasps.position),
            "quaternion_object_hand": list(grasps.rotation),
            "q": list(grasps.q),
            "contact_candidates": list(grasps.contacts),
            "contact_points": [list(each) for each in points],
            "contact_normals": [list(each) for each in normals],
            "energy": terms.energy,
            **{f"energy_{field.name}": getattr(terms, field.name) for field in fields(Terms) if field.name != "energy"},
            "rejected_by": first_failures(terms, request.energy),
        }
    )


def synthesize(request: Request, workers: int) -> pd.DataFrame:
    """Return one row per chain (``records.tables.CANDIDATES``), in the order of the chains."""
    blocks = split_chains(request)
    # Compile once here; the processes then find the kernels in the cache.
    EnergyScene(request.prepared, request.energy, request.settings, request.optimizer.device).compile()
    label = f"synthesize {request.style} {request.prepared.name}"
    results = fan_out(run_block, blocks, workers, label)
    rows = pd.concat(
        [block_rows(block, *result) for block, result in zip(blocks, results, strict=True)], ignore_index=True
    )
    rows = rows.sort_values("grasp_id", ignore_index=True)
    grasps = Grasps(
        position=np.stack(rows["position_object_hand"].tolist()),
        rotation=np.stack(rows["quaternion_object_hand"].tolist()),
        q=np.stack(rows["q"].tolist()),
        contacts=np.zeros((len(rows), 0), dtype=np.int64),
    )
    same = duplicates(grasps, rows["energy"].to_numpy(), (rows["rejected_by"] == "").to_numpy())
    rows.loc[same, "rejected_by"] = "duplicate"
    return rows
