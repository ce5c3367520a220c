"""What a hand's kinematics say about grasping: where its fingertips meet, who faces whom, which sides look inwards.

Guesses from random postures, for a description that a person then reads; see ``tools.describe_hand``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.contacts import distance_to_shapes
from pipeline.hand.fitting import Solid
from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.hand.surface import farthest_points, hand_surface
from pipeline.records.parameters.hand import PALM

POSTURES = 6000  # random ones
BEST = 40  # of them that say where fingers meet
NEARBY, NARROWING = 600, (0.15, 0.1, 0.06, 0.03, 0.015, 0.008)  # postures of a round, and how widely they are drawn
STRAYED = 0.05  # m, that a posture at the other ends of all joints counts as being off
EXTREME = 0.01  # m, that joints all at their limits count as being off
SEGMENT = 0.015  # m, least length of what is taken as a finger's last segment
PAD_WAY, TURNED = 0.3, 0.03  # cosine between it and the way to what is held where pads touch; m, other cosines count so
UNLIKE = 0.2  # m, that fingers of one make which are bent unlike count as being off, by their variance
CROSSED = 0.03  # m, that fingers which all reach across the middle count as being off
HELD_RADIUS = 0.035  # m, of what fingertips are to close about
FACING, TIP_FACING = 0.7, 0.2  # cosine between a surface's normal and the way to the middle of what is held
ALONE, TOGETHER = -0.2, 0.1  # mean cosines between fingertips, seen from there: one that opposes, those that it opposes
PARALLEL, ASKEW = 0.85, 0.75  # cosines of stretched fingers with each other, and of a thumb with them
WITHIN_REACH = 0.02  # m, from what is held: what is farther away touches it in no posture like this one
NO_SURFACE = 0.002  # m, from the shape that physics has of a link: what is farther is a seam between fitted shapes
ALIKE = 0.7  # cosine between normals of fitted shapes and of physics: steps between fitted boxes are no surface
DISC, OFF_DISC = 0.004, 0.0015  # m: an edge is where a disc on the surface stands off by more
ROOM = 0.008  # m, that must be free in front of a contact
BURIED = 0.001  # m, from another link: what is nearer touches nothing else
CONTACT_LINKS = 3  # last ones of a finger that may touch
TIP_CONTACTS, OTHER_CONTACTS = 16, 8
OVERLAPPING = 0.9  # share of postures in which shapes that overlap do so by design
MOST_GROUPS = 32


@dataclass(frozen=True)
class Meeting:
    """How fingertips close about a ball."""

    q: NDArray[np.float64]  # (J,) the best posture
    centre: NDArray[np.float64]  # (3,) of the ball, hand frame
    directions: Mapping[str, NDArray[np.float64]]  # by finger, unit, from there to its tip
    miss: float  # m, how far tips are from the ball's surface, root mean square


@dataclass(frozen=True)
class Held:
    """A ball, or a cylinder without end, and a posture in which fingers hold it."""

    q: NDArray[np.float64]  # (J,) rad
    centre: NDArray[np.float64]  # (3,) m, hand frame
    radius: float  # m
    axis: NDArray[np.float64] | None = None  # (3,) unit, of the cylinder

    def towards(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the ways (n, 3) from points (n, 3) to the middle of the ball, or to the axis; hand frame."""
        ways = self.centre - points
        return ways if self.axis is None else ways - (ways @ self.axis)[:, None] * self.axis


def tip_points(hand: Hand) -> dict[str, tuple[int, NDArray[np.float64]]]:
    """Return, by finger, its last link and the middle of that link's farthest shape, link frame."""
    found = {}
    for finger, links in hand.finger_links.items():
        if finger == PALM:
            continue
        link = hand.link(links[-1])
        centres = np.concatenate(
            [
                hand.box_pose[hand.box_link == link, :3, 3],
                hand.sphere_centre[hand.sphere_link == link],
                np.zeros((1, 3)),
            ]
        )
        found[finger] = link, centres[np.linalg.norm(centres, axis=1).argmax()]
    return found


def last_segments(hand: Hand) -> dict[str, int]:
    """Return, by finger, the last link whose origin is ``SEGMENT`` or more away from the tip: from there it points."""
    T = link_poses(hand, ((hand.lower + hand.upper) / 2)[None])[0]
    found = {}
    for finger, (link, point) in tip_points(hand).items():
        tip = T[link, :3, :3] @ point + T[link, :3, 3]
        own = [hand.link(name) for name in hand.finger_links[finger]]
        away = [other for other in own if np.linalg.norm(T[other, :3, 3] - tip) >= SEGMENT]
        found[finger] = (away or own)[-1]
    return found


