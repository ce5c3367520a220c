"""`validate`: which candidates hold their object under gravity from six directions and pick it off a table."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from pipeline.records.parameters.physics import PhysicsParameters, friction_of_all_contacts
from pipeline.records.parameters.section import Section

Direction = Literal["+x", "-x", "+y", "-y", "+z", "-z"]


class ValidateParameters(Section):
    """Tests of a single grasp with a floating hand; `merge` applies them to two objects."""

    device: Literal["cpu", "cuda"] = Field(
        "cpu",
        description="Device for the gravity tests of single grasps. `cuda` simulates all grasps in one scene and is "
        "untested.",
    )
    gravity_directions: list[Direction] = Field(
        ["-x", "-z", "+y", "+x", "+z", "-y"],
        min_length=1,
        description="Directions of gravity to test, as axes of the (first) object's frame, in this order. Those that "
        "reject most grasps come first.",
    )
    gravity_seconds: float = Field(
        2.5, gt=0, le=20, description="[s] Simulated time for each direction of gravity. Paper: 2.5."
    )
    pinch_squeeze: float = Field(
        0.005,
        ge=0,
        le=0.05,
        description="[m] Distance by which the contacts of a pinch grasp are commanded into the object along the "
        "inward normals when the hand squeezes. Paper's code: 0.03.",
    )
    side_squeeze: float = Field(
        0.01,
        ge=0,
        le=0.05,
        description="[m] Distance by which the contacts of a side grasp are commanded into the object along the inward "
        "normals when the hand squeezes. Paper's code: 0.03.",
    )
    sapien_contact_offset: float = Field(
        0.005,
        gt=0,
        le=0.1,
        description="[m] Distance at which PhysX starts to generate contacts in tests with a floating hand; replaces "
        "physics.sapien.contact_offset there. Paper's code: 0.02.",
    )
    friction: float | None = Field(
        0.5,
        ge=0,
        le=5,
        description="Friction coefficient of every two touching bodies in all tests with a floating hand; null: the "
        "materials of physics. Paper: null.",
    )
    contact_impulse: float = Field(
        0.01,
        gt=0,
        description="[N s] Minimum impulse in a physics step for a link to count as touching an object. Paper's code: "
        "0.01.",
    )
    drift_limit: float = Field(
        0.02, gt=0, description="[m] Maximum motion of an object relative to the hand that holds it. Paper: no limit."
    )
    rotation_limit: float = Field(
        0.6,
        gt=0,
        description="[rad] Maximum rotation of an object relative to the hand that holds it. Paper: no limit.",
    )
    early_rejection: bool = Field(True, description="Stop testing a grasp after the first check that it fails.")
    table_test: bool = Field(
        True, description="Also test whether the hand picks the object off a support that is then removed."
    )
    pinch_opening: float = Field(
        0.015,
        gt=0,
        le=0.1,
        description="[m] How far the contact points of a pinch grasp move outwards for the approach.",
    )
    side_opening: float = Field(
        0.03,
        gt=0,
        le=0.1,
        description="[m] How far the contact points of a side grasp's finger move outwards for the approach.",
    )
    push_limit: float = Field(
        0.005,
        gt=0,
        description="[m] Maximum motion of the object during the approach, before the fingers close. Paper: no limit.",
    )
    approach_length: float = Field(
        0.05, gt=0, le=0.3, description="[m] Length of the straight approach to the object. Paper's code: 0.05."
    )
    most_candidates: int = Field(
        10000, ge=1, description="Maximum number of candidates tested per object and style, in order of grasp_id."
    )

    def squeeze(self, style: str) -> float:
        """Return the distance, m, by which the contacts of a style squeeze."""
        return self.pinch_squeeze if style == "pinch" else self.side_squeeze

    def opening(self, style: str) -> float:
        """Return the distance, m, by which the contacts of a style open for the approach."""
        return self.pinch_opening if style == "pinch" else self.side_opening

    def for_floating_hand(self, physics: PhysicsParameters) -> PhysicsParameters:
        """Return ``physics`` with PhysX's contact offset and the friction of the tests with a floating hand."""
        sapien = physics.sapien.model_copy(update={"contact_offset": self.sapien_contact_offset})
        changes: dict[str, Any] = {"sapien": sapien}
        if self.friction is not None:
            changes |= friction_of_all_contacts(self.friction)
        return physics.model_copy(update=changes)

    def at_friction(self, friction: float) -> ValidateParameters:
        """Return these parameters with another friction of every two touching bodies."""
        return self.model_copy(update={"friction": friction})
