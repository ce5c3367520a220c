"""Metric views: undistorted photos with pinhole cameras in the scene frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.cameras import PosedPhoto


@dataclass(frozen=True)
class View:
    """An undistorted photo and its pinhole camera."""

    name: str
    image: NDArray[np.float32]  # (h, w), 0 to 1
    usable: NDArray[np.bool_] | None  # (h, w)
    K: NDArray[np.float64]  # (3, 3), pixel centres at .5
    T_camera_scene: NDArray[np.float64]  # (4, 4), m

    @property
    def centre(self) -> NDArray[np.float64]:
        """Where the camera is (3,), scene frame."""
        return np.asarray(-self.T_camera_scene[:3, :3].T @ self.T_camera_scene[:3, 3])

    def project(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return pixels (n, 2) and depths (n,) of scene points (n, 3)."""
        local = points @ self.T_camera_scene[:3, :3].T + self.T_camera_scene[:3, 3]
        pixels = local @ self.K.T
        depth = local[:, 2]
        return pixels[:, :2] / np.where(np.abs(depth) > 1e-9, depth, 1e-9)[:, None], depth

    def lift(self, pixels: NDArray[np.float64], depth: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return scene points (n, 3) of pixels (n, 2) at depths (n,)."""
        rays = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ np.linalg.inv(self.K).T
        return np.asarray((rays * depth[:, None] - self.T_camera_scene[:3, 3]) @ self.T_camera_scene[:3, :3])


def _maps(view: PosedPhoto) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return per pixel of the undistorted photo its column and row (h, w) in the photo, in OpenCV's indices."""
    width, height = view.photo.size
    focal = view.lens.focal
    x = (np.arange(width) + 0.5 - width / 2) / focal
    y = (np.arange(height) + 0.5 - height / 2) / focal
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    ahead = np.concatenate([grid, np.ones((len(grid), 1))], axis=1)
    pixels = np.asarray(view.lens.project(ahead)[0], np.float32).reshape(height, width, 2) - np.float32(0.5)
    return np.ascontiguousarray(pixels[..., 0]), np.ascontiguousarray(pixels[..., 1])


def undistorted(view: PosedPhoto) -> View:
    """Return the metric pinhole view of a posed photo: same size and focal length, principal point in the middle."""
    width, height = view.photo.size
    focal = view.lens.focal
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    maps = _maps(view)
    source = view.photo.grey.astype(np.float32) / 255
    image = cv2.remap(source, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    usable = view.photo.usable
    if usable is not None:
        usable = cv2.remap(usable.astype(np.uint8), *maps, cv2.INTER_NEAREST) > 0
    return View(view.photo.name, np.asarray(image, np.float32), usable, K, view.T_camera_scene)


def undistort_all(views: Sequence[PosedPhoto]) -> list[View]:
    """Return the metric views of all posed photos."""
    return [undistorted(view) for view in views]


def undistorted_colours(view: PosedPhoto, colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the colours (h, w, 3) of a photo as its undistorted view shows them."""
    return np.asarray(cv2.remap(colours, *_maps(view), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def undistorted_normals(view: PosedPhoto, normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the normal map (h, w, 3) of a photo as its undistorted view shows it."""
    return np.asarray(cv2.remap(normals, *_maps(view), cv2.INTER_NEAREST), np.float32)
