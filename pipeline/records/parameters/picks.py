"""`picks`: what a sequence is, object by object: which part of the hand holds it, and where it stands before."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from pydantic import Field

from pipeline.records.ordinals import ORDINALS
from pipeline.records.parameters.section import Section
from pipeline.records.parameters.synthesize import StyleParameters


class PostParameters(Section):
    """A fixed square post on the sponge, for an object to stand on."""

    width: float = Field(gt=0, le=0.2, description="Width of the post, m.")
    height: float = Field(gt=0, le=0.2, description="Height of the post over the sponge, m.")
    margin: float = Field(
        0.005,
        ge=0,
        le=0.05,
        description="How far from the middle of the post the object may stand, m; at least evaluate.perturbation.",
    )


class PickParameters(Section):
    """The pick of one object."""

    style: Literal["pinch", "side"] = Field(
        description="Style of the grasp, whose objects (`styles`) and settings (`synthesize`) are used."
    )
    objects: list[str] | None = Field(
        None, description="Objects that are picked so; null: all of the style. Needed where two picks have one style."
    )
    fingers: list[str] | None = Field(
        None,
        min_length=2,
        description="Parts of the hand that hold the object, all of them; those of later picks are straight meanwhile. "
        "null: the finger sets of the style.",
    )
    chains: int | None = Field(
        None, ge=1, le=100000, description="Candidates to synthesize for each object; null: those of the style."
    )
    place: tuple[float, float] | None = Field(
        None,
        description="Where the object stands in the robot's frame, x and y, m; null: on the robot's right (first "
        "object) or left (second), evaluate.object_distance apart.",
    )
    post: PostParameters | None = Field(None, description="What the object stands on; null: the sponge.")


def check_picks(picks: Sequence[PickParameters], styles: Mapping[str, Sequence[str]]) -> None:
    """Check that one hand can carry out the picks, and that every object of a style is in at most one of them.

    Args:
        styles: objects by style.

    Raises:
        ValueError: it cannot, or an object is unknown, or in two picks.
    """
    if not 2 <= len(picks) <= len(ORDINALS):
        raise ValueError(f"picks has {len(picks)} entries; a sequence has 2 to {len(ORDINALS)}")
    fingers = Counter(finger for pick in picks for finger in pick.fingers or () if finger != "palm")
    twice = [finger for finger, count in fingers.items() if count > 1]
    if twice:
        raise ValueError(f"picks: the {twice[0]} finger is named twice; only the palm may press on several objects")
    if len({pick.fingers is None for pick in picks}) > 1:
        raise ValueError("picks: name the fingers of every pick, or of none")
    owners: dict[tuple[str, str], int] = {}
    for number, pick in enumerate(picks):
        where = f"picks.{number}"
        if pick.style == "side" and pick.fingers and "palm" not in pick.fingers:
            raise ValueError(f"{where}: a side grasp is held against the palm; add it to fingers")
        if number > 1 and pick.place is None:
            raise ValueError(f"{where} has no place; say where its object stands")
        for name in objects_of(pick, styles):
            if name not in styles[pick.style]:
                raise ValueError(f"{where}.objects names {name!r}, which is not in styles.{pick.style}")
            if (pick.style, name) in owners:
                raise ValueError(
                    f"{where}: {name} is already in picks.{owners[pick.style, name]}; name `objects` in both"
                )
            owners[pick.style, name] = number


def objects_of(pick: PickParameters, styles: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the objects of a pick."""
    return list(styles[pick.style] if pick.objects is None else pick.objects)


def pick_of(picks: Sequence[PickParameters], style: str, name: str) -> int | None:
    """Return the number of the pick that grasps an object in a style; None when there is none."""
    own = [
        number
        for number, pick in enumerate(picks)
        if pick.style == style and (pick.objects is None or name in pick.objects)
    ]
    return own[0] if own else None


def waiting_fingers(picks: Sequence[PickParameters], number: int) -> tuple[str, ...]:
    """Return the fingers that are straight while an object is picked: those that later picks name."""
    return tuple(finger for pick in picks[number + 1 :] for finger in pick.fingers or () if finger != "palm")


def narrowed(style: StyleParameters, pick: PickParameters) -> StyleParameters:
    """Return the settings of a style for the fingers, the support and the chains of one pick.

    Heights count from the plane that a post stands on.
    """
    changes: dict[str, Any] = {} if pick.chains is None else {"chains": pick.chains}
    if pick.fingers is not None:
        changes |= {"finger_sets": [pick.fingers], "contacts": {"+".join(pick.fingers): len(pick.fingers)}, "links": {}}
    if pick.post is not None:
        changes["table_clearance"] = style.table_clearance - pick.post.height
        if style.mount_clearance is not None:
            changes["mount_clearance"] = style.mount_clearance - pick.post.height
    return style.model_copy(update=changes)
