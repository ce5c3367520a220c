"""`conditions`: the trials repeated under other conditions than those of `evaluate` and `physics`."""

from __future__ import annotations

from typing import Any, Literal, TypeVar

from pydantic import Field, ValidationError, model_validator

from pipeline.records.errors import first_mistake
from pipeline.records.parameters.distribution import DisturbedGrasp
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters, friction_of_all_contacts
from pipeline.records.parameters.section import Section
from pipeline.records.series import TrialSeries
from pipeline.records.sources import SOURCES

Overridden = TypeVar("Overridden", EvaluateParameters, PhysicsParameters)
Engine = Literal["sapien", "mujoco"]


class DistributionParameters(DisturbedGrasp):
    """What a trial draws from its seed where a condition says so; every object has its own draw."""

    joint_error: float = Field(
        0.005,
        ge=0,
        le=0.1,
        description="[rad] Maximum error of each measured joint angle, constant during a trial; drives and planning "
        "know the measured angles only.",
    )
    latency: int = Field(3, ge=0, le=50, description="Maximum number of control periods by which targets arrive late.")


class Condition(Section):
    """What differs from the standard trials; everything else, grasps and seeds included, stays the same."""

    friction: float | None = Field(
        None, ge=0, le=5, description="Friction coefficient of every two touching bodies; null keeps their materials."
    )
    engines: list[Engine] | None = Field(
        None, description="Engines in which it is tried, of those of `conditions.engines`; null is all."
    )
    drawn: bool = Field(False, description="Whether every trial draws from `conditions.distribution`.")
    evaluate: dict[str, Any] = Field({}, description="Values that replace those of `evaluate`, by parameter name.")
    physics: dict[str, Any] = Field({}, description="Values that replace those of `physics`, by parameter name.")

    @model_validator(mode="after")
    def _says_nothing_twice(self) -> Condition:
        if self.friction is not None and self.drawn:
            raise ValueError("friction is drawn; remove friction, or set drawn to false")
        if "engine" in self.physics:
            raise ValueError("remove physics.engine; conditions.engines names the engines")
        for name in friction_of_all_contacts(0.0) if self.friction is not None else ():
            if name in self.physics:
                raise ValueError(f"friction holds for every contact; remove it, or physics.{name}")
        return self

    @property
    def changes(self) -> dict[str, Any]:
        """Values that replace those of `physics`, by parameter name."""
        return {**({} if self.friction is None else friction_of_all_contacts(self.friction)), **self.physics}


class ConditionsParameters(Section):
    """Which pairs are tried, how often, and under which conditions."""

    pairs: list[tuple[str, ...]] = Field(
        [],
        description="Pairs to try under every condition, as [first, second]. Of reconstructed objects, all pairs are "
        "tried.",
    )
    trials: int = Field(
        25,
        ge=1,
        le=1000,
        description="Trials per pair and condition: the first of the standard trials, so at most evaluate.trials.",
    )
    sources: list[str] = Field(
        list(SOURCES), description="Sources of grasps to try under every condition; [] tries none."
    )
    engines: list[Engine] = Field(["sapien"], description="Physics engines in which every condition is tried.")
    settings: dict[str, Condition] = Field(
        {},
        description="Conditions to repeat the trials under, by name. With the values and the engine of the standard "
        "trials, these are not run again.",
    )
    distribution: DistributionParameters

    @model_validator(mode="after")
    def _names_differ(self) -> ConditionsParameters:
        for name in ("pairs", "sources", "engines"):
            values = getattr(self, name)
            if len(set(values)) != len(values):
                raise ValueError(f"{name} lists a {name.removesuffix('s')} twice; remove one")
        for source in self.sources:
            if source not in SOURCES:
                raise ValueError(f"there is no source {source!r}; use one of {', '.join(SOURCES)}")
        if self.settings and self.sources and not self.pairs:
            raise ValueError("pairs is empty, so no condition would be tried; add pairs, or empty sources or settings")
        return self

    def series(self, reconstructed: bool) -> list[TrialSeries]:
        """Return all series of trials: source by source, condition by condition, engine by engine.

        Args:
            reconstructed: whether the run has pairs of reconstructed objects.
        """
        sources = [name for name in self.sources if SOURCES[name].of_all_pairs or reconstructed]
        return [
            TrialSeries(source, name, engine)
            for source in sources
            for name in self.settings
            for engine in self.engines_of(name)
        ]

    def engines_of(self, condition: str) -> list[Engine]:
        """Return the engines in which a condition is tried."""
        own = self.settings[condition].engines
        return [engine for engine in self.engines if own is None or engine in own]

    def is_standard(self, series: TrialSeries, evaluate: EvaluateParameters, physics: PhysicsParameters) -> bool:
        """Whether the trials of a series are the standard trials, which ``evaluate`` and ``physics`` describe."""
        condition = self.settings[series.condition]
        return not condition.drawn and under(condition, series.engine, evaluate, physics) == (evaluate, physics)

    def to_run(
        self, reconstructed: bool, evaluate: EvaluateParameters, physics: PhysicsParameters
    ) -> dict[str, TrialSeries]:
        """Return the series that are not the standard trials, by name; arguments as of the methods above."""
        return {
            str(series): series
            for series in self.series(reconstructed)
            if not self.is_standard(series, evaluate, physics)
        }


def overridden(standard: Overridden, values: dict[str, Any]) -> Overridden:
    """Return ``standard`` with some values replaced, and checked like any others.

    Raises:
        ValueError: a name is unknown or a value out of range; the message says which.
    """
    try:
        return type(standard).model_validate({**standard.model_dump(by_alias=True), **values})
    except ValidationError as error:
        raise ValueError(first_mistake(error)) from error


def under(
    condition: Condition, engine: str, evaluate: EvaluateParameters, physics: PhysicsParameters
) -> tuple[EvaluateParameters, PhysicsParameters]:
    """Return `evaluate` and `physics` under a condition in an engine.

    What is drawn is not in them; where friction is, all materials have the same, which any engine can take.

    Raises:
        ValueError: see :func:`overridden`.
    """
    drawn = friction_of_all_contacts(physics.object_friction) if condition.drawn else {}
    return (
        overridden(evaluate, condition.evaluate),
        overridden(physics, {**drawn, **condition.changes, "engine": engine}),
    )
