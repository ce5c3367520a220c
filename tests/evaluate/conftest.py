"""A two-object grasp of a cube (42 mm) and a slender cylinder (57 x 105 mm) that was found by the pipeline."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from pipeline.evaluate.grasps import SequenceGrasp, grasp_from_row
from pipeline.evaluate.trial import TrialInput
from pipeline.hand.model import load_hand
from pipeline.pairing.task import groups_of
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from tests.pairs import PAIR

HAND = load_hand("allegro")
GROUPS = groups_of(HAND, PAIR)


def prepared(name: str, mesh: trimesh.Trimesh, density: float = 500.0) -> PreparedObject:
    """A convex shape centred at its centre of mass, without a distance grid."""
    mesh.density = density
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    return PreparedObject(
        name=name,
        vertices=vertices,
        faces=faces,
        parts=((vertices, faces),),
        distance=np.zeros((0, 0, 0), np.float32),
        distance_origin=np.zeros(3),
        distance_spacing=0.001,
        surface_points=vertices,
        surface_normals=vertices,
        mass=float(mesh.mass),
        inertia=np.asarray(mesh.moment_inertia),
        volume=float(mesh.volume),
        extents=np.asarray(mesh.extents),
        provenance={},
    )


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
