"""A two-object grasp of a cube (42 mm) and a slender cylinder (57 x 105 mm) that was found by the pipeline."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import trimesh

from pipeline.evaluate.grasps import SequenceGrasp, grasp_from_row
from pipeline.evaluate.trial import TrialInput
from pipeline.hand.model import load_hand
from pipeline.pairing.task import groups_of
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from tests.objects import prepared
from tests.pairs import PAIR

HAND = load_hand("allegro")
GROUPS = groups_of(HAND, PAIR)


@pytest.fixture(scope="session")
def objects() -> tuple[PreparedObject, PreparedObject]:
    return (
        prepared("cube", trimesh.creation.box([0.042] * 3)),
        prepared("slender_cylinder", trimesh.creation.cylinder(0.0285, 0.105, sections=64)),
    )


@pytest.fixture(scope="session")
def grasp_row() -> dict[str, Any]:
    return json.loads((Path(__file__).parent / "grasp.json").read_text())


@pytest.fixture(scope="session")
def grasp(grasp_row: dict[str, Any]) -> SequenceGrasp:
    return grasp_from_row(grasp_row, HAND, GROUPS)


@pytest.fixture(scope="session")
def trial_input(objects: tuple[PreparedObject, PreparedObject], grasp: SequenceGrasp) -> Callable[..., TrialInput]:
    """Make the inputs of a trial; keywords replace fields of :class:`TrialInput`."""

    def make(**changes: Any) -> TrialInput:
        inputs = TrialInput(
            trial=0,
            source="synthesized",
            hand=HAND,
            picks=PAIR,
            objects=objects,
            grasps=(grasp,),
            settings=EvaluateParameters(),
            physics=PhysicsParameters(),
            seed=7,
        )
        return replace(inputs, **changes)

    return make
