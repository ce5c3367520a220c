"""Joint names of a file and the joints of a hand: which is which."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.records.errors import UserError
from pipeline.records.parameters.hand import PALM

NO_NAMES = "the file names no joints"
EXCESS = 0.02  # rad beyond a joint's limit that is rounding


@dataclass(frozen=True)
class JointMap:
    """Where every joint of the hand stands in a file."""

    pairs: tuple[tuple[str, str], ...]  # (J,) name in the file and name of the hand's joint, in the hand's order
    columns: NDArray[np.int64]  # (J,) place in the file of each of the hand's joints


def map_joints(names: Sequence[str] | None, count: int, hand: Hand, chosen: Sequence[str] = ()) -> JointMap:
    """Return where the hand's joints stand in a file.

    By equal names, or names that differ in punctuation, or `ffj0` (MuJoCo's menagerie), or those of Drake's Allegro;
    where a file has no names, by place.

    Args:
        names: of the file's values, if it has any.
        count: number of the file's values.
        chosen: the hand's joints in the order of the file's values, as the user says; empty: to be found out.

    Raises:
        UserError: a joint is missing, or there is one that the hand does not have.
    """
    if chosen:
        if sorted(chosen) != sorted(hand.joint_names) or len(chosen) != count:
            raise UserError(
                f"--joints names {len(chosen)} joints for {count} values; name each of {', '.join(hand.joint_names)} "
                "once."
            )
        targets: list[str | None] = list(chosen)
        labels = list(names or [f"value {index}" for index in range(count)])
    elif names is None:
        if count != hand.joint_count:
            raise UserError(
                f"{NO_NAMES}, and has {count} values where the hand {hand.name} has {hand.joint_count} joints; choose "
                "another --hand."
            )
        targets, labels = list(hand.joint_names), [f"value {index}" for index in range(count)]
    else:
        targets, labels = [joint_of(name, hand) for name in names], list(names)
    unknown = [name for name, target in zip(labels, targets, strict=True) if target is None]
    missing = [name for name in hand.joint_names if name not in targets]
    if unknown or missing or len(set(targets)) < len(targets):
        which = (
            f"{unknown[0]!r} is no joint" if unknown else f"{missing[0]!r} is missing" if missing else "one is twice"
        )
        raise UserError(
            f"the joints of the file are not those of the hand {hand.name} ({which}); choose another --hand, or say "
            f"with --joints which of {', '.join(hand.joint_names)} each value is, separated by commas."
        )
    columns = np.array([targets.index(name) for name in hand.joint_names], dtype=np.int64)
    return JointMap(
        tuple((labels[column], name) for column, name in zip(columns, hand.joint_names, strict=True)), columns
    )


def other_orders(hand: Hand) -> dict[str, tuple[str, ...]]:
    """Return orders of joints in which others store values without names, by what they are called.

    Fingers one after the other with the opposing one first, or second as Isaac Gym has it; or the first joints of all
    fingers, then the second ones, as SAPIEN counts them.
    """
    names = {finger: [hand.joint_names[joint] for joint in joints] for finger, joints in hand.finger_joints.items()}
    orders: dict[str, tuple[str, ...]] = {}
    for thumb in [finger for finger in hand.opposing if finger != PALM]:
        fingers = [finger for finger in names if finger != thumb]
        for called, own in (("first", [thumb, *fingers]), ("second", [fingers[0], thumb, *fingers[1:]])):
            orders[f"the {thumb} {called}"] = tuple(joint for finger in own for joint in names[finger])
    layers = range(max(map(len, names.values()), default=0))
    orders["the first joints of all fingers first"] = tuple(
        own[layer] for layer in layers for own in names.values() if layer < len(own)
    )
    return {
        called: order
        for called, order in orders.items()
        if order != tuple(hand.joint_names) and sorted(order) == sorted(hand.joint_names)
    }


@lru_cache(maxsize=1)
def _conventions() -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(Path(__file__).with_name("joint_names.yaml").read_text())
    return content


def joint_of(name: str, hand: Hand) -> str | None:
    """Return the joint of a hand that a name means, None if there is none."""
    if name in hand.joint_names:
        return name
    plain = {_letters(own): own for own in hand.joint_names}
    if _letters(name) in plain:
        return plain[_letters(name)]
    if _letters(name) + "_0" in plain:  # joint_3 of joint_3.0
        return plain[_letters(name) + "_0"]
    menagerie = re.fullmatch(r"(?:.*[/:_])?(ff|mf|rf|lf|th)[ja]?(\d)", name.lower())
    if menagerie:
        return _along(hand, _conventions()["fingers"][menagerie[1]], int(menagerie[2]))
    drake = re.fullmatch(r"algr_[rl]h_(if|mf|rf|th)_([a-z]{3})(?:_.*)?", name.lower())
    if drake:
        place = _conventions()["joints_of_thumb" if drake[1] == "th" else "joints"].get(drake[2])
        return None if place is None else _along(hand, _conventions()["fingers"][drake[1]], place)
    return None


def _letters(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower())


def _along(hand: Hand, finger: str, place: int) -> str | None:
    joints = hand.finger_joints.get(finger, ())
    return hand.joint_names[joints[place]] if place < len(joints) else None


def within_limits(q: NDArray[np.float64], hand: Hand) -> tuple[NDArray[np.float64], float]:
    """Return joints (J,), rad, moved into their limits, and by how much at most."""
    inside = np.clip(q, hand.lower, hand.upper)
    return inside, float(np.abs(inside - q).max(initial=0.0))
