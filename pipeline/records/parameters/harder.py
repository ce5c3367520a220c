"""`harder`: the standard trials repeated in settings that are harder than, or otherwise differ from, `evaluate`."""

from __future__ import annotations

from typing import Any, TypeVar

from pydantic import Field, ValidationError, field_validator, model_validator

from pipeline.records.errors import first_mistake
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.section import Section
from pipeline.records.sources import OF_ALL_PAIRS

Overridden = TypeVar("Overridden", EvaluateParameters, PhysicsParameters)


class HarderSetting(Section):
    """What differs from the standard trials; everything else, grasps and seeds included, stays the same."""

    source: str = Field(description="Source of the grasps: synthesis, or the learned model.")
    evaluate: dict[str, Any] = Field(description="Values that replace those of `evaluate`, by parameter name.")
    physics: dict[str, Any] = Field(description="Values that replace those of `physics`, by parameter name.")

    @field_validator("source")
    @classmethod
    def _is_known(cls, source: str) -> str:
        if source not in OF_ALL_PAIRS:
            raise ValueError(f"there is no source {source!r} of all pairs; use one of {', '.join(OF_ALL_PAIRS)}")
        return source


class HarderParameters(Section):
    """Which pairs are tried, how often, and in which settings."""

    pairs: list[tuple[str, ...]] = Field([], description="Pairs to try in every setting, as [first, second].")
    trials: int = Field(
        25,
        ge=1,
        le=1000,
        description="Trials per pair and setting: the first of the standard trials, so at most evaluate.trials.",
    )
    settings: dict[str, HarderSetting] = Field({}, description="Settings to repeat the trials in, by name.")

    @model_validator(mode="after")
    def _pairs_differ(self) -> HarderParameters:
        if len(set(self.pairs)) != len(self.pairs):
            raise ValueError("pairs lists a pair twice; remove one")
        if self.settings and not self.pairs:
            raise ValueError("pairs is empty, so no setting would be tried; add pairs, or remove all settings")
        return self


def overridden(standard: Overridden, values: dict[str, Any]) -> Overridden:
    """Return ``standard`` with some values replaced, and checked like any others.

    Raises:
        ValueError: a name is unknown or a value out of range; the message says which.
    """
    try:
        return type(standard).model_validate({**standard.model_dump(by_alias=True), **values})
    except ValidationError as error:
        raise ValueError(first_mistake(error)) from error
