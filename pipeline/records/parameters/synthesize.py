"""`synthesize`: the energy, the annealed chains, and the finger sets of each style."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section


class EnergyParameters(Section):
    """Weights of the energy's terms (E_fc, E_dis, E_pen + E_table, E_spen, E_joints), and limits on them."""

    weight_force_closure: float = Field(1.0, ge=0, description="Weight of the force-closure term E_fc. Paper: 1.")
    weight_distance: float = Field(
        100.0, ge=0, description="[1/m] Weight of E_dis, the distance of the contacts from the surface. Paper: 100."
    )
    weight_penetration: float = Field(
        100.0, ge=0, description="[1/m] Weight of the penetration terms E_pen + E_table. Paper: 100."
    )
    weight_self_penetration: float = Field(
        30.0, ge=0, description="[1/m] Weight of the self-penetration term E_spen. Paper: 30."
    )
    weight_joints: float = Field(1.0, ge=0, description="[1/rad] Weight of the joint-limit term E_joints. Paper: 1.")
    object_points: int = Field(
        2000, ge=100, le=4096, description="Points on the object's surface used for E_pen. Paper: 2000."
    )
    hand_points: int = Field(
        1000, ge=100, le=4000, description="Points on the hand's surface used for E_table and E_spen. Paper: 1000."
    )
    scale_torque: bool = Field(
        True,
        description="Divide torques by half the object's middle extent, to make them comparable with forces. Paper: "
        "false.",
    )
    balance_forces: bool = Field(
        True,
        description="Let opposing groups of contacts carry equal total force, rather than all contacts unit force. "
        "Paper: false.",
    )
    limit_force_closure: float = Field(
        0.3, gt=0, description="Largest E_fc of a candidate that is not rejected. Paper: 0.3."
    )
    limit_distance: float = Field(
        0.005, gt=0, description="[m] Largest E_dis of a candidate that is not rejected. Paper: 0.005."
    )
    limit_penetration: float = Field(
        0.001, gt=0, description="[m] Largest E_pen + E_table of a candidate that is not rejected. Paper: 0.001."
    )
    limit_self_penetration: float | None = Field(
        0.001,
        gt=0,
        description="[m] Largest E_spen of a candidate that is not rejected; null disables this check. Paper: null.",
    )
    limit_joints: float | None = Field(
        0.001,
        gt=0,
        description="[rad] Largest E_joints of a candidate that is not rejected; null disables this check. Paper: "
        "null.",
    )


class OptimizerParameters(Section):
    """Annealed chains of the Metropolis-adjusted Langevin algorithm, with a preconditioner for each grasp."""

    device: Literal["cpu", "cuda"] = Field(
        "cpu", description="Device that runs the chains. The same kernel source serves both; `cuda` is untested."
    )
    step: float = Field(0.01, gt=0, le=0.1, description="[m, rad] Initial step size. Paper's code: 0.005.")
    step_decay: float = Field(
        0.95,
        gt=0,
        le=1,
        description="Factor by which the step size shrinks after each step period. Paper's code: 0.95.",
    )
    step_period: int = Field(
        50,
        ge=1,
        description="Length of a step period in a chain of 6000 iterations; shorter chains have shorter periods in "
        "proportion. Paper's code: 50.",
    )
    temperature: float = Field(
        18.0, gt=0, description="Initial temperature, on the scale of the weighted energy. Paper's code: 18."
    )
    temperature_decay: float = Field(
        0.95,
        gt=0,
        le=1,
        description="Factor by which the temperature falls after each temperature period. Paper's code: 0.95.",
    )
    temperature_period: int = Field(
        30,
        ge=1,
        description="Length of a temperature period in a chain of 6000 iterations; shorter chains have shorter periods "
        "in proportion. Paper's code: 30.",
    )
    switch_probability: float = Field(
        0.2, ge=0, le=1, description="Probability of redrawing a contact at each step, per contact. Paper's code: 0.5."
    )
    noise: float = Field(
        0.7, ge=0, le=5, description="Langevin noise on the pose, in units of the step size. Paper's code: 0."
    )
    momentum: float = Field(
        0.95,
        ge=0,
        lt=1,
        description="Decay rate of the running mean of squared gradients. Paper's code: 0.02, which is nearly no "
        "memory.",
    )
    batch: int = Field(
        32,
        ge=1,
        le=100000,
        description="Chains per kernel launch. It affects results only if an option couples the chains of a batch, as "
        "shared_preconditioner does. Paper's code: 256.",
    )
    shared_preconditioner: bool = Field(
        False,
        description="Precondition all grasps of a batch with one mean of squared gradients, instead of one each. "
        "Paper's code: true.",
    )
    duplicate_contacts: bool = Field(
        False, description="Allow two contacts of a grasp to be the same contact candidate. Paper's code: true."
    )
    keep_best: bool = Field(
        True, description="End a chain with its state of lowest energy rather than its last one. Paper's code: false."
    )
    polish_iterations: int = Field(
        200,
        ge=0,
        le=10000,
        description="RMSprop iterations that polish the final state, with its contacts fixed; 0 disables polishing. "
        "Paper's code: 0.",
    )
    polish_step: float = Field(0.001, gt=0, le=0.1, description="[m, rad] Initial step size of the polishing.")


