"""`synthesize`: the energy, the annealed chains, and the contact sets of each style."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section

Finger = Literal["thumb", "index", "middle", "ring", "palm"]


class EnergyParameters(Section):
    """Weights of the terms E_fc, E_dis, E_pen + E_table, E_spen, E_joints, the offset, and the filter on them."""

    weight_force_closure: float = Field(1.0, ge=0, description="Paper: 1.")
    weight_distance: float = Field(100.0, ge=0, description="Per metre. Paper: 100.")
    weight_penetration: float = Field(100.0, ge=0, description="Per metre. Paper: 100.")
    weight_self_penetration: float = Field(30.0, ge=0, description="Per metre. Paper: 30.")
    weight_joints: float = Field(1.0, ge=0, description="Per radian. Paper: 1.")
    weight_offset: float = Field(
        300.0,
        ge=0,
        description="Per square metre, on the squared distance of the middle of the contacts, each with its share of "
        "the force, from the centre of mass: gravity turns an object that is held beside it. Paper: 0.",
    )
    object_points: int = Field(2000, ge=100, le=4096, description="Object surface points of E_pen. Paper: 2000.")
    hand_points: int = Field(1000, ge=100, le=4000, description="Hand surface points of E_table, E_spen. Paper: 1000.")
    scale_torque: bool = Field(True, description="Divide torques by half the middle extent. Paper: metres, unscaled.")
    balance_forces: bool = Field(
        True, description="Opposing contact groups carry equal total force. Paper: unit forces."
    )
    limit_force_closure: float = Field(0.3, gt=0, description="Filter: largest E_fc. Paper: 0.3.")
    limit_distance: float = Field(0.005, gt=0, description="Filter: largest E_dis, m. Paper: 0.005.")
    limit_penetration: float = Field(0.001, gt=0, description="Filter: largest E_pen + E_table, m. Paper: 0.001.")
    limit_self_penetration: float | None = Field(
        0.001, gt=0, description="Filter: largest E_spen, m; null does not filter. Paper: null."
    )
    limit_joints: float | None = Field(
        0.001, gt=0, description="Filter: largest E_joints, rad; null does not filter. Paper: null."
    )


class OptimizerParameters(Section):
    """Annealed Metropolis-adjusted Langevin chains with a per-grasp preconditioner."""

    device: Literal["cpu", "cuda"] = Field(
        "cpu", description="Warp device of the kernel. The same source runs on both; cuda has not been tested."
    )
    step: float = Field(0.01, gt=0, le=0.1, description="First step (m, rad). Paper's code: 0.005.")
    step_decay: float = Field(0.95, gt=0, le=1, description="Factor per step period. Paper's code: 0.95.")
    step_period: int = Field(50, ge=1, description="Iterations per decay at 6000 iterations; scaled with length.")
    temperature: float = Field(18.0, gt=0, description="First temperature. Paper's code: 18.")
    temperature_decay: float = Field(0.95, gt=0, le=1, description="Factor per temperature period. Paper's code: 0.95.")
    temperature_period: int = Field(
        30, ge=1, description="Iterations per decay at 6000 iterations; scaled with length."
    )
    switch_probability: float = Field(
        0.2, ge=0, le=1, description="Contact re-draw per contact and step. Paper's code: 0.5."
    )
    noise: float = Field(
        0.7, ge=0, le=5, description="Langevin noise on the pose in units of the step. Paper's code: none."
    )
    momentum: float = Field(
        0.95, ge=0, lt=1, description="Memory of the mean squared gradient. Paper's code: 0.02 (nearly none)."
    )
    batch: int = Field(
        32,
        ge=1,
        le=100000,
        description="Chains of one launch. Changes results only with a shared preconditioner. Paper's code: 256.",
    )
    shared_preconditioner: bool = Field(
        False, description="One mean squared gradient for a whole batch, not one per grasp. Paper's code: true."
    )
    duplicate_contacts: bool = Field(
        False, description="Two contacts of a grasp may be the same candidate. Paper's code: true."
    )
    keep_best: bool = Field(
        True, description="A chain ends with its state of lowest energy, not with its last. Paper's code: false."
    )
    polish_iterations: int = Field(
        200, ge=0, le=10000, description="RMSprop iterations on the best state, contacts fixed. Paper's code: none."
    )
    polish_step: float = Field(0.001, gt=0, le=0.1, description="First step of the polish (m, rad).")


class StyleParameters(Section):
    """What one style of grasp is."""

    finger_sets: list[list[str]] = Field(
        description="Contact sets of the hand's fingers, chains shared evenly; none: the hand does "
        "not grasp in this style. Paper: any combination of thumb, index, middle; ring + palm.",
    )
    contacts: dict[str, int] = Field(description="Number of contacts per finger set, keyed thumb+index and so on.")
    links: dict[str, list[str]] = Field(
        default_factory=dict,
        description="Links that may touch, keyed as contacts; all links of the fingers where not named.",
    )
    free_contacts: bool = Field(
        False,
        description="Contacts are drawn from all fingers of a set, so that one may stay idle; otherwise each has a "
        "contact of its own. Paper's code: true.",
    )
    chains: int = Field(256, ge=1, le=100000, description="Independent chains (candidates).")
    starts: int = Field(
        1,
        ge=1,
        le=64,
        description="Starts of each chain: hands of their own, annealed one by one; the one of lowest energy is "
        "polished and is the chain's only candidate. Paper: 1.",
    )
    iterations: int = Field(1500, ge=1, le=100000, description="Length of each start of a chain. Paper: 6000.")
    table_clearance: float = Field(
        0.0, ge=0, le=0.1, description="Height of the hand over the support plane, m. Paper's code: ground_offset."
    )
    mount_clearance: float | None = Field(
        None, description="Height of flange and mount over the support plane, m; null leaves them out. Paper: left out."
    )
    keep_out_margin: float | None = Field(
        None,
        ge=0,
        le=0.02,
        description="Distance of the object to where the other style's fingers and object may be, m; null: no such "
        "places. Paper: none.",
    )
    distance_from_palm: tuple[float, float] = Field(
        (0.05, 0.25), description="First distance palm to object, m. Paper's code: 0.05-0.25."
    )
    heading_spread: float = Field(
        0.0,
        ge=0,
        le=3.1416,
        description="First hands are turned about z by up to this to either side, rad. Paper's code: 0.",
    )
    released_seeds: bool = Field(
        False,
        description="First hands as the paper's code draws them: collisions are not looked at, the fingers that the "
        "style does not use have its postures, and all joints move.",
    )

    @model_validator(mode="after")
    def _finger_sets_can_hold(self) -> Self:
        keys = ["+".join(fingers) for fingers in self.finger_sets]
        for key, fingers in zip(keys, self.finger_sets, strict=True):
            if len(set(fingers)) < len(fingers):
                raise ValueError(f"the finger set {key} names a finger twice")
            if self.contacts.get(key, 0) < len(fingers):
                raise ValueError(f"contacts needs an entry {key!r} of at least {len(fingers)}, one per finger")
        # A set that is not in use keeps its entries, so that `finger_sets` alone says which are.
        for key in self.contacts:
            if key not in keys and sorted(key.split("+")) in [sorted(fingers) for fingers in self.finger_sets]:
                raise ValueError(f"contacts names {key!r}, which finger_sets has in another order: {', '.join(keys)}")
        if unknown := sorted(set(self.links) - set(self.contacts)):
            raise ValueError(f"links names {unknown[0]!r}, which is not in contacts; it has {', '.join(self.contacts)}")
        if not 0 < self.distance_from_palm[0] <= self.distance_from_palm[1]:
            raise ValueError("distance_from_palm is a positive range, the smaller distance first")
        return self


class SynthesizeParameters(Section):
    """All of the synthesis."""

    energy: EnergyParameters
    optimizer: OptimizerParameters
    pinch: StyleParameters
    side: StyleParameters
