"""All candidates of one object in one style: chains in blocks over processes, scores, filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.compute.fan_out import Workers
from pipeline.compute.pool import Calls, Work, run_one
from pipeline.compute.shared import Shared
from pipeline.energy.contacts import contact_slots
from pipeline.energy.scene import EnergyScene, Grasps, compile_kernels
from pipeline.hand.model import Hand
from pipeline.hand.moves import finger_joints, straight
from pipeline.records.energy_terms import Terms
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.synthesize import EnergyParameters, OptimizerParameters, StyleParameters
from pipeline.records.synthesis_reasons import SynthesisReason
from pipeline.stages.seeds import item_generator, item_seed
from pipeline.synthesize.chains import run_chains
from pipeline.synthesize.scoring import duplicates, first_failures, score_exactly
from pipeline.synthesize.seeds import draw_seeds, free_joints


@dataclass(frozen=True)
class Request:
    """What to synthesize."""

    prepared: PreparedObject
    style: str
    run_seed: int
    energy: EnergyParameters
    optimizer: OptimizerParameters
    settings: StyleParameters
    hand: Hand
    waiting: tuple[str, ...] = ()  # fingers that are straight, as they pick other objects later


@dataclass(frozen=True)
class Block:
    """Chains that run in one launch; all of one finger set."""

    fingers: tuple[str, ...]
    chains: tuple[int, ...]


def split_chains(request: Request) -> list[Block]:
    """Return blocks of chains; chain i belongs to finger set i modulo their number."""
    blocks = []
    sets = request.settings.finger_sets
    for index, fingers in enumerate(sets):
        chains = range(index, request.settings.chains, len(sets))
        for start in range(0, len(chains), request.optimizer.batch):
            blocks.append(Block(tuple(fingers), tuple(chains[start : start + request.optimizer.batch])))
    return blocks


def first_states(
    request: Request, block: Block, scene: EnergyScene
) -> tuple[Grasps, list[NDArray[np.float64]], NDArray[np.bool_], NDArray[np.int64]]:
    """Return what the chains of a block start from: states, contact slots, free joints (J,), seeds.

    States and seeds are those of all starts, chain by chain. The first is what the chain would have alone.
    """
    hand, settings = request.hand, request.settings
    key = "+".join(block.fingers)
    slots = contact_slots(
        hand, block.fingers, settings.contacts[key], settings.links.get(key, ()), settings.free_contacts
    )
    identity = ("synthesize", request.prepared.name, request.style)
    starts = [(chain, *([start] if start else [])) for chain in block.chains for start in range(settings.starts)]
    generators = [item_generator(request.run_seed, *identity, *start) for start in starts]
    seeds = np.array([item_seed(request.run_seed, *identity, *start) & 0x7FFFFFFF for start in starts])
    first = draw_seeds(scene, hand, request.style, settings, slots, generators, request.waiting)
    return first, slots, free_joints(hand, request.style, settings, request.waiting), seeds


def run_block(request: Request, block: Block) -> tuple[Grasps, Terms]:
    """Return the states that a block's chains end with, and their terms."""
    hand = request.hand
    scene = EnergyScene(request.prepared, request.energy, request.settings, hand, request.optimizer.device)
    first, slots, free, seeds = first_states(request, block, scene)
    settings = request.settings
    best, _ = run_chains(scene, request.optimizer, settings.iterations, first, slots, free, seeds, settings.starts)
    # The energy only leans against the limits, so that the best state may lie a little beyond.
    best.q = np.clip(best.q, hand.lower, hand.upper)
    return best, scene.evaluate(best)[0]


def touching(hand: Hand, fingers: Sequence[str], contacts: NDArray[np.int64]) -> list[str]:
    """Return, per row of contacts (B, n), which of ``fingers`` touch, as in ``thumb+index``."""
    own = [{hand.contact_finger[contact] for contact in row} for row in contacts]
    return ["+".join(finger for finger in fingers if finger in touched) for touched in own]


def block_rows(request: Request, block: Block, grasps: Grasps, terms: Terms) -> pd.DataFrame:
    """Return the table rows of a block, scored exactly."""
    terms, points, normals = score_exactly(
        request.hand, request.prepared, request.energy, request.settings, grasps, terms
    )
    return pd.DataFrame(
        {
            "grasp_id": list(block.chains),
            "object": request.prepared.name,
            "style": request.style,
            "fingers": touching(request.hand, block.fingers, grasps.contacts),
            "position_object_hand": list(grasps.position),
            "quaternion_object_hand": list(grasps.rotation),
            "q": list(grasps.q),
            "contact_candidates": list(grasps.contacts),
            "contact_points": [list(each) for each in points],
            "contact_normals": [list(each) for each in normals],
            **terms.columns(),
            "rejected_by": first_failures(terms, request.energy),
        }
    )


def synthesize(request: Request, workers: Workers) -> pd.DataFrame:
    """Return one row per chain (``records.tables.CANDIDATES``), in the order of the chains."""
    return run_one(synthesis(request), workers, f"synthesize {request.style} {request.prepared.name}")


def synthesis(request: Request) -> Work[pd.DataFrame]:
    """Compute what :func:`synthesize` returns, block by block."""
    blocks = split_chains(request)
    compile_kernels(request.optimizer.device)  # once here; the workers then find them in the cache
    with Shared(request) as shared:
        tables = yield Calls(partial(_rows_of_block, shared), blocks)
    rows = pd.concat(tables, ignore_index=True)
    rows = rows.sort_values("grasp_id", ignore_index=True)
    grasps = Grasps(
        position=np.stack(rows["position_object_hand"].tolist()),
        rotation=np.stack(rows["quaternion_object_hand"].tolist()),
        q=np.stack(rows["q"].tolist()),
        contacts=np.zeros((len(rows), 0), dtype=np.int64),
    )
    same = duplicates(grasps, rows["energy"].to_numpy(), (rows["rejected_by"] == "").to_numpy())
    rows.loc[same, "rejected_by"] = SynthesisReason.DUPLICATE.value
    if request.waiting:  # while this object is picked
        joints = finger_joints(request.waiting, request.hand)
        rows["q"] = [_with(q, joints, straight(request.waiting, request.hand)) for q in rows["q"]]
    return rows


def _with(q: NDArray[np.float64], joints: NDArray[np.int64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    changed = np.array(q)
    changed[joints] = angles
    return changed


def _rows_of_block(shared: Shared[Request], block: Block) -> pd.DataFrame:
    return block_rows(shared.value, block, *run_block(shared.value, block))