def finger_bases(hand: Hand) -> dict[str, NDArray[np.float64]]:
    """Return where every finger's first link is (3,), m, hand frame, with all joints in the middle of their range."""
    T = link_poses(hand, ((hand.lower + hand.upper) / 2)[None])[0]
    return {finger: T[hand.link(links[0]), :3, 3] for finger, links in hand.finger_links.items() if finger != PALM}


@dataclass(frozen=True)
class _Tries:
    """Postures, and how well the fingertips close about a ball in each."""

    q: NDArray[np.float64]  # (n, J) rad
    places: NDArray[np.float64]  # (n, fingers, 3) of the tips, hand frame, m
    centre: NDArray[np.float64]  # (n, 3)
    miss: NDArray[np.float64]  # (n,) m
    score: NDArray[np.float64]  # (n,) m; the lower, the better


def _tried(hand: Hand, q: NDArray[np.float64], opposed: Sequence[str], radius: float) -> _Tries:
    tips = tip_points(hand)
    links, points = np.array([link for link, _ in tips.values()]), np.array([point for _, point in tips.values()])
    T = link_poses(hand, q)
    places = points_on_links(T, links, points)
    segments = places - T[:, list(last_segments(hand).values())][..., :3, 3]
    alone = np.array([finger in opposed for finger in tips])
    centre = places.mean(1)
    if 0 < alone.sum() < len(tips):
        centre = (places[:, alone].mean(1) + places[:, ~alone].mean(1)) / 2
    away = np.linalg.norm(places - centre[:, None], axis=2)
    apart = np.min(
        [np.linalg.norm(places[:, a] - places[:, b], axis=1) for a, b in combinations(range(len(tips)), 2)], 0
    )
    miss = np.sqrt(((away - radius) ** 2).mean(1)) + np.maximum(0.015 - apart, 0.0)
    bent = ((2 * (q - hand.lower) / (hand.upper - hand.lower) - 1) ** 2).mean(1)
    crossed = _crossed(hand, places - centre[:, None], list(tips))
    ways = (_unit(segments) * _unit(centre[:, None] - places)).sum(2)
    turned = ((ways - PAD_WAY) ** 2).mean(1)
    score = miss + EXTREME * bent + CROSSED * crossed + TURNED * turned + UNLIKE * _unlike(hand, q)
    return _Tries(q, places, centre, miss, score)


