"""Photos of a flat sheet without a renderer: a picture of the sheet, seen by known cameras through homographies."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.capture.markers import printed_cells
from pipeline.records.tag_layouts import TagLayout

PER_METRE = 8000  # pixels of a sheet's picture


def sheet_picture(layout: TagLayout, width: float, height: float) -> np.ndarray:
    """Return the picture of a sheet (m) with flat tags that lie upright, its middle the scene's origin."""
    picture = np.full((round(height * PER_METRE), round(width * PER_METRE)), 235, np.uint8)
    side = round(layout.size * PER_METRE)
    for number, pose in layout.poses().items():
        cells = cv2.resize(printed_cells(number, layout), (side, side), interpolation=cv2.INTER_NEAREST)
        left = round((pose.position[0] + width / 2 - layout.size / 2) * PER_METRE)
        top = round((height / 2 - pose.position[1] - layout.size / 2) * PER_METRE)
        picture[top : top + side, left : left + side] = np.where(cells > 0, 235, 20)
    return picture


def camera_around(azimuth: float, elevation: float, distance: float) -> np.ndarray:
    """Return ``T_camera_scene`` of a camera that looks at the origin; angles in degrees."""
    a, e = np.radians([azimuth, elevation])
    away = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.cross(-away, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(-away, right), -away])
    T[:3, 3] = [0, 0, distance]
    return T


def photo_of(
    sheet: np.ndarray, T: np.ndarray, focal: float, size: tuple[int, int], behind: np.ndarray | None = None
) -> np.ndarray:
    """Return the photo (h, w) of a sheet; ``behind`` (h, w) shows where the sheet does not reach."""
    K = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1.0]])
    to_scene = np.array(
        [
            [1 / PER_METRE, 0, -sheet.shape[1] / 2 / PER_METRE],
            [0, -1 / PER_METRE, sheet.shape[0] / 2 / PER_METRE],
            [0, 0, 1],
        ]
    )
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])  # OpenCV's indices to pixels with centres at .5
    H = np.linalg.inv(half) @ K @ T[:3, [0, 1, 3]] @ to_scene @ half
    large = (size[0] * 2, size[1] * 2)  # drawn twice as large and averaged: edges as a sensor sees them
    double = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1.0]])
    # In linear light throughout: values coded for a screen would move the edges when they are averaged.
    light = (sheet.astype(np.float32) / 255) ** 2.2
    seen = cv2.warpPerspective(light, double @ H, large, flags=cv2.INTER_LINEAR, borderValue=(90 / 255) ** 2.2)
    there = cv2.warpPerspective(np.ones_like(sheet), double @ H, large, flags=cv2.INTER_NEAREST)
    light = cv2.resize(seen, size, interpolation=cv2.INTER_AREA)
    photo = (255 * light ** (1 / 2.2)).round().astype(np.uint8)
    if behind is not None:
        photo = np.where(cv2.resize(there, size, interpolation=cv2.INTER_NEAREST) > 0, photo, behind)
    return photo


def pixels_of(places: np.ndarray, T: np.ndarray, focal: float, size: tuple[int, int]) -> np.ndarray:
    """Return where a pinhole sees places (n, 3)."""
    local = places @ T[:3, :3].T + T[:3, 3]
    return focal * local[:, :2] / local[:, 2:] + np.array(size) / 2
