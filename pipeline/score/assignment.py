"""Which fingers are meant to hold an object, in which style, and where they touch it.

What the file says comes first. Otherwise it is the finger set of a style of which all fingers touch; and where more
fingers touch than any style has, all of those.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.hand import PALM
from pipeline.records.parameters.synthesize import StyleParameters, SynthesizeParameters
from pipeline.records.poses import transform_points
from pipeline.sample.contacts import TOUCHING, Contacts, choose_contacts
from pipeline.score.foreign import Hold
from pipeline.score.frames import touch
from pipeline.shapes.distance_field import DistanceField
from pipeline.share.released import released_contact_indices


@dataclass(frozen=True)
class Assigned:
    """How an object is meant to be held."""

    style: str  # pinch or side: how the hand comes, and how hard it presses
    contacts: Contacts  # of this one grasp
    deepest: float  # m, how deep a point of the hand is inside the object

    @property
    def fingers(self) -> tuple[str, ...]:
        """Who holds."""
        return self.contacts.fingers[0]


def assign(
    hand: Hand,
    prepared: PreparedObject,
    T_object_hand: NDArray[np.float64],
    q: NDArray[np.float64],
    hold: Hold,
    settings: SynthesizeParameters,
    style: str = "",
) -> Assigned:
    """Return how a hand is meant to hold an object.

    Args:
        T_object_hand: (4, 4).
        q: (J,) rad.
        hold: what the file says.
        style: where the place of the object in a sequence says it; '': to be found out.

    Raises:
        UserError: the file names fingers or contact points that the hand does not have.
    """
    field = DistanceField(prepared)
    seen = touch(hand, field, T_object_hand, q)
    points = _listed_points(hand, hold.contacts)
    said = hold.fingers or tuple(dict.fromkeys(hand.contact_finger[point] for point in points))
    for finger in said:
        if finger not in hand.finger_links:
            raise UserError(f"{finger!r} is no finger of the hand {hand.name}; use {', '.join(hand.finger_links)}.")
    styles = {name: own for name, own in (("pinch", settings.pinch), ("side", settings.side)) if own.finger_sets}
    chosen, fingers = _style_and_fingers(said or seen.fingers, said, style, styles)
    own = _with_set(styles[chosen], fingers) if fingers else styles[chosen]
    if points:
        contacts = _near(hand, field, T_object_hand, q, points, fingers)
    else:
        rng = np.random.default_rng(0)
        contacts = choose_contacts(hand, prepared, field, T_object_hand[None], q[None], settings.energy, own, rng)
    return Assigned(chosen, contacts, seen.deepest)


def _style_and_fingers(
    touching: Sequence[str], said: Sequence[str], style: str, styles: dict[str, StyleParameters]
) -> tuple[str, tuple[str, ...]]:
    """Return the style, and the fingers if they are settled; no fingers: one of the style's sets is to be chosen."""
    if not styles:
        raise UserError("params.yaml: synthesize has no finger set in any style; add those of this hand there.")
    wanted = set(touching)
    for name, own in styles.items():
        for fingers in own.finger_sets:
            if set(fingers) == wanted and style in ("", name):
                return name, tuple(fingers)
    if style:
        return style, tuple(said)
    likely = "side" if PALM in wanted and "side" in styles and not wanted & _others(styles) else next(iter(styles))
    if said or len(wanted) > max(len(fingers) for fingers in styles[likely].finger_sets):
        return likely, tuple(said or touching)
    return likely, ()


def _others(styles: dict[str, StyleParameters]) -> set[str]:
    """Return the fingers that side grasps leave alone."""
    pinching = {finger for fingers in styles["pinch"].finger_sets for finger in fingers} if "pinch" in styles else set()
    return pinching - {finger for fingers in styles["side"].finger_sets for finger in fingers}


def _with_set(settings: StyleParameters, fingers: tuple[str, ...]) -> StyleParameters:
    """Return the settings of a style with one finger set; an unknown one gets a contact for every finger."""
    known = {frozenset(own): own for own in settings.finger_sets}
    own = list(known.get(frozenset(fingers), fingers))
    key = "+".join(own)
    count = settings.contacts.get(key, len(own))
    links = {key: settings.links[key]} if key in settings.links else {}
    return settings.model_copy(update={"finger_sets": [own], "contacts": {key: count}, "links": links})


def _listed_points(hand: Hand, contacts: Sequence[int]) -> tuple[int, ...]:
    """Return our contact candidates of indices that count through the links.

    Raises:
        UserError: there is no such point.
    """
    if not contacts:
        return ()
    ours = np.argsort(released_contact_indices(hand))
    if max(contacts) >= len(ours) or min(contacts) < 0:
        raise UserError(
            f"the file names contact point {max(contacts)}, and the hand {hand.name} has {len(ours)}; leave them out."
        )
    return tuple(int(ours[index]) for index in contacts)


def _near(
    hand: Hand,
    field: DistanceField,
    T_object_hand: NDArray[np.float64],
    q: NDArray[np.float64],
    points: Sequence[int],
    fingers: Sequence[str],
) -> Contacts:
    """Return listed contacts; one that is not near gives way to the nearest on its link.

    Others may order the points within a link otherwise.
    """
    on_hand = points_on_links(link_poses(hand, q[None]), hand.contact_link, hand.contact_points)[0]
    distance, outward = field.look_up(transform_points(T_object_hand, on_hand))
    distance = np.abs(distance)
    chosen = []
    for point in points:
        same = np.flatnonzero(hand.contact_link == hand.contact_link[point])
        chosen.append(point if distance[point] <= TOUCHING else int(same[distance[same].argmin()]))
    candidates = np.array(list(dict.fromkeys(chosen)), dtype=np.int64)
    normals = outward[candidates] / np.maximum(np.linalg.norm(outward[candidates], axis=1, keepdims=True), 1e-9)
    return Contacts([tuple(fingers)], [candidates], [normals], np.array([float(distance[candidates].mean())]))