def _unlike(hand: Hand, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how unlike fingers of one make are bent, (n,): the variance of joints that are alike, as parts of a range.

    Alike are joints of the same number in fingers with as many, and with the same limits.
    """
    groups: dict[tuple[float, ...], list[int]] = {}
    for joints in hand.finger_joints.values():
        for number, joint in enumerate(joints):
            groups.setdefault((len(joints), number, hand.lower[joint], hand.upper[joint]), []).append(joint)
    shares = (q - hand.lower) / (hand.upper - hand.lower)
    found = [shares[:, own].var(1) for own in groups.values() if len(own) > 1]
    return np.mean(found, axis=0) if found else np.zeros(len(q))


def meeting(hand: Hand, opposed: Sequence[str] = ()) -> Meeting:
    """Return where the fingertips close best about a ball of ``HELD_RADIUS``, among random postures.

    Args:
        opposed: the finger that the others face, if one is known.
    """
    rng = np.random.Generator(np.random.PCG64(0))
    tried = _tried(hand, rng.uniform(hand.lower, hand.upper, (POSTURES, hand.joint_count)), opposed, HELD_RADIUS)
    order = np.argsort(tried.score, kind="stable")[:BEST]
    middle = tried.centre[order].mean(0)
    mean = (tried.places[order] - tried.centre[order, None]).mean(0)
    unit = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    near = order[np.linalg.norm(tried.centre[order] - middle, axis=1).argmin()]
    directions = dict(zip(tip_points(hand), unit, strict=True))
    return Meeting(tried.q[near], tried.centre[near], directions, float(tried.miss[order[0]]))


def meeting_near(hand: Hand, start: Meeting, opposed: Sequence[str], radius: float) -> Meeting:
    """Return where the fingertips close about a ball of some radius, m, in a posture like that of another meeting.

    A random search about the best posture so far, narrower in every round; far from the start counts as being off.
    """
    rng = np.random.Generator(np.random.PCG64(1))
    reach, best = hand.upper - hand.lower, start.q
    for width in NARROWING:
        q = best + width * reach * rng.standard_normal((NEARBY, hand.joint_count))
        tried = _tried(hand, np.clip(np.vstack([best, q]), hand.lower, hand.upper), opposed, radius)
        off = (((tried.q - start.q) / reach) ** 2).mean(1)
        at = int((tried.score + STRAYED * off).argmin())
        best = tried.q[at]
    away = tried.places[at] - tried.centre[at]
    unit = away / np.linalg.norm(away, axis=1, keepdims=True)
    return Meeting(best, tried.centre[at], dict(zip(tip_points(hand), unit, strict=True)), float(tried.miss[at]))


def _crossed(hand: Hand, away: NDArray[np.float64], fingers: Sequence[str]) -> NDArray[np.float64]:
    """Return the share (n,) of fingers whose tips, ``away`` (n, fingers, 3) from the middle, are not on their side."""
    at = finger_bases(hand)
    bases = np.array([at[finger] for finger in fingers])
    return ((away * (bases - bases.mean(0))).sum(2) < 0).mean(1)


def opposing(found: Meeting, ways: Mapping[str, NDArray[np.float64]]) -> list[str]:
    """Return the finger that all others face, if there is one: the thumb, where one is called so.

    Otherwise the one that points elsewhere when all are stretched and the rest are parallel; otherwise the one that all
    others face where the tips meet.

    Args:
        ways: by finger the way (3,), unit, that it points when stretched, hand frame.
    """
    if "thumb" in found.directions:
        return ["thumb"]
    names, units = list(found.directions), np.array(list(found.directions.values()))
    if len(names) == 2:
        return names[:1]
    if (odd := _odd_one(np.array([ways[name] for name in names]))) is not None:
        return [names[odd]]
    cosines = units @ units.T
    alone = (cosines.sum(1) - 1) / (len(names) - 1)
    first = int(alone.argmin())
    rest = [index for index in range(len(names)) if index != first]
    together = np.mean([cosines[a, b] for a, b in combinations(rest, 2)])
    return [names[first]] if alone[first] < ALONE and together > TOGETHER else []


def _odd_one(units: NDArray[np.float64]) -> int | None:
    """Return which of some unit vectors (n, 3) is not parallel to the rest, which are parallel."""
    cosines = units @ units.T
    for index in range(len(units)):
        rest = [other for other in range(len(units)) if other != index]
        if cosines[np.ix_(rest, rest)].min() > PARALLEL and cosines[index, rest].max() < ASKEW:
            return index
    return None


def inner_contacts(
    hand: Hand, held: Mapping[str, Held], solids: Mapping[str, Sequence[Solid]]
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return contact candidates by link, points and normals (n, 3), link frame: what is near what is held and faces it.

    Args:
        held: what each finger holds.
        solids: convex ones of each link, which physics has in the place of its shapes, link frame.
    """
    owner, local = hand_surface(4000, hand)
    contacts = {}
    for finger, own in held.items():
        T, names = link_poses(hand, own.q[None])[0], hand.finger_links[finger]
        for name in names[-CONTACT_LINKS:]:
            link, last = hand.link(name), name == names[-1]
            points = local[owner == link]
            if not len(points):
                continue
            towards = own.towards(points @ T[link, :3, :3].T + T[link, :3, 3]) @ T[link, :3, :3]  # link frame
            inwards, near = _unit(towards), np.linalg.norm(towards, axis=1) < own.radius + WITHIN_REACH
            depth, normals = of_solids(solids[name], points)
            is_surface = (np.abs(depth) < NO_SURFACE) & ((normals * outward_normals(hand, link, points)).sum(1) > ALIKE)
            is_surface &= away_from_edges(solids[name], points - depth[:, None] * normals, normals)
            facing = (normals * inwards).sum(1) > (TIP_FACING if last else FACING)
            open_in_front = exposed(hand, link, points, own.q) & clear(hand, link, points + ROOM * normals, own.q)
            chosen = np.flatnonzero(near & is_surface & facing & open_in_front)
            count = min(len(chosen), TIP_CONTACTS if last else OTHER_CONTACTS)
            if count:
                chosen = chosen[farthest_points(points[chosen], count)]
                contacts[name] = points[chosen], normals[chosen]
    return contacts


def of_solids(solids: Sequence[Solid], points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far points (n, 3) are outside of convex solids, (n,), m, and the normals (n, 3) of the nearest faces.

    Distances are those from the plane of that face, negative inside.
    """
    rows = np.arange(len(points))
    heights = [points @ one.planes[:, :3].T - one.planes[:, 3] for one in solids]
    depths = np.array([own.max(1) for own in heights])
    normals = np.array([one.planes[own.argmax(1), :3] for one, own in zip(solids, heights, strict=True)])
    nearest = depths.argmin(0)
    return depths[nearest, rows], normals[nearest, rows]


def away_from_edges(
    solids: Sequence[Solid], points: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return at which points (n, 3) on convex solids a disc of ``DISC`` radius, on the tangent plane, is near them."""
    side = np.cross(normals, np.eye(3)[np.abs(normals).argmin(1)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(normals, side)
    angles = np.arange(8) * np.pi / 4
    around = [points + DISC * (np.cos(angle) * side + np.sin(angle) * other) for angle in angles]
    return np.all([of_solids(solids, ring)[0] < OFF_DISC for ring in around], axis=0)


def exposed(hand: Hand, link: int, points: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points (n, 3) on a link's shapes, link frame, are on its surface and in no other link at q (J,)."""
    return (np.abs(distance_to_link(hand, link, points)) < 1e-6) & clear(hand, link, points, q)


def clear(hand: Hand, link: int, points: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points (n, 3), in a link's frame, are in no other link at q (J,)."""
    T = link_poses(hand, q[None])[0]
    world = points @ T[link, :3, :3].T + T[link, :3, 3]
    free = np.ones(len(points), dtype=bool)
    for other in sorted({*hand.box_link.tolist(), *hand.sphere_link.tolist()} - {link}):
        free &= distance_to_link(hand, other, (world - T[other, :3, 3]) @ T[other, :3, :3]) > BURIED
    return free


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def _shapes_of(hand: Hand, link: int):  # type: ignore[no-untyped-def]  # noqa: ANN202
    boxes = [
        (pose, half) for own, pose, half in zip(hand.box_link, hand.box_pose, hand.box_half, strict=True) if own == link
    ]
    balls = [
        (centre, float(radius))
        for own, centre, radius in zip(hand.sphere_link, hand.sphere_centre, hand.sphere_radius, strict=True)
        if own == link
    ]
    return boxes, balls


def distance_to_link(hand: Hand, link: int, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distances (n,), m, of points (n, 3) in a link's frame from its shapes, negative inside."""
    return distance_to_shapes(points, *_shapes_of(hand, link))


def outward_normals(hand: Hand, link: int, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit vectors (n, 3) in which points (n, 3) on a link's shapes look, link frame."""
    step = 1e-6 * np.eye(3)
    slopes = np.stack(
        [distance_to_link(hand, link, points + d) - distance_to_link(hand, link, points - d) for d in step], axis=1
    )
    return slopes / np.maximum(np.linalg.norm(slopes, axis=1, keepdims=True), 1e-12)


def overlapping_pairs(hand: Hand) -> list[tuple[str, str]]:
    """Return pairs of links, other than parent and child, whose shapes overlap in nearly all postures."""
    rng = np.random.Generator(np.random.PCG64(1))
    q = rng.uniform(hand.lower, hand.upper, (30, hand.joint_count))
    owner, local = hand_surface(1500, hand)
    T = link_poses(hand, q)
    world = points_on_links(T, owner, local)
    found = []
    for one, other in combinations(range(len(hand.link_names)), 2):
        if one in (hand.parent[other],) or other in (hand.parent[one],):
            continue
        touching = np.zeros(len(q), dtype=bool)
        for link, against in ((one, other), (other, one)):
            points = world[:, owner == link] - T[:, against, None, :3, 3]
            inside = np.einsum("bji,bnj->bni", T[:, against, :3, :3], points)
            flat = distance_to_link(hand, against, inside.reshape(-1, 3)).reshape(len(q), -1)
            touching |= (flat < 0).any(1)
        if touching.mean() >= OVERLAPPING:
            found.append((hand.link_names[one], hand.link_names[other]))
    return found


def groups(pairs: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Return groups of links in which every two are one of the pairs, the largest first, that cover all pairs."""
    known = {frozenset(pair) for pair in pairs}
    left, found = set(known), []
    for pair in pairs:
        if frozenset(pair) not in left:
            continue
        group = list(pair)
        for name in sorted({name for other in pairs for name in other}):
            if name not in group and all(frozenset((name, own)) in known for own in group):
                group.append(name)
        left -= {frozenset(two) for two in combinations(group, 2)}
        found.append(group)
    return sorted(found, key=len, reverse=True)[:MOST_GROUPS]
