"""Grasps of one object, synthesized or your own, and two-object grasps from the trained model."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from pipeline.hand.model import Hand
    from pipeline.records.objects import PreparedObject
    from pipeline.records.parameters import Parameters
    from pipeline.synthesize.candidates import Request

Style = Literal["pinch", "side"]


def synthesize(
    prepared: PreparedObject, style: Style, parameters: Parameters, *, hand: Hand, chains: int
) -> pd.DataFrame:
    """Return grasp candidates of an object, one row per annealed chain.

    The columns are those of ``CANDIDATES`` in ``pipeline/records/tables.py``: hand pose, joints, contacts, the terms of
    the energy, and ``rejected_by``, which is empty where the candidate passed the energy filter.

    Args:
        parameters: of which `seed`, `synthesize` and `compute` are used.
        chains: how many candidates to make.
    """
    from pipeline.synthesize import candidates

    return candidates.synthesize(_request(prepared, style, parameters, hand, chains), parameters.compute)


def candidates_of(
    prepared: PreparedObject,
    style: Style,
    T_object_hand: ArrayLike,
    q: ArrayLike,
    parameters: Parameters,
    *,
    hand: Hand,
) -> pd.DataFrame:
    """Return grasps of your own as a table of candidates, with the columns and scores of :func:`synthesize`.

    Contacts, and with them the fingers that hold, are assigned: near the surface, with forces that balance.

    Args:
        T_object_hand: (n, 4, 4) hand frame in the object's frame.
        q: (n, J) rad, in the order of ``hand.joint_names``.
        parameters: of which `synthesize` is used.
    """
    from pipeline.energy.scene import EnergyScene, Grasps
    from pipeline.records.poses import position_quaternion
    from pipeline.sample.contacts import choose_contacts
    from pipeline.shapes.distance_field import DistanceField
    from pipeline.synthesize.candidates import Block, block_rows

    request = _request(prepared, style, parameters, hand, chains=1)
    poses, joints = np.asarray(T_object_hand, np.float64), np.asarray(q, np.float64)
    field, rng = DistanceField(prepared), np.random.default_rng(0)
    contacts = choose_contacts(hand, prepared, field, poses, joints, request.energy, request.settings, rng)
    scene = EnergyScene(prepared, request.energy, request.settings, device=request.optimizer.device, hand=hand)
    tables = []
    for fingers in sorted(set(contacts.fingers)):
        own = [index for index, used in enumerate(contacts.fingers) if used == fingers]
        candidates = np.stack([contacts.candidates[index] for index in own])
        grasps = Grasps(*position_quaternion(poses[own]), joints[own], candidates)
        tables.append(block_rows(request, Block(fingers, tuple(own)), grasps, scene.evaluate(grasps)[0]))
    return pd.concat(tables).sort_values("grasp_id", ignore_index=True)


def validate(candidates: pd.DataFrame, prepared: PreparedObject, parameters: Parameters, *, hand: Hand) -> pd.DataFrame:
    """Return candidates after physics: six gravities, approach, table, and the gentle squeeze of a pinch.

    Every row whose ``rejected_by`` is empty is tested. The columns are those of ``VALIDATED`` in
    ``pipeline/records/tables.py``; ``rejected_by`` then names the first check that failed.

    Args:
        candidates: of :func:`synthesize` or :func:`candidates_of`.
        parameters: of which `seed`, `physics`, `validate`, `robustness` and `compute` are used.
    """
    from pipeline.hand.support import PLANE
    from pipeline.robustness.measures import measuring
    from pipeline.validate.table import validate_table

    limits = parameters.validate_.model_copy(update={"most_candidates": len(candidates)})
    label = f"validate {prepared.name}"
    return validate_table(
        candidates,
        prepared,
        parameters.physics,
        limits,
        parameters.compute,
        label,
        support=PLANE,
        hand=hand,
        measuring=measuring(parameters.robustness, parameters.seed, prepared.name),
    )


def sample_grasps(
    object0: str | os.PathLike[str], object1: str | os.PathLike[str], count: int, output: str | os.PathLike[str]
) -> pd.DataFrame:
    """Return two-object grasps of two files, drawn from ``models/train``, checked, best first.

    Lengths and frames are those of the files. ``output`` receives the table (``grasps.parquet``, ``grasps.json``) and
    ``grasps.html``, a page to look at.

    Args:
        object0: mesh or point cloud in metres, z up; picked first.
        object1: picked second.

    Raises:
        UserError: a file cannot be used, there is no trained model, or no sample passed the checks.
    """
    from pipeline.propose.__main__ import propose

    propose((Path(object0), Path(object1)), count, Path(output))
    return pd.read_parquet(Path(output) / "grasps.parquet")


def _request(prepared: PreparedObject, style: Style, parameters: Parameters, hand: Hand, chains: int) -> Request:
    from pipeline.synthesize.candidates import Request

    settings = parameters.synthesize.pinch if style == "pinch" else parameters.synthesize.side
    return Request(
        prepared=prepared,
        style=style,
        run_seed=parameters.seed,
        energy=parameters.synthesize.energy,
        optimizer=parameters.synthesize.optimizer,
        settings=settings.model_copy(update={"chains": chains}),
        hand=hand,
    )
