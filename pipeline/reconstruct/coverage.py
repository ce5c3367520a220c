"""From where the photos of a capture look at every object, and what is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.cameras import PosedPhoto
from pipeline.reconstruct.photos import Photo
from pipeline.reconstruct.tag_cameras import TagCameras, lens_groups
from pipeline.records.captures import Scene, SceneObject

LARGEST_GAP = 45.0  # degrees of azimuth without a photo
LOW, HIGH = 40.0, 50.0  # degrees above the support: some photos are to be lower than LOW, some higher than HIGH
SIDEWAYS = 75.0  # degrees above the support, from which on a photo shows no side
SMALL = 0.1  # of a photo's longer side, that a box should fill
LEAST_CORNERS = 6  # of a box's eight, that lie in a photo which shows the object


@dataclass(frozen=True)
class Looks:
    """The photos that show one object, and from where; the arrays are (n,)."""

    names: tuple[str, ...]
    azimuths: NDArray[np.float64]  # degrees, 0 to 360: of the camera seen from the object, from +x counter-clockwise
    heights: NDArray[np.float64]  # degrees of the camera above the support, -90 to 90
    shares: NDArray[np.float64]  # longer side of the box in the photo over the longer side of the photo


def posed_photos(photos: Sequence[Photo], cameras: TagCameras | None) -> list[PosedPhoto]:
    """Return the photos whose pose the tags tell, in the order of ``photos``."""
    if cameras is None:
        return []
    _, lens_of = lens_groups(photos)
    poses = cameras.poses()
    return [
        PosedPhoto(photo, cameras.bundle.lenses[lens_of[photo.name]], poses[photo.name])
        for photo in photos
        if photo.name in poses
    ]


def centre_of(T_camera_scene: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where a camera is (3,), scene frame, m."""
    return np.asarray(-T_camera_scene[:3, :3].T @ T_camera_scene[:3, 3])


def box_pixels(item: SceneObject, support: float, view: PosedPhoto) -> NDArray[np.float64] | None:
    """Return where a photo shows the corners (8, 2) of an object's box, pixels; None if one is behind the camera."""
    local = item.corners(support, 0.0) @ view.T_camera_scene[:3, :3].T + view.T_camera_scene[:3, 3]
    return view.lens.project(local)[0] if local[:, 2].min() > 0 else None


def looks_at(item: SceneObject, support: float, posed: Sequence[PosedPhoto]) -> Looks:
    """Return which photos show an object's box, and from where."""
    middle = np.array([*item.position, support + item.box[2] / 2])
    names, found = [], []
    for view in posed:
        pixels = box_pixels(item, support, view)
        if pixels is None:
            continue
        inside = ((pixels > 0) & (pixels < view.photo.size)).all(axis=1)
        if inside.sum() < LEAST_CORNERS:
            continue
        away = centre_of(view.T_camera_scene) - middle
        azimuth = np.degrees(np.arctan2(away[1], away[0])) % 360
        height = np.degrees(np.arctan2(away[2], np.hypot(away[0], away[1])))
        names.append(view.photo.name)
        found.append((azimuth, height, np.ptp(pixels, axis=0).max() / max(view.photo.size)))
    columns = np.array(found, np.float64).reshape(-1, 3).T
    return Looks(tuple(names), columns[0], columns[1], columns[2])


def widest_gap(azimuths: NDArray[np.float64]) -> tuple[float, float]:
    """Return where the widest gap between azimuths (n,) begins, and how wide it is; degrees, counter-clockwise."""
    if not len(azimuths):
        return 0.0, 360.0
    ordered = np.sort(azimuths % 360)
    widths = np.diff([*ordered, ordered[0] + 360])
    widest = int(widths.argmax())
    return float(ordered[widest]), float(widths[widest])


def gap_around(looks: Looks) -> tuple[float, float]:
    """Return the widest gap of the photos that show an object's sides, as :func:`widest_gap` does."""
    return widest_gap(looks.azimuths[looks.heights < SIDEWAYS])


def coverage_sentences(looks: Mapping[str, Looks]) -> list[str]:
    """Return how to take better photos, one sentence each; empty where the photos go well around every object."""
    found = [
        f"No photo whose camera the tags tell shows {name}; point the camera at it, with tags in view."
        for name, its in looks.items()
        if not its.names
    ]
    shown = {name: its for name, its in looks.items() if its.names}
    for name, its in shown.items():
        begin, width = gap_around(its)
        if width > LARGEST_GAP:
            found.append(
                f"No photo shows {name} from azimuths {begin:.0f} to {(begin + width) % 360:.0f} degrees (from +x, "
                "counter-clockwise seen from above); take some there, 15 to 20 degrees apart."
            )
    low = {name: float(its.heights.min()) for name, its in shown.items() if its.heights.min() > LOW}
    if low:
        found.append(
            f"No photo is low ({', '.join(low)}: the lowest is {min(low.values()):.0f} degrees above the support); "
            "take some from about 30 degrees, which show the sides."
        )
    high = {name: float(its.heights.max()) for name, its in shown.items() if its.heights.max() < HIGH}
    if high:
        found.append(
            f"No photo is high ({', '.join(high)}: the highest is {max(high.values()):.0f} degrees above the "
            "support); take some from about 60 degrees, which show the top."
        )
    small = {name: float(np.median(its.shares)) for name, its in shown.items() if np.median(its.shares) < SMALL}
    if small:
        found.append(
            f"The photos are taken from too far ({', '.join(small)}: {min(small.values()):.0%} of a photo's longer "
            "side); go nearer, so that a box fills a quarter of it."
        )
    return found


def looks_at_all(scene: Scene, posed: Sequence[PosedPhoto]) -> dict[str, Looks]:
    """Return :func:`looks_at` of every object."""
    return {name: looks_at(item, scene.support_plane, posed) for name, item in scene.objects.items()}
