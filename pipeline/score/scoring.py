"""Foreign grasps through the checks and measures of ours, in one physics engine after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.compute.fan_out import fan_out
from pipeline.compute.shared import Shared
from pipeline.hand.model import Hand
from pipeline.hand.moves import finger_joints
from pipeline.pairing.combination import CHECKS as PAIR_CHECKS
from pipeline.pairing.combination import combine, measured
from pipeline.pairing.grasps import SingleGrasp
from pipeline.pairing.readiness import ready
from pipeline.pairing.task import Task, task_of
from pipeline.records.merge_reasons import MergeReason
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters import Parameters
from pipeline.records.poses import inverse_pose
from pipeline.robustness.measures import Measuring, measuring
from pipeline.sample.execution import single_grasps
from pipeline.score.assignment import Assigned
from pipeline.validate.checks import ADDED, Candidate, Inspection
from pipeline.validate.checks import CHECKS as SINGLE_CHECKS
from pipeline.validate.checks import measures as single_measures

Engine = Literal["sapien", "mujoco"]


@dataclass(frozen=True)
class ReadyGrasp:
    """A foreign grasp in our frames and joint order, with how it is meant to hold."""

    objects: tuple[PreparedObject, ...]
    T_object_hand: tuple[NDArray[np.float64], ...]  # (4, 4) each
    q: NDArray[np.float64]  # (J,) rad
    squeeze_q: NDArray[np.float64] | None  # (J,) rad, drive targets of the file
    assigned: tuple[Assigned, ...]


@dataclass(frozen=True)
class Verdict:
    """What one engine says of a grasp."""

    failed: tuple[str, ...]  # every failed check, in the order of the checks
    columns: dict[str, Any]  # of ``records.tables``: CHECKED or MERGED, MARGINS, ROBUSTNESS

    @property
    def rejected_by(self) -> str:
        """The first failed check, '' for a grasp that passed all: what the tables of this project say."""
        return self.failed[0] if self.failed else ""


def score(
    grasps: Sequence[ReadyGrasp], hand: Hand, parameters: Parameters, engines: Sequence[Engine], table_test: bool
) -> list[dict[Engine, Verdict]]:
    """Return the verdict of every engine on every grasp.

    All checks are made, also after one that failed, so that every reason is known.

    Args:
        parameters: of which `seed`, `picks`, `physics`, `merge`, `validate`, `robustness` and `compute` are used.
        table_test: whether objects are also picked off a support.
    """
    items = [(grasp, engine) for grasp in grasps for engine in engines]
    with Shared((hand, parameters, table_test)) as shared:
        found = fan_out(partial(_verdict, shared), items, parameters.compute, "score")
    verdicts: list[dict[Engine, Verdict]] = [{} for _ in grasps]
    for index, ((_, engine), verdict) in enumerate(zip(items, found, strict=True)):
        verdicts[index // len(engines)][engine] = verdict
    return verdicts


def _verdict(shared: Shared[tuple[Hand, Parameters, bool]], item: tuple[ReadyGrasp, Engine]) -> Verdict:
    hand, parameters, table_test = shared.value
    grasp, engine = item
    names = [prepared.name for prepared in grasp.objects]
    settings = parameters.robustness.model_copy(update={"single_grasps": True})
    own = measuring(settings, parameters.seed, *names)
    if len(grasp.objects) == 1:
        return _single(grasp, hand, parameters, engine, own, table_test)
    return _pair(grasp, hand, parameters, engine, own)


def _single(
    grasp: ReadyGrasp, hand: Hand, parameters: Parameters, engine: Engine, own: Measuring, table_test: bool
) -> Verdict:
    assigned = grasp.assigned[0]
    candidate = Candidate(
        style=assigned.style,
        fingers=assigned.fingers,
        T_object_hand=grasp.T_object_hand[0],
        q=grasp.q,
        contact_candidates=assigned.contacts.candidates[0],
        contact_normals=assigned.contacts.normals[0],
        hand=hand,
        squeeze_q=grasp.squeeze_q,
    )
    changes = {"early_rejection": False, "table_test": table_test}
    limits = parameters.validate_.model_copy(update=changes)
    inspection = Inspection(grasp.objects[0], candidate, parameters.physics.in_engine(engine), limits)
    columns: dict[str, Any] = {**dict.fromkeys(ADDED), "squeeze_q": inspection.grasp.squeeze_q}
    failed: list[str] = []
    for check in SINGLE_CHECKS:
        found, reason = check(inspection)
        columns |= found
        if reason:
            failed.append(str(reason))
    if not failed:
        columns |= single_measures(inspection, own)
    return Verdict(tuple(failed), columns)


def _pair(grasp: ReadyGrasp, hand: Hand, parameters: Parameters, engine: Engine, own: Measuring) -> Verdict:
    task = task_of(
        hand,
        parameters.picks,
        grasp.objects,
        parameters.merge,
        parameters.physics.in_engine(engine),
        parameters.validate_,
        own,
    )
    halves = _halves(grasp, task)
    tried = combine(task, [ready(task, number, half) for number, half in enumerate(halves)])
    columns: dict[str, Any] = {"squeeze_q": tried.grasp.squeeze_q}
    failed: list[str] = []
    for check in PAIR_CHECKS:
        found, reason = check(tried)
        columns |= found
        if reason is not None:
            failed.append(reason.value)
        if reason is MergeReason.FINGERS:  # what follows takes for granted that fingers are shared out
            break
    if not failed:
        columns |= measured(tried)
    return Verdict(tuple(failed), columns)


def _halves(grasp: ReadyGrasp, task: Task) -> list[SingleGrasp]:
    """Return the grasp of each object alone, as if both came from validation."""
    first, second = (assigned.contacts for assigned in grasp.assigned)
    T = np.stack([inverse_pose(pose) for pose in grasp.T_object_hand])
    objects = (grasp.objects[0], grasp.objects[1])
    halves = list(single_grasps(task.hand, objects, T, grasp.q, (first, second), 0, task.validate))
    if grasp.squeeze_q is None:
        return halves
    pressed = []
    for half in halves:
        squeeze_q = half.q.copy()
        joints = finger_joints(half.fingers, task.hand)
        squeeze_q[joints] = grasp.squeeze_q[joints]
        pressed.append(SingleGrasp(**{**vars(half), "squeeze_q": squeeze_q}))
    return pressed
