"""`validate`: which candidates survive six gravities and a table."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.section import Section

Direction = Literal["+x", "-x", "+y", "-y", "+z", "-z"]


class ValidateParameters(Section):
    """Tests of a single grasp with a floating hand; also used for two objects by `merge`."""

    device: Literal["cpu", "cuda"] = Field(
        "cpu",
        description="Where the six gravities of single grasps run; cuda: all grasps in one scene, has not been tested.",
    )
    gravity_directions: list[Direction] = Field(
        ["-x", "-z", "+y", "+x", "+z", "-y"],
        min_length=1,
        description="Frame of the (first) object, tried in this order: those that reject most come first.",
    )
    gravity_seconds: float = Field(2.5, gt=0, le=20, description="Paper: 2.5.")
    squeeze_advance: float = Field(
        0.01, ge=0, le=0.05, description="Contact advance along the inward normal, m. Paper's code: 0.03."
    )
    contact_offset: float = Field(
        0.005,
        gt=0,
        le=0.1,
        description="m, in place of physics.contact_offset in these tests. Paper's code: 0.02.",
    )
    contact_impulse: float = Field(0.01, gt=0, description="N s per step that count as contact. Paper's code: 0.01.")
    drift_limit: float = Field(0.02, gt=0, description="Largest motion of the object in the hand, m. Paper: no limit.")
    rotation_limit: float = Field(
        0.6, gt=0, description="Largest rotation of the object in the hand, rad. Paper: no limit."
    )
    early_rejection: bool = Field(True, description="Stop a grasp at the first failed check.")
    table_test: bool = Field(True, description="Also pick the object off a support that is then taken away.")
    push_limit: float = Field(
        0.005, gt=0, description="Largest motion of the object before the fingers close, m. Paper: no limit."
    )
    approach_length: float = Field(0.05, gt=0, le=0.3, description="Straight line in, m. Paper's code: 0.05.")
    pinch_opening: float = Field(
        0.015, gt=0, le=0.1, description="Opening of the pinching fingers for the approach, m."
    )
    side_opening: float = Field(0.03, gt=0, le=0.1, description="Opening of the ring finger for the approach, m.")
    most_candidates: int = Field(
        10000, ge=1, description="Candidates tested per object and style, in order of grasp_id."
    )

    def for_floating_hand(self, physics: PhysicsParameters) -> PhysicsParameters:
        """Return ``physics`` with the contact offset of the tests with a floating hand."""
        return physics.model_copy(update={"contact_offset": self.contact_offset})
