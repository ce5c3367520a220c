"""The boxes and balls of a hand's links: those of its URDF, those of its description, or fitted ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.urdf import Urdf
from pipeline.records.errors import UserError
from pipeline.records.parameters.hand import HandDescription, ShapesDescription

if TYPE_CHECKING:
    from pipeline.hand.fitting import Cluster, Fit, Solid

MOST_SHAPES = 62  # bits of the kernel's mask

Box = tuple[NDArray[np.float64], NDArray[np.float64]]  # pose (4, 4) and half extents (3,), link frame
Ball = tuple[NDArray[np.float64], float]  # centre (3,), link frame, and radius


@dataclass(frozen=True)
class ShapeFit:
    """How well boxes and balls stand for the shapes by which a link collides."""

    shapes: int
    parts: int
    error: float  # m, largest distance between the surfaces, both ways


@dataclass(frozen=True)
class LinkShapes:
    """Shapes of all links, in their order."""

    boxes: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]]  # link, pose, half extents
    spheres: list[tuple[int, NDArray[np.float64], float]]  # link, centre, radius
    fits: Mapping[str, ShapeFit]  # of the links whose shapes were fitted


def link_shapes(names: Sequence[str], description: HandDescription, urdf: Urdf) -> LinkShapes:
    """Return the boxes and balls of all links.

    Raises:
        UserError: there are more than the kernel can take, and describing them by fewer is left to the user.
    """
    own: dict[str, tuple[list[Box], list[Ball]]] = {}
    inexact: list[str] = []
    for name in names:
        if name in description.shapes:
            own[name] = _described(description.shapes[name])
        else:
            boxes, balls, others = urdf.boxes_and_balls(name)
            own[name] = (boxes, balls)
            inexact += [name] if others else []
    total = sum(len(boxes) + len(balls) for boxes, balls in own.values())
    fits: Mapping[str, ShapeFit] = {}
    if inexact or total > MOST_SHAPES:
        candidates = [name for name in names if name not in description.shapes and urdf.has_shape(name)]
        chosen = inexact if total <= MOST_SHAPES - len(inexact) else candidates
        taken = sum(len(boxes) + len(balls) for name, (boxes, balls) in own.items() if name not in chosen)
        if taken + len(chosen) > MOST_SHAPES:
            raise UserError(
                f"{urdf.file}: the hand has {taken} boxes and balls of its description and {len(chosen)} links more, "
                f"{MOST_SHAPES} shapes are possible; describe links by fewer under `shapes`."
            )
        fitted, fits = _fitted(chosen, urdf, MOST_SHAPES - taken, description.shape_error)
        own |= fitted
    boxes = [(index, *box) for index, name in enumerate(names) for box in own[name][0]]
    spheres = [(index, *ball) for index, name in enumerate(names) for ball in own[name][1]]
    return LinkShapes(boxes, spheres, fits)


def _described(shapes: ShapesDescription) -> tuple[list[Box], list[Ball]]:
    boxes = []
    for box in shapes.boxes:
        pose = np.eye(4)
        pose[:3, 3] = box.centre
        boxes.append((pose, np.array(box.size) / 2))
    return boxes, [(np.array(ball.centre), ball.radius) for ball in shapes.spheres]


def _fitted(
    names: Sequence[str], urdf: Urdf, budget: int, tolerance: float
) -> tuple[dict[str, tuple[list[Box], list[Ball]]], Mapping[str, ShapeFit]]:
    """Fit boxes and balls to all shapes of some links, at most ``budget`` of them."""
    from pipeline.hand.fitting import Solid, exact_error
    from pipeline.hand.meshes import solid

    links: dict[str, list[_Piece]] = {}
    solids: dict[str, list[Solid]] = {}
    for name in names:
        collisions = list(urdf.links[name].iter("collision"))
        solids[name] = [Solid(solid(collision)) for collision in collisions]
        exact = _exact_parts(name, urdf)
        links[name] = [
            _Piece([own], [other for other in solids[name] if other is not own], part)
            for own, part in zip(solids[name], exact, strict=True)
        ]
    _merge(links, budget)
    _refine([piece for pieces in links.values() for piece in pieces], budget, tolerance)
    found, fits = {}, {}
    for name, pieces in links.items():
        boxes, balls = [], []
        for piece in pieces:
            parts = piece.fit.parts
            for centre, half, radius in zip(parts.centre, parts.half, parts.radius, strict=True):
                if radius > 0:
                    balls.append((centre, float(radius)))
                else:
                    pose = np.eye(4)
                    pose[:3, 3] = centre
                    boxes.append((pose, half))
        found[name] = (boxes, balls)
        if not all(piece.exact for piece in pieces):
            fits[name] = ShapeFit(len(solids[name]), len(boxes) + len(balls), exact_error(_joined(pieces), solids[name]))
    return found, fits


def _exact_parts(name: str, urdf: Urdf) -> list[Fit | None]:
    """Return, per collision shape of a link, the box or ball that it is; None for others."""
    from pipeline.hand.fitting import Fit, Parts

    boxes, balls, others = urdf.boxes_and_balls(name)
    found: list[Fit | None] = []
    for index, collision in enumerate(urdf.links[name].iter("collision")):
        if index in others:
            found.append(None)
        elif collision.find("geometry/box") is not None:
            pose, half = boxes.pop(0)
            found.append(Fit(Parts(pose[None, :3, 3], half[None], np.zeros(1)), 0.0))
        else:
            centre, radius = balls.pop(0)
            found.append(Fit(Parts(centre[None], np.zeros((1, 3)), np.array([radius])), 0.0))
    return found


class _Piece:
    """Some solids of a link with their present fit, and the better ones to come."""

    def __init__(self, own: list[Solid], others: list[Solid], exact: Fit | None) -> None:
        from pipeline.hand.fitting import Cluster

        self.own, self.others = own, others
        self.cluster: Cluster = Cluster(own, others)
        self.exact = exact is not None
        self.fit: Fit = exact if exact is not None else self.cluster.single
        self.onward: Iterator[Fit] | None = None

    def next_fit(self, tolerance: float) -> Fit | None:
        """Return a better fit, None where there is none."""
        from pipeline.hand.fitting import fits

        if self.exact:
            return None
        if self.onward is None:
            self.onward = fits(self.cluster, tolerance)
            next(self.onward)
        return next(self.onward, None)


def _merge(links: Mapping[str, list[_Piece]], budget: int) -> None:
    """Join solids of a link until one part for each is within the budget, each time those that lose least."""

    def total() -> int:
        return sum(len(piece.fit.parts) for pieces in links.values() for piece in pieces)

    known: dict[tuple[int, int], _Piece] = {}
    while total() > budget:
        best: tuple[float, list[_Piece], _Piece, _Piece, _Piece] | None = None
        for pieces in links.values():
            for first, one in enumerate(pieces):
                for other in pieces[first + 1 :]:
                    key = (id(one), id(other))
                    if key not in known:
                        rest = [solid for solid in one.others if solid not in other.own]
                        known[key] = _Piece([*one.own, *other.own], rest, None)
                    error = known[key].fit.error
                    if best is None or error < best[0]:
                        best = (error, pieces, one, other, known[key])
        assert best is not None  # one part per link is within the budget
        _, pieces, one, other, joined = best
        pieces[pieces.index(one)] = joined
        pieces.remove(other)


def _refine(pieces: Sequence[_Piece], budget: int, tolerance: float) -> None:
    """Give more parts to the worst fits, as long as the budget lasts."""
    total = sum(len(piece.fit.parts) for piece in pieces)
    open_pieces = [piece for piece in pieces if piece.fit.error > tolerance]
    while open_pieces:
        worst = max(open_pieces, key=lambda piece: piece.fit.error)
        found = worst.next_fit(tolerance)
        more = 0 if found is None else len(found.parts) - len(worst.fit.parts)
        if found is None or total + more > budget:
            open_pieces.remove(worst)
            continue
        worst.fit, total = found, total + more
        if found.error <= tolerance:
            open_pieces.remove(worst)


def _joined(pieces: Sequence[_Piece]):  # noqa: ANN202 - imported late
    from pipeline.hand.fitting import Parts

    parts = [piece.fit.parts for piece in pieces]
    return Parts(*(np.concatenate([getattr(one, field) for one in parts]) for field in ("centre", "half", "radius")))
