"""What is to be held by one hand: objects in the order of picking, the parts of the hand for each, and the limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.hand.model import Hand
from pipeline.hand.support import Support, support_of
from pipeline.pairing.grasps import Groups, fingers_of
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.picks import PickParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.robustness.measures import Measuring


@dataclass(frozen=True)
class Task:
    """Objects in the order of picking and the settings of the checks; the same for all combinations of their grasps."""

    hand: Hand
    objects: tuple[PreparedObject, ...]
    groups: Groups  # parts of the hand for each
    supports: tuple[Support, ...]  # what each stands on
    merge: MergeParameters
    physics: PhysicsParameters
    validate: ValidateParameters  # directions, limits and opening of the single grasps' tests
    measuring: Measuring | None = None  # of grasps that pass; None: nothing

    def waiting(self, number: int) -> tuple[str, ...]:
        """Return the fingers that belong to the objects picked after one."""
        return fingers_of(self.groups[number + 1 :])

    @property
    def settling_physics(self) -> PhysicsParameters | None:
        """The physics in which objects settle in the floating hand; None when nothing is tested in physics."""
        return self.validate.for_floating_hand(self.physics) if self.merge.physics_test else None


def task_of(
    hand: Hand,
    picks: Sequence[PickParameters],
    objects: Sequence[PreparedObject],
    merge: MergeParameters,
    physics: PhysicsParameters,
    validate: ValidateParameters,
    measuring: Measuring | None = None,
) -> Task:
    """Return the task of picking ``objects`` as ``picks`` say."""
    supports = tuple(support_of(pick) for pick in picks)
    return Task(hand, tuple(objects), groups_of(hand, picks), supports, merge, physics, validate, measuring)


def groups_of(hand: Hand, picks: Sequence[PickParameters]) -> Groups:
    """Return the parts of the hand that belong to each object: those that its pick names, or those of its style."""
    return tuple(tuple(pick.fingers or hand.style(pick.style).fingers) for pick in picks)
