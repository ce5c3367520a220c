"""Scale and scene frame of photos without tags: a known length between two marked points, and the plane beneath."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.alignment import Similarity
from pipeline.reconstruct.photos import Photo
from pipeline.reconstruct.tags import Posed
from pipeline.records.captures import KnownLength
from pipeline.records.errors import UserError

WHICH = ("first", "second")
FARTHEST_MARK = 6.0  # pixels from where its point is seen, as worked with
MARKED = 1.0  # pixels: standard deviation of a mark set by hand, unless the marks disagree by more
LARGEST_SPREAD = 0.03  # relative standard deviation of the scale
STEPS = 8  # of Gauss and Newton, for a point
PLANE_TRIALS = 600  # draws of three points
IN_PLANE = 0.006  # of the usual distance of the cameras: points as near to a plane lie in it
LEAST_IN_PLANE = 0.15  # of all points; below that there is no plane
OTHER_PLANE = 0.8  # of the points of the best plane, that another one may hold at most
APART = 5.0  # times IN_PLANE, or 10 degrees, by which another plane differs
LEAST_ACROSS = 0.2  # of the known length, that must lie along the plane to give x


@dataclass(frozen=True)
class Marked:
    """A marked point, in the frame of the poses."""

    position: NDArray[np.float64]  # (3,)
    covariance: NDArray[np.float64]  # (3, 3), for marks with a standard deviation of one pixel
    errors: NDArray[np.float64]  # (n,) how far each mark is from where its point is seen, pixels as worked with


@dataclass(frozen=True)
class Plane:
    """``normal @ point = offset``; the cameras are on the side of the normal."""

    normal: NDArray[np.float64]  # (3,)
    offset: float
    share: float  # of the points, that lie in it
    off: float  # root mean square distance of these


@dataclass(frozen=True)
class LengthFit:
    """What follows from a known length and a plane: the way to the scene frame, and how well it is known."""

    similarity: Similarity
    facts: dict[str, float]  # for metrics.json


def marks_as_worked_with(scale: KnownLength, photos: Sequence[Photo]) -> list[dict[str, NDArray[np.float64]]]:
    """Return per point and photo the mark (2,) in pixels of the photos as they are worked with.

    Raises:
        UserError: a mark lies outside of its photo.
    """
    known, found = {photo.name: photo for photo in photos}, []
    for which, marks in zip(WHICH, scale.between, strict=True):
        found.append({name: np.array(pixel) / known[name].times for name, pixel in marks.items()})
        for name, (x, y) in marks.items():
            width, height = known[name].file_size
            if not (0 <= x <= width and 0 <= y <= height):
                raise UserError(
                    f"scene.yaml: scale.between: the {which} point is marked at [{x:g}, {y:g}] in {name}, which has "
                    f"{width} x {height} pixels; count from the top left corner of the photo as it is shown upright."
                )
    return found


def located_mark(views: Sequence[Posed], marks: Mapping[str, NDArray[np.float64]], which: str) -> Marked:
    """Return the point whose pictures are nearest to its marks, by least squares of pixels.

    Args:
        which: of the two points it is, for sentences.

    Raises:
        UserError: fewer than two of its photos are posed, or the rays through its marks miss each other.
    """
    seeing = [view for view in views if view.photo.name in marks]
    if len(seeing) < 2:
        raise UserError(
            f"the {which} point of `scale` is marked in {len(seeing)} of the photos that fit together; mark it in two "
            f"others or more ({', '.join(view.photo.name for view in views[:4])}, ...)."
        )
    pixels = np.array([marks[view.photo.name] for view in seeing])
    poses = np.array([view.T_camera_scene for view in seeing])
    rays = np.stack([view.lens.rays(its[None])[0] for view, its in zip(seeing, pixels, strict=True)])
    rows = rays[:, :, None] * poses[:, 2:3] - poses[:, :2]
    homogeneous = np.linalg.svd(rows.reshape(-1, 4))[2][-1]
    point = homogeneous[:3] / homogeneous[3]
    for _ in range(STEPS):
        local = poses[:, :3, :3] @ point + poses[:, :3, 3]
        seen = [view.lens.project(its[None]) for view, its in zip(seeing, local, strict=True)]
        residual = np.concatenate([its[0][0] for its in seen]) - pixels.reshape(-1)
        J = np.concatenate([its[1][0] @ T[:3, :3] for its, T in zip(seen, poses, strict=True)])
        normal = J.T @ J
        point = point - np.linalg.lstsq(normal, J.T @ residual, rcond=None)[0]
    errors = np.linalg.norm(residual.reshape(-1, 2), axis=1)
    worst = int(errors.argmax())
    if local[:, 2].min() <= 0 or not errors[worst] <= FARTHEST_MARK:
        raise UserError(
            f"the marks of the {which} point of `scale` are not of one point: that in {seeing[worst].photo.name} is "
            f"{errors[worst] * seeing[worst].photo.times:.0f} pixels off; correct it in scene.yaml."
        )
    return Marked(point, np.linalg.pinv(normal), errors)


def scale_spread(points: Sequence[Marked]) -> float:
    """Return the relative standard deviation of the distance between two points, from how well marks agree."""
    one, other = points
    between = other.position - one.position
    along = between / np.linalg.norm(between)
    variance = 0.0
    for point in points:
        # n marks are 2 n numbers, of which the point takes three.
        pixel = max(MARKED, float(np.sqrt((point.errors**2).sum() / (2 * len(point.errors) - 3))))
        variance += pixel**2 * float(along @ point.covariance @ along)
    return float(np.sqrt(variance) / np.linalg.norm(between))


def support_plane(points: NDArray[np.float64], centres: NDArray[np.float64], seed: int) -> Plane:
    """Return the plane in which most points lie, all cameras on one side of it.

    Args:
        points: (n, 3) seen by many photos, any frame and scale.
        centres: (m, 3) of the cameras.

    Raises:
        UserError: no plane holds enough of the points, or two of them nearly as many.
    """
    middle = np.median(points, axis=0)
    near = IN_PLANE * float(np.median(np.linalg.norm(centres - middle, axis=1)))
    drawn = np.random.default_rng(seed).integers(0, len(points), (PLANE_TRIALS, 3))
    a, b, c = np.moveaxis(points[drawn], 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.maximum(length, 1e-30)
    offsets = (normals * a).sum(axis=1)
    above = normals @ centres.T - offsets[:, None]
    sign = np.where((above > 0).all(axis=1), 1.0, -1.0)
    normals, offsets = normals * sign[:, None], offsets * sign
    beside = ((above * sign[:, None]) > 0).all(axis=1) & (length[:, 0] > 0)
    counts = np.where(beside, (np.abs(normals @ points.T - offsets[:, None]) < near).sum(axis=1), 0)
    best = int(counts.argmax())
    if counts[best] < max(3, LEAST_IN_PLANE * len(points)):
        raise UserError(
            "no plane is seen under the objects; put a printed cloth or a newspaper on the table, or use tags."
        )
    turned = normals @ normals[best] < np.cos(np.radians(10))
    other = counts * (turned | (np.abs(offsets - normals @ (normals[best] * offsets[best])) > APART * near))
    if other.max() > OTHER_PLANE * counts[best]:
        raise UserError(
            "two planes hold nearly as many points, and it is open which the objects stand on; put a printed cloth or "
            "a newspaper under them, keep walls out of the photos, or use tags."
        )
    normal, offset = normals[best], float(offsets[best])
    for _ in range(3):
        inside = points[np.abs(points @ normal - offset) < near]
        level = np.linalg.svd(inside - inside.mean(axis=0), full_matrices=False)[2][2]
        normal = level * np.sign(level @ normal)
        offset = float(normal @ inside.mean(axis=0))
    off = points @ normal - offset
    inside = off[np.abs(off) < near]
    return Plane(normal, offset, len(inside) / len(points), float(np.sqrt((inside**2).mean())))


def told_by_length(
    scale: KnownLength,
    marks: Sequence[Mapping[str, NDArray[np.float64]]],
    views: Sequence[Posed],
    points: NDArray[np.float64],
    seed: int,
) -> LengthFit:
    """Return the way from the frame of the poses to the scene's.

    In that the support is z = 0, the origin is where the first point drops onto it, and x points to the second.

    Args:
        points: (n, 3) seen by many photos, in the frame of the poses.

    Raises:
        UserError: the points, the plane or the scale are not told well enough.
    """
    located = [located_mark(views, its, which) for its, which in zip(marks, WHICH, strict=True)]
    one, other = (its.position for its in located)
    spread = scale_spread(located)
    if spread > LARGEST_SPREAD:
        raise UserError(
            f"the distance between the points of `scale` is known to {100 * spread:.0f} % only; mark them in more "
            "photos, from directions 30 degrees or more apart, or take points that are farther from each other."
        )
    poses = np.array([view.T_camera_scene for view in views])
    centres = -(np.swapaxes(poses[:, :3, :3], 1, 2) @ poses[:, :3, 3, None])[..., 0]
    plane = support_plane(points, centres, seed)
    between = other - one
    across = between - (between @ plane.normal) * plane.normal
    if np.linalg.norm(across) < LEAST_ACROSS * np.linalg.norm(between):
        raise UserError(
            "the points of `scale` lie one above the other, and do not tell where x points; take two beside each other."
        )
    x = across / np.linalg.norm(across)
    rotation = np.stack([x, np.cross(plane.normal, x), plane.normal])
    factor = scale.metres / float(np.linalg.norm(between))
    origin = one - (one @ plane.normal - plane.offset) * plane.normal
    errors = np.concatenate([its.errors for its in located])
    facts = {
        "scale_m": scale.metres,
        "scale_spread": spread,
        "marks_px": float(np.sqrt((errors**2).mean())),
        "marks_px_largest": float(errors.max()),
        "plane_share": plane.share,
        "plane_off_mm": 1000 * factor * plane.off,
    }
    return LengthFit(Similarity(factor, rotation, -factor * rotation @ origin), facts)
