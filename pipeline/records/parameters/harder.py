"""`harder`: the same trials once more, in settings that are harder, or otherwise different, from `evaluate`."""

from __future__ import annotations

from typing import Any, Literal, TypeVar

from pydantic import Field, ValidationError, model_validator

from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.section import Section

Overridden = TypeVar("Overridden", EvaluateParameters, PhysicsParameters)


class HarderSetting(Section):
    """What differs from the standard trials; everything else is theirs, grasps and seeds too."""

    source: Literal["synthesized", "learned"] = Field(
        description="Where the grasps come from: synthesis, or the model."
    )
    evaluate: dict[str, Any] = Field(description="Values that take the place of those in `evaluate`, by name.")
    physics: dict[str, Any] = Field(description="Values that take the place of those in `physics`, by name.")


class HarderParameters(Section):
    """Which pairs are tried, how often, and in which settings."""

    pairs: list[tuple[str, ...]] = Field(description="Objects in the order of picking.")
    trials: int = Field(
        25, ge=1, le=1000, description="Trials per pair, the first ones of the standard trials: at most as many."
    )
    settings: dict[str, HarderSetting] = Field(description="By name.")

    @model_validator(mode="after")
    def _pairs_differ(self) -> HarderParameters:
        if len(set(self.pairs)) != len(self.pairs):
            raise ValueError("pairs names a pair twice")
        if self.settings and not self.pairs:
            raise ValueError("pairs is empty, so no setting would be tried; name pairs, or remove all settings")
        return self


def overridden(standard: Overridden, values: dict[str, Any]) -> Overridden:
    """Return ``standard`` with ``values`` in the place of its own, checked like any others.

    Raises:
        ValueError: a name is unknown or a value out of range; the text says which.
    """
    try:
        return type(standard).model_validate({**standard.model_dump(by_alias=True), **values})
    except ValidationError as error:
        first = error.errors()[0]
        text = "unknown parameter (misspelt?)" if first["type"] == "extra_forbidden" else first["msg"]
        where = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{where + ': ' if where else ''}{text.removeprefix('Value error, ')}") from error
