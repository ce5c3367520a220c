"""A description of a sequence with any number of objects: which fingers hold which object. Files of `conf/several`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Literal, Self

import yaml
from pydantic import Field, ValidationError, model_validator

from pipeline.records.errors import UserError
from pipeline.records.parameters.objects import ObjectParameters
from pipeline.records.parameters.section import Section
from pipeline.records.parameters.synthesize import Finger
from pipeline.records.texts import parse_yaml

MOST_OBJECTS = 4


class PostParameters(Section):
    """A fixed square post on the sponge."""

    width: float = Field(gt=0, le=0.2, description="m.")
    height: float = Field(gt=0, le=0.2, description="m.")


class PickParameters(Section):
    """One object, and the part of the hand that holds it."""

    name: str = Field(description="Name of the object.")
    shape: ObjectParameters = Field(description="As under `objects` of params.yaml.")
    style: Literal["pinch", "side"] = Field(description="Whose settings under `synthesize` and `validate` count.")
    fingers: list[Finger] = Field(min_length=2, description="Parts of the hand that hold it.")
    place: tuple[float, float] = Field(description="Where it stands in the robot's frame, x and y, m.")
    post: PostParameters | None = Field(None, description="What it stands on; null: the sponge.")
    chains: int = Field(96, ge=1, description="Candidates to synthesize.")


class SeveralParameters(Section):
    """A sequence of picks with one hand."""

    seed: int = Field(ge=0, description="Every item derives its own generator from it.")
    picks: list[PickParameters] = Field(min_length=2, max_length=MOST_OBJECTS, description="In the order of picking.")
    grasps: int = Field(25, ge=1, description="Accepted grasps of all objects wanted.")
    most_combinations: int = Field(400, ge=1, description="Combinations of single grasps tried.")
    most_per_grasp: int = Field(4, ge=1, description="Accepted combinations that may share one single grasp.")
    approach_lengths: list[float] = Field(
        [0.12, 0.07, 0.05], min_length=1, description="Straight approach to objects after the first, m."
    )
    approach_clearance: float = Field(
        0.003,
        description="Least distance to an object after the first on the straight way to it, m; of all but what touches "
        "it at the end. Fingers that hold other objects cannot open for it, and are not exactly where they should be.",
    )
    lift_height: float = Field(
        0.22,
        gt=0,
        le=0.4,
        description="Last lift, m, in place of evaluate.lift_height: an object from a post is lower when that begins.",
    )
    trials: int = Field(25, ge=1, description="Robot trials.")

    @model_validator(mode="after")
    def _hand_is_shared(self) -> Self:
        fingers = Counter(finger for pick in self.picks for finger in pick.fingers if finger != "palm")
        twice = [finger for finger, count in fingers.items() if count > 1]
        if twice:
            raise ValueError(f"the {twice[0]} finger is named twice; only the palm may press on several objects")
        if any("thumb" in pick.fingers for pick in self.picks[1:]):
            raise ValueError("the thumb cannot wait for a later pick; name it in the first one")
        for pick in self.picks:
            if pick.style == "side" and "palm" not in pick.fingers:
                raise ValueError(f"{pick.name}: a side grasp is held against the palm; add it to fingers")
        if len({pick.name for pick in self.picks}) < len(self.picks):
            raise ValueError("two objects have the same name; rename one")
        return self


def read_sequence(source: Path) -> SeveralParameters:
    """Read the description of a sequence.

    Raises:
        UserError: the file is missing, is not YAML, or has a wrong, unknown or missing value.
    """
    try:
        return SeveralParameters.model_validate(parse_yaml(source.read_text()))
    except FileNotFoundError as error:
        raise UserError(f"{source} is missing; name a file like conf/several/three.yaml.") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError(f"{source} is not valid YAML: {' '.join(str(error).split())}; correct it there.") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        text = first["msg"].removeprefix("Value error, ")
        raise UserError(f"{source}: {where + ': ' if where else ''}{text}; correct it there.") from error