class StyleParameters(Section):
    """How grasps of one style are synthesized."""

    finger_sets: list[list[str]] = Field(
        [],
        description="Sets of fingers that hold an object together, each with an equal share of the chains. Empty: the "
        "hand does not grasp in this style. Paper: any combination of thumb, index and middle; ring and palm.",
    )
    contacts: dict[str, int] = Field(
        {}, description="Number of contacts of each finger set, whose key joins the fingers: thumb+index."
    )
    links: dict[str, list[str]] = Field(
        {},
        description="Links that may touch the object, by finger set as in `contacts`; all links of the fingers "
        "if a set "
        "is not listed.",
    )
    free_contacts: bool = Field(
        False,
        description="Draw every contact from all fingers of the set, so that a finger may stay idle, rather than give "
        "each finger a contact of its own. Paper's code: true.",
    )
    chains: int = Field(ge=1, le=100000, description="Number of independent chains; each yields one candidate.")
    starts: int = Field(
        ge=1,
        le=64,
        description="Number of initial hand poses per chain. Each is annealed, and the result of lowest energy is "
        "polished and becomes the candidate. Paper: 1.",
    )
    iterations: int = Field(ge=1, le=100000, description="Iterations from each initial hand pose. Paper: 6000.")
    weight_offset: float = Field(
        ge=0,
        description="[1/m2] Weight in the energy of the squared distance from the object's centre of mass to the mean "
        "of the contacts, weighted by their share of the force: gravity rotates an object that is gripped off-centre. "
        "Paper: 0.",
    )
    table_clearance: float = Field(
        ge=0,
        le=0.1,
        description="[m] Minimum height of the hand above the support plane. Paper's code: its ground_offset.",
    )
    mount_clearance: float | None = Field(
        description="[m] Minimum height of the arm's flange and the hand's mount above the support plane; null ignores "
        "both. Paper: null."
    )
    keep_out_margin: float | None = Field(
        ge=0,
        le=0.02,
        description="[m] Distance kept between the object and the space that the other style's fingers and object may "
        "occupy; null ignores that space. Paper: null.",
    )
    distance_from_palm: tuple[float, float] = Field(
        (0.05, 0.25),
        description="[m] Range of the distance from palm to object in initial hand poses. Paper's code: 0.05-0.25.",
    )
    heading_spread: float = Field(
        0.0,
        ge=0,
        le=3.1416,
        description="[rad] Maximum rotation of initial hand poses about the vertical, to either side. Paper's code: 0.",
    )
    released_seeds: bool = Field(
        False,
        description="Draw initial hand poses as the paper's code does: regardless of collisions, with the paper's "
        "posture for the fingers that the style does not use, and with all joints free to move.",
    )

    @model_validator(mode="after")
    def _finger_sets_can_hold(self) -> Self:
        keys = ["+".join(fingers) for fingers in self.finger_sets]
        for key, fingers in zip(keys, self.finger_sets, strict=True):
            if len(set(fingers)) < len(fingers):
                raise ValueError(f"finger_sets: {key} lists a finger twice; remove one")
            if self.contacts.get(key, 0) < len(fingers):
                raise ValueError(f"contacts: add an entry {key!r} of at least {len(fingers)}, one contact per finger")
        # Sets that are not in use may keep their entries, so that `finger_sets` alone selects which are.
        for key in self.contacts:
            if key not in keys and sorted(key.split("+")) in [sorted(fingers) for fingers in self.finger_sets]:
                raise ValueError(f"contacts: {key!r} is in finger_sets in another order; use one of {', '.join(keys)}")
        if unknown := sorted(set(self.links) - set(self.contacts)):
            raise ValueError(f"links: {unknown[0]!r} is not in contacts; use one of {', '.join(self.contacts)}")
        if not 0 < self.distance_from_palm[0] <= self.distance_from_palm[1]:
            raise ValueError("distance_from_palm must be two positive distances, the smaller one first")
        return self


class SynthesizeParameters(Section):
    """The synthesis of grasp candidates."""

    energy: EnergyParameters
    optimizer: OptimizerParameters
    pinch: StyleParameters
    side: StyleParameters
